"""Standing: whether a robot keeps its soles and its balance on the path of a stop."""

from dataclasses import dataclass

import numpy as np

from retarget.ik.base_pose import plant_roots
from retarget.ik.gravity_torque import GRAVITY
from retarget.ik.support_polygon import Stance, support_distance, support_edges
from retarget.ik.whole_body_stop import StopPath
from retarget.model.robot import RobotBody
from retarget.types import BoolArray, FloatArray

SOLE_M = 0.001
"""Distance (m) that a corner of a sole may be from its place on the way to a stop."""
BALANCE_M = 0.003
"""Distance (m) inside the outline of the soles that carry that the centre of mass keeps on the way to a stop."""
MOST_FOOTHOLDS = 64
"""Footholds whose edges are kept: those of a path are ten."""
NO_WORSE_M = 1e-7
"""What is beyond these bounds on the stop that would be followed else may go on, if it gets worse by no more than this,
m: rounding."""


@dataclass(frozen=True)
class Losses:
    """What a robot loses on a path. slip: most that a corner of a sole that carries is off its place, m. shortfall:
    most that the centre of mass falls short of BALANCE_M, m; of a robot at rest it is the capture point."""

    slip: float
    shortfall: float

    def within(self, others: "Losses") -> bool:
        """Whether both are no more than bounds."""
        return self.slip <= others.slip and self.shortfall <= others.shortfall


class StandingCheck:
    """The check of soles and balance of one robot, in ticks of `dt` s."""

    def __init__(self, robot: RobotBody, stance: Stance, *, dt: float) -> None:
        self._robot, self._soles, self._columns, self._dt = robot, stance.soles, robot.servo_columns, dt
        self._edges = dict[bytes, FloatArray]()

    def joints(self, postures: FloatArray) -> FloatArray:
        """The joints (k, n) rad, servo order, of postures (k, nq)."""
        return np.ascontiguousarray(postures[:, self._columns])

    def postures(self, joints: FloatArray, standing: FloatArray) -> FloatArray:
        """Postures (k, nq) with these joints (k, n) rad of a robot whose lower sole stays where it is in `standing`
        (nq,)."""
        before = np.tile(standing, (len(joints), 1))
        rows = before.copy()
        rows[:, self._columns] = joints
        plant_roots(self._robot, before, rows)
        return rows

    def losses(self, stop: StopPath, standing: FloatArray | None = None) -> Losses:
        """What is lost on the path of a stop. A robot that no sole carries loses nothing. standing (nq,): as the robot
        stands before the first posture of a walk; None: it is not known."""
        if stop.carries is not None:
            if standing is None:
                return self._walked(stop.postures, stop.carries)
            return self._walked(np.vstack([standing, stop.postures]), np.vstack([stop.carries[:1], stop.carries]))
        if stop.footing is None:
            return Losses(0.0, -np.inf)
        slip, inside = stop.footing.losses(stop.postures)
        return Losses(slip, BALANCE_M - inside)

    def _walked(self, postures: FloatArray, carries: BoolArray) -> Losses:
        """What a robot loses that walks on postures (k, nq), on its left and right sole as `carries` (k, 2) says: it
        ends on both, and its zero-moment point is on those that carry; a sole stays where it was put down, on the
        floor."""
        body, slip, shortfall = self._robot.kinematics, 0.0, -np.inf
        if not carries[-1].all():
            return Losses(np.inf, np.inf)
        corners = [body.points(postures, [sole.frame.body] * len(sole.corners), sole.corners) for sole in self._soles]
        for sole, points in zip(carries.T, corners, strict=True):
            begins = sole & ~np.concatenate([[False], sole[:-1]])
            put_down = np.maximum.accumulate(np.where(begins, np.arange(len(sole)), 0))
            off = points - np.concatenate([points[put_down][..., :2], np.zeros((*points.shape[:2], 1))], axis=-1)
            slip = max(slip, float(np.abs(off[sole]).max()))
        mass, g = body.centre_of_mass(postures), GRAVITY * self._dt * self._dt
        change = np.zeros_like(mass)
        change[1:-1] = mass[2:] - 2.0 * mass[1:-1] + mass[:-2]
        change[0] = change[1]
        if (g + change[:, 2]).min() <= 0.0:  # it falls
            return Losses(slip, np.inf)
        pressed = mass[:, :2] - mass[:, 2:] * change[:, :2] / (g + change[:, 2:])
        phases = np.flatnonzero(np.concatenate([[True], (carries[1:] != carries[:-1]).any(axis=1)]))
        for first, last in zip(phases, [*phases[1:], len(carries)], strict=True):
            on = [points[first, :, :2] for points, carry in zip(corners, carries[first], strict=True) if carry]
            if not on:
                return Losses(np.inf, np.inf)
            inside = support_distance(pressed[first:last], self._edges_of(np.concatenate(on)))
            shortfall = float(np.maximum(shortfall, -inside.min()))  # which a NaN survives
        return Losses(slip, shortfall)

    def _edges_of(self, corners: FloatArray) -> FloatArray:
        """The edges (e, 3) of corners (c, 2) on the floor, which are looked at tick by tick."""
        key = corners.round(5).tobytes()
        if key not in self._edges:
            if len(self._edges) > MOST_FOOTHOLDS:
                self._edges.clear()
            self._edges[key] = support_edges([corners])
        return self._edges[key]

    def bounds(self, instead: StopPath) -> Losses:
        """The most that may be lost by a robot that would follow `instead`."""
        lost = self.losses(instead)
        return Losses(max(SOLE_M, lost.slip + NO_WORSE_M), max(0.0, lost.shortfall + NO_WORSE_M))

    def holds(self, stop: StopPath, last: FloatArray, standing: FloatArray) -> bool:
        """Whether a robot keeps its soles and its balance on the path of a stop, or loses no more than on the one
        (k, n) that was verified last. standing (nq,): as it stands."""
        lost = self.losses(stop, standing)
        if lost.within(Losses(SOLE_M, 0.0)):
            return True
        # The rest of a walk is made anew with each step: no stop from elsewhere is as good.
        if stop.carries is not None:
            return False
        instead = standing[None] if not len(last) else self.postures(last, standing)
        return lost.within(self.bounds(StopPath(instead, stop.footing)))
