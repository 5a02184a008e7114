"""Whole-body stop: a robot on its soles can stop there at any tick.

Joints that each keep within their own limits may still be unable to stop together: where one must brake hard, others
would have to brake harder to keep the soles in place. So before a posture is accepted, a stop from it is computed, with
soles planted. If soles or balance would be lost on the way, the posture is not accepted, and the last verified stop
trajectory is followed instead. From rest on, all goals lie on such trajectories, and a stop that is asked for at any
tick goes along one.
"""

from math import ceil, sqrt

import numpy as np

from retarget._solver import Footing, Solver, Task
from retarget.arithmetic import matmul, norm
from retarget.ik.gravity_torque import GRAVITY
from retarget.ik.support_polygon import Stance
from retarget.model.body import BodyModel, JointLimits
from retarget.rotations import as_vector
from retarget.types import BoolArray, FloatArray

SOLE_M = 0.001
"""Distance (m) that a corner of a sole may be from its place on the way to a stop."""
BALANCE_M = 0.003
"""Distance (m) inside the soles' outline that the centre of mass keeps on the way to a stop."""
NO_WORSE_M = 1e-5
"""What is already beyond these bounds may go on, if it gets worse by no more than this, m."""
SPARE_TICKS = 2
"""Ticks beyond those that the slowest joint needs, for soles and balance are kept first."""
BRAKING = 1.0
"""Deceleration (m/s^2) with which the centre of mass can surely be stopped on its soles."""
LONGEST = 100
"""Most ticks of a stop trajectory; a posture that takes longer to stop is not admitted."""
ROUND_OFF = 1e-9
"""Angle (rad) beyond its limit at which a joint that rests there may seem to be."""
MASS = 40.0
"""A centre of mass that is off by its height over the soles weighs as much as a joint of a leg that is off by so many
rad: where legs move the mass, it goes where it should."""
OTHERS = 100.0
"""Weight of a joint that carries nothing beside one of a leg, in squares: arms brake in proportion, and do not swing to
brake the mass. With 1, more stops are found, but Poppy, whose ankles do not roll, falls in 01_01 with mass."""
STANDING = 1e-9
"""Speed (rad/s) below which a leg stands."""


