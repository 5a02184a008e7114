"""Whole-body stop: a robot on its soles can stop there at any tick.

Joints that each keep within their own limits may still be unable to stop together: where one must brake hard, others
would have to brake harder to keep the soles in place. So before a posture is accepted, a stop from it is computed, with
soles planted. If soles or balance would be lost on the way, the posture is not accepted, and the last verified stop
trajectory is followed instead. From rest on, all goals lie on such trajectories, and a stop that is asked for at any
tick goes along one.
"""

from math import ceil, hypot

import numpy as np

from retarget._solver import Footing, Solver, Task
from retarget.ik.support_polygon import Stance, half_spaces
from retarget.model.body import BodyModel, JointLimits
from retarget.rotations import as_quat, as_vector
from retarget.types import BoolArray, FloatArray

SOLE_M = 0.001
"""Distance (m) that a corner of a sole may be from its place on the way to a stop."""
BALANCE_M = 0.003
"""Distance (m) inside the soles' outline that the centre of mass keeps on the way to a stop."""
NO_WORSE_M = 1e-5
"""What is already beyond these bounds may go on, if it gets worse by no more than this, m."""
SPARE_TICKS = 2
"""Ticks beyond those that the slowest joint needs, for soles and balance are kept first."""
LONGEST = 100
"""Most ticks of a stop trajectory; a posture that takes longer to stop is not admitted."""
SHORT_RAD = 0.03
"""A stop in which no joint of a leg turns by more than this, rad, is admitted without a computed trajectory, where no
limit or edge is near."""
PLANTED_M = 0.1 * SOLE_M
"""Distance (m) that a corner of a sole may be from its place at the beginning of such a stop, and in the tick
before."""
STANDING = 1e-9
"""Speed (rad/s) below which a leg stands."""
ROUND_OFF = 1e-9
"""Angle (rad) beyond its limit at which a joint that rests there may seem to be."""


