"""The check of soles and balance on the path of a stop."""

from dataclasses import dataclass

import numpy as np

from retarget.ik.gravity_torque import GRAVITY
from retarget.ik.support_polygon import Stance, support_distance, support_edges
from retarget.ik.whole_body_stop import StopPath
from retarget.model.robot import RobotBody, plant_roots
from retarget.types import BoolArray, FloatArray

SOLE_M = 0.001  # [m] largest displacement of a sole's corner
BALANCE_M = 0.003  # [m] least distance of the centre of mass inside the support polygon
MOST_FOOTHOLDS = 64  # size of the cache of support polygons; a path has ten
NO_WORSE_M = 1e-7  # [m] rounding by which a stop may lose more than its alternative


@dataclass(frozen=True)
class Losses:
    """Largest slip of a corner of a carrying sole, m, and shortfall of the centre of mass, or of the capture point at
    rest, from BALANCE_M, m."""

    slip: float
    shortfall: float

    def within(self, others: "Losses") -> bool:
        """True if neither exceeds its bound."""
        return self.slip <= others.slip and self.shortfall <= others.shortfall


class StandingCheck:
    """The check of soles and balance of one robot, in ticks of `dt` s."""

    def __init__(self, robot: RobotBody, stance: Stance, *, dt: float) -> None:
        self._robot, self._soles, self._columns, self._dt = robot, stance.soles, robot.servo_columns, dt
        self._edges = dict[bytes, FloatArray]()

    def joints(self, postures: FloatArray) -> FloatArray:
        """Joint positions (k, n) rad of postures (k, nq)."""
        return np.ascontiguousarray(postures[:, self._columns])

    def postures(self, joints: FloatArray, standing: FloatArray) -> FloatArray:
        """Postures (k, nq) of joint positions (k, n) rad, on the lower sole as in `standing` (nq,)."""
        before = np.tile(standing, (len(joints), 1))
        rows = before.copy()
        rows[:, self._columns] = joints
        plant_roots(self._robot, before, rows)
        return rows

    def losses(self, stop: StopPath, standing: FloatArray | None = None) -> Losses:
        """Losses on a stop. standing (nq,): the posture before a walk's first, if known."""
        if stop.carries is not None:
            if standing is None:
                return self._walked(stop.postures, stop.carries)
            return self._walked(np.vstack([standing, stop.postures]), np.vstack([stop.carries[:1], stop.carries]))
        if stop.footing is None:
            return Losses(0.0, -np.inf)
        slip, inside = stop.footing.losses(stop.postures)
        return Losses(slip, BALANCE_M - inside)

    def _walked(self, postures: FloatArray, carries: BoolArray) -> Losses:
        """Losses of a walk on postures (k, nq) with carrying soles (k, 2). Its zero-moment point is on them; it ends on
        both."""
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
            shortfall = float(np.maximum(shortfall, -inside.min()))  # unlike max(), this keeps a NaN
        return Losses(slip, shortfall)

    def _edges_of(self, corners: FloatArray) -> FloatArray:
        key = corners.round(5).tobytes()
        if key not in self._edges:
            if len(self._edges) > MOST_FOOTHOLDS:
                self._edges.clear()
            self._edges[key] = support_edges([corners])
        return self._edges[key]

    def bounds(self, instead: StopPath) -> Losses:
        """Allowed losses if the alternative is the stop `instead`."""
        lost = self.losses(instead)
        return Losses(max(SOLE_M, lost.slip + NO_WORSE_M), max(0.0, lost.shortfall + NO_WORSE_M))

    def holds(self, stop: StopPath, last: FloatArray, standing: FloatArray) -> bool:
        """True if a stop keeps soles and balance, or loses no more than the last verified one (k, n)."""
        lost = self.losses(stop, standing)
        if lost.within(Losses(SOLE_M, 0.0)):
            return True
        # Each step plans the rest of a walk anew: the last stop is no alternative to compare with.
        if stop.carries is not None:
            return False
        instead = standing[None] if not len(last) else self.postures(last, standing)
        return lost.within(self.bounds(StopPath(instead, stop.footing)))