class Stopping:
    """Stop trajectories: `admits` says whether there is one from a posture, `follow` goes along the last one found.

    All joints brake in proportion, so that the body goes on along its way, and soles and mass with it. Joints that each
    braked as hard as they can would come to rest one after the other: where the motions of trunk and legs had cancelled
    out, the mass would be thrown. velocity (nv,): of the robot where it got last, per s; slip: most that a corner of a
    sole is off its place there, m.
    """

    def __init__(
        self, body: BodyModel, limits: JointLimits, widest: JointLimits, stance: Stance, carrying: BoolArray
    ) -> None:
        """limits (nv,): that a stop keeps which begins within them, else `widest` (nv,), those of the servos. carrying
        (nv,): the root and the joints of the legs."""
        self._body = body.solver_body()
        single, columns = body.scalar_joints()
        self._joints = np.flatnonzero(single & np.isfinite(widest.max_acceleration))
        self._slowness = 1.0 / widest.max_acceleration[self._joints]
        self._columns = columns[self._joints]
        self._ends = limits.lower[self._joints] - ROUND_OFF, limits.upper[self._joints] + ROUND_OFF
        self._legs = self._joints[carrying[self._joints]]
        self._height = float(self._body.centre_of_mass(stance.q[None])[0, 2])
        soles = [(sole, _spread(sole.outline)) for sole in stance.soles]
        links = [sole.frame.body for sole, few in soles for _ in few]
        local = np.concatenate([sole.corners[few] for sole, few in soles])
        planted = np.concatenate([sole.outline[few] for sole, few in soles])
        self._footing = Footing(self._body, links, local, np.insert(planted, 2, 0.0, axis=1), stance.edges(0.0))
        ends = JointLimits(limits.lower, limits.upper, widest.max_velocity, widest.max_acceleration)
        self._solvers = [_solver(body, kept, stance, self._height, carrying) for kept in (ends, widest)]
        self._solver = self._solvers[0]
        self.begin(stance.q)

    def begin(self, q: FloatArray, velocity: FloatArray | None = None) -> None:
        """Start anew in posture q (nq,), moving at velocity (nv,) per s; no stop trajectory is known from there."""
        self._way, self._at, self._known = q[None], 0, velocity is None
        self.velocity = np.zeros(self._body.nv) if velocity is None else velocity
        self.slip, self._shortfall = self._losses(self._way)

    def rescale_time(self, change: float) -> None:
        """Let time go by slower from now on (change < 1), or faster (change > 1). Velocities change with it. The known
        stop trajectory stays valid, because it is followed row by row."""
        self.velocity = self.velocity / change

    @property
    def stands(self) -> bool:
        """Whether the legs stand still where the robot got last."""
        return float(np.abs(self.velocity[self._legs]).max(initial=0.0)) < STANDING

    def admits(self, q: FloatArray, velocity: FloatArray, dt: float) -> bool:
        """Return whether a robot that just got to posture q (nq,), moving at velocity (nv,) in rad/s and m/s, can stop
        from there.

        If so, the stop trajectory from there becomes the one that `follow` goes along.
        """
        way = self._in_proportion(q, velocity, dt)
        if way is None:
            return False
        slip, shortfall = self._losses(way)
        if slip > max(SOLE_M, self.slip + NO_WORSE_M) or shortfall > max(0.0, self._shortfall + NO_WORSE_M):
            return False
        self._way, self._at, self._known, self.velocity = way, 0, True, velocity
        if slip > SOLE_M or shortfall > 0.0:
            # What is measured against only ever falls: many small steps may not add up.
            here = self._losses(q[None])
            slip, shortfall = min(self.slip, here[0]), min(self._shortfall, here[1])
        self.slip, self._shortfall = slip, shortfall
        return True

    def _in_proportion(self, q: FloatArray, velocity: FloatArray, dt: float) -> FloatArray | None:
        """Postures (k, nq) from q on, tick by tick, to rest: soles stay where they are, and mass and all joints
        brake in proportion as nearly as they can; None: they cannot come to rest in time."""
        mass_velocity = matmul(self._body.centre_of_mass_jacobian(q), velocity)
        # The mass is braked by BRAKING; a fast one in such a time that its zero-moment point is at its capture point.
        time = min(sqrt(self._height / GRAVITY), norm(mass_velocity) / BRAKING)
        ticks = max(self._ticks(velocity, dt), time / dt)
        if ticks > LONGEST:
            return None
        if ticks <= 1.0:
            return q[None]
        lowest, highest = self._ends
        joints = q[self._columns]
        self._solver = self._solvers[bool(((joints < lowest) | (joints > highest)).any())]
        self._solver.reset(q, velocity)
        way = np.concatenate([q[None], self._solver.brake(ticks, dt, ceil(ticks) - 1 + SPARE_TICKS)])
        return None if self._ticks(self._solver.velocity, dt) > 1.0 else way

    def _ticks(self, velocity: FloatArray, dt: float) -> float:
        """Ticks in which all joints come to rest, braking in proportion: as many as the slowest of them needs."""
        return float(np.abs(velocity[self._joints] * self._slowness).max()) / dt

    def follow(self, dt: float) -> tuple[FloatArray, FloatArray] | None:
        """Return the next posture (nq,) on the last stop trajectory, and its velocity (nv,) in rad/s and m/s; at its
        end the robot stands.

        None: no trajectory is known, and none is found now.
        """
        if not (self._known or self.admits(self._way[0], self.velocity, dt)):
            return None
        before = self._way[self._at]
        self._at = min(self._at + 1, len(self._way) - 1)
        now = self._way[self._at]
        self.velocity = self._body.difference(before, now) / dt
        return now, self.velocity

    def brake(self, dt: float) -> FloatArray:
        """The next posture (nq,) where no trajectory is known: all joints brake in proportion, whatever becomes of the
        soles. A caller that takes it calls `begin` from there."""
        left = 1.0 - 1.0 / max(self._ticks(self.velocity, dt), 1.0)
        return self._body.integrate(self._way[self._at], left * dt * self.velocity)

    def _losses(self, way: FloatArray) -> tuple[float, float]:
        """Most that a corner of a sole is off (m), and that the centre of mass falls short of its margin (m)."""
        off, inside = self._footing.losses(way)
        return off, BALANCE_M - inside


def _solver(body: BodyModel, limits: JointLimits, stance: Stance, height: float, carrying: BoolArray) -> Solver:
    """Soles first, then the centre of mass, at this height (m), beside joints."""
    frames = [sole.frame for sole in stance.soles]
    places = [Task.position(frame.body, as_vector(frame.position)) for frame in frames]
    planted = places + [Task.orientation(frame.body) for frame in frames]
    return Solver(
        body.solver_body(),
        [planted, [Task.centre_of_mass(weight=(MASS / height,) * 3), Task.posture(np.where(carrying, 1.0, OTHERS))]],
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
    return sorted({int(np.argmax(outline[:, 0] * x + outline[:, 1] * y)) for x in (-1, 1) for y in (-1, 1)})