class Stopping:
    """Stop trajectories: `admits` says whether there is one from a posture, `follow` goes along the last one found.

    All joints brake in proportion, so that the body goes on along its way, and soles and mass with it. Joints that each
    braked as hard as they can would come to rest one after the other: where the motions of trunk and legs had cancelled
    out, the mass would be thrown.
    """

    def __init__(self, body: BodyModel, limits: JointLimits, stance: Stance, carrying: BoolArray) -> None:
        """limits (nv,): those that the postures keep. carrying (nv,): the root and the joints of the legs."""
        self._body = body.solver_body()
        single, address = body.scalar_joints()
        self._joints = np.flatnonzero(single & np.isfinite(limits.max_acceleration))
        self._slowness = 1.0 / limits.max_acceleration[self._joints]
        self._legs = carrying[self._joints]
        self._columns = address[self._joints]
        self._lowest = limits.lower[self._joints] - ROUND_OFF
        self._highest = limits.upper[self._joints] + ROUND_OFF
        self._height = float(self._body.centre_of_mass(stance.q[None])[0, 2])
        soles = [(sole, _spread(sole.outline)) for sole in stance.soles]
        links = [sole.frame.body for sole, few in soles for _ in few]
        local = np.concatenate([sole.corners[few] for sole, few in soles])
        planted = np.concatenate([sole.outline[few] for sole, few in soles])
        outline = stance.edges(0.0)
        self._footing = Footing(self._body, links, local, np.insert(planted, 2, 0.0, axis=1), outline)
        self._solver = _solver(body, limits, stance, len(outline))
        self._targets = np.tile(_targets(self._solver, stance, outline), (LONGEST + SPARE_TICKS, 1))
        start, stop = self._solver.target_slice(2, 0)
        self._places = self._targets[:, start + 1 : stop]
        self.begin(stance.q)

    def begin(self, q: FloatArray, velocity: FloatArray | None = None) -> None:
        """Start anew in posture q (nq,), moving at velocity (nv,) per s; no stop trajectory is known from there."""
        self._way, self._at, self._known = q[None], 0, velocity is None
        self._velocity = np.zeros(self._body.nv) if velocity is None else velocity
        self._slip, self._shortfall = self._losses(self._way)

    def rescale_time(self, change: float) -> None:
        """Let time go by slower from now on (change < 1), or faster (change > 1). Velocities change with it. The known
        stop trajectory stays valid, because it is followed row by row."""
        self._velocity = self._velocity / change

    @property
    def stands(self) -> bool:
        """Whether the legs stand still where the robot got last."""
        return float(np.abs(self._velocity[self._joints[self._legs]]).max(initial=0.0)) < STANDING

    @property
    def velocity(self) -> FloatArray:
        """Velocity (nv,) of the robot there, per s."""
        return self._velocity

    def admits(self, q: FloatArray, velocity: FloatArray, dt: float) -> bool:
        """Return whether a robot that just got to posture q (nq,), moving at velocity (nv,) in rad/s and m/s, can stop
        from there.

        If so, the stop trajectory from there becomes the one that `follow` goes along.
        """
        return self._stops_short(q, velocity) or self._finds_trajectory(q, velocity, dt)

    def _stops_short(self, q: FloatArray, velocity: FloatArray) -> bool:
        """Whether the robot surely can stop, because its legs hardly move; `follow` computes the trajectory.

        While all brake in proportion, they turn too little to move the soles otherwise than now, not at all. Going on
        unbraked for as long, no joint would come to its limit, nor the centre of mass to its margin.
        """
        joints = velocity[self._joints]
        speed = np.abs(joints)
        time = float((speed * self._slowness).max())  # [s] that the slowest of them needs
        ahead = q[self._columns] + time * joints
        if 0.5 * time * float(speed.max(where=self._legs, initial=0.0)) > SHORT_RAD:
            return False
        if ((ahead < self._lowest) | (ahead > self._highest)).any():
            return False
        slip, shortfall = self._losses(q[None])
        # Bound of the speed of the centre of mass: that of the root, and its turning by the height of the mass above
        # it.
        root = hypot(*velocity[:3].tolist()) + self._height * hypot(*velocity[3:6].tolist())  # [m/s]
        if max(slip, self._slip) > PLANTED_M or shortfall + time * root > 0.0:
            return False
        self._way, self._at, self._known, self._velocity = q[None], 0, False, velocity
        self._slip, self._shortfall = slip, shortfall
        return True

    def _finds_trajectory(self, q: FloatArray, velocity: FloatArray, dt: float) -> bool:
        """Whether a stop trajectory is found and verified here; it becomes the one that `follow` goes along."""
        import os
        SOFT=float(os.environ.get("SOFT","1"))
        way, ticks = q[None], self._ticks(velocity, dt)
        speed = float(np.linalg.norm(self._body.centre_of_mass_jacobian(q) @ velocity))
        ticks = max(ticks, ceil(min((self._height/9.81)**0.5, speed/SOFT)/dt-1e-9))
        if ticks > LONGEST:
            return False
        if ticks > 1:
            targets, at = self._targets[: ticks + SPARE_TICKS], q
            for tick, place in enumerate(self._places[: len(targets)]):
                at = self._body.integrate(at, max(1.0 - (tick + 1) / ticks, 0.0) * dt * velocity)
                place[:] = at
            self._solver.reset(q, velocity)
            way = np.concatenate([way, self._solver.clip(targets, dt)])
            if self._ticks(self._solver.velocity, dt) > 1:
                return False
        slip, shortfall = self._losses(way)
        if slip > max(SOLE_M, self._slip + NO_WORSE_M) or shortfall > max(0.0, self._shortfall + NO_WORSE_M):
            return False
        self._way, self._at, self._known, self._velocity = way, 0, True, velocity
        if slip > SOLE_M or shortfall > 0.0:
            # What is measured against only ever falls: many small steps may not add up.
            here = self._losses(q[None])
            slip, shortfall = min(self._slip, here[0]), min(self._shortfall, here[1])
        self._slip, self._shortfall = slip, shortfall
        return True

    def _ticks(self, velocity: FloatArray, dt: float) -> int:
        """Ticks in which all joints come to rest, braking in proportion: as many as the slowest of them needs."""
        return ceil(float(np.abs(velocity[self._joints] * self._slowness).max()) / dt - 1e-9)

    def has_trajectory(self, dt: float) -> bool:
        """Return whether there is a stop trajectory to follow; it is computed where it is not known yet."""
        return self._known or self._finds_trajectory(self._way[0], self._velocity, dt)

    def follow(self, dt: float) -> tuple[FloatArray, FloatArray] | None:
        """Return the next posture (nq,) on the last stop trajectory, and its velocity (nv,) in rad/s and m/s; at its
        end the robot stands.

        None: no trajectory is known, and none is found now.
        """
        if not self.has_trajectory(dt):
            return None
        before = self._way[self._at]
        self._at = min(self._at + 1, len(self._way) - 1)
        now = self._way[self._at]
        self._velocity = self._body.difference(before, now) / dt
        return now, self._velocity

    def brake(self, dt: float) -> FloatArray:
        """The next posture (nq,) where no trajectory is known: all joints brake in proportion, whatever becomes of the
        soles. A caller that takes it calls `begin` from there."""
        left = 1.0 - 1.0 / max(self._ticks(self._velocity, dt), 1)
        return self._body.integrate(self._way[self._at], left * dt * self._velocity)

    def _losses(self, way: FloatArray) -> tuple[float, float]:
        """Most that a corner of a sole is off (m), and that the centre of mass falls short of its margin (m)."""
        off, inside = self._footing.losses(way)
        return off, BALANCE_M - inside


def _solver(body: BodyModel, limits: JointLimits, stance: Stance, edges: int) -> Solver:
    """Soles first, then balance, then where braking in proportion leads."""
    planted = []
    for sole in stance.soles:
        frame = sole.frame
        planted += [
            Task.position(frame.body, as_vector(frame.position)),
            Task.orientation(frame.body, as_quat(frame.quat)),
        ]
    return Solver(
        body.solver_body(),
        [planted, [Task.support(edges)], [Task.posture(np.ones(body.nv))]],
        lower=limits.lower,
        upper=limits.upper,
        max_velocity=limits.max_velocity,
        max_acceleration=limits.max_acceleration,
        locked=np.zeros(body.nv, dtype=bool),
        n_ik=1,
        damping=0.0,
    )


def _spread(outline: FloatArray) -> list[int]:
    """The corners of an outline (c, 2) that are farthest along its diagonals: enough to see a sole move or tilt."""
    return sorted({int(np.argmax(outline @ np.array(way))) for way in ((1, 1), (1, -1), (-1, 1), (-1, -1))})


def _targets(solver: Solver, stance: Stance, edges: FloatArray) -> FloatArray:
    targets = np.zeros(solver.target_size)
    planted = [goal for sole in stance.soles for goal in (sole.position, sole.orientation)]
    goals = [(0, index, goal) for index, goal in enumerate(planted)]
    goals += [(1, 0, half_spaces(edges).ravel()), (2, 0, stance.q)]
    for level, task, goal in goals:
        start, stop = solver.target_slice(level, task)
        targets[start] = 1.0
        targets[start + 1 : stop] = goal
    return targets
