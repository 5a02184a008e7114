"""A robot on its soles that can always stop there.

Joints that each keep within their own limits may still be unable to stop together: where one must brake hard, the others
would have to brake harder to keep the soles in place. So before a posture is taken, the robot is stopped from it in
thought, as fast as it can with soles planted; if soles or balance would be lost on the way, the posture is not taken,
and the last way to a stop that was found good is followed instead. From rest on, all that is sent lies on such ways.
"""

import numpy as np

from retarget._solver import Solver, Task
from retarget.body import BodyModel
from retarget.frames import BoolArray
from retarget.hierarchy import JointLimits
from retarget.rotations import FloatArray
from retarget.stance import Stance
from retarget.support import support_distance

__all__ = ["Stopping"]

SOLE_M = 0.001
"""How far (m) a corner of a sole may be from its place on the way to a stop."""
BALANCE_M = 0.003
"""How far (m) inside the soles' outline the centre of mass stays on the way to a stop."""
NO_WORSE_M = 1e-5
"""What is already beyond these bounds may go on, if it gets worse by no more than this, m."""
ITERATIONS = 2
"""Of the solver, per tick of the way."""


class Stopping:
    """Ways to a stop: `admits` tells whether there is one from a posture, `follow` goes along the last one found."""

    def __init__(self, body: BodyModel, limits: JointLimits, stance: Stance) -> None:
        """limits (nv,): those that the postures keep."""
        self._body = body.solver_body()
        self._reach = limits.max_acceleration  # (nv,)
        self._outline = stance.edges(0.0)
        soles = stance.soles
        self._links = [sole.frame.body for sole in soles for _ in sole.corners]
        self._local = np.concatenate([sole.corners for sole in soles])
        self._planted = np.column_stack([np.concatenate([sole.outline for sole in soles]), np.zeros(len(self._links))])
        self._solver = _solver(body, limits, stance, len(self._outline))
        self._start, self._stop = self._solver.target_slice(2, 0)
        self._targets = _targets(self._solver, stance, self._outline)
        self._way = stance.q[None]
        self._at = 0
        self._slip = self._shortfall = 0.0

    def begin(self, q: FloatArray) -> None:
        """Start at rest in posture q (nq,), or anew from where no way to a stop is known."""
        self._way, self._at = q[None], 0
        self._slip, self._shortfall = self._losses(self._way)

    def admits(self, q: FloatArray, velocity: FloatArray, dt: float) -> bool:
        """Whether a robot that just got to posture q (nq,), moving at velocity (nv,), can stop from there.

        If so, its way to the stop becomes the one that `follow` goes along.
        """
        ticks = int(np.ceil(float((np.abs(velocity) / (self._reach * dt)).max())))
        way = q[None]
        if ticks > 1:
            self._targets[self._start + 1 : self._stop] = q
            self._solver.reset(q, velocity)
            way = np.concatenate([way, self._solver.clip(np.tile(self._targets, (ticks, 1)), dt)])
        slip, shortfall = self._losses(way)
        if slip > max(SOLE_M, self._slip + NO_WORSE_M) or shortfall > max(0.0, self._shortfall + NO_WORSE_M):
            return False
        self._way, self._at = way, 0
        self._slip, self._shortfall = self._losses(way[:1])
        return True

    def follow(self, dt: float) -> tuple[FloatArray, FloatArray]:
        """The next posture (nq,) on the last way to a stop, and its velocity (nv,); at its end the robot stands."""
        before = self._way[self._at]
        self._at = min(self._at + 1, len(self._way) - 1)
        now = self._way[self._at]
        return now, self._body.difference(before, now) / dt

    def _losses(self, way: FloatArray) -> tuple[float, float]:
        """Most that a corner of a sole is off (m), and that the centre of mass falls short of its margin (m)."""
        corners = self._body.points(way, self._links, self._local)
        off = float(np.sqrt(((corners - self._planted) ** 2).sum(axis=-1).max()))
        return off, BALANCE_M - float(support_distance(self._body.centre_of_mass(way), self._outline).min())


def _solver(body: BodyModel, limits: JointLimits, stance: Stance, edges: int) -> Solver:
    """Soles first, then balance, then to stand still where the robot is."""
    planted = []
    for sole in stance.soles:
        (x, y, z), (qw, qx, qy, qz) = sole.frame.position.tolist(), sole.frame.quat.tolist()
        planted += [Task.position(sole.frame.body, (x, y, z)), Task.orientation(sole.frame.body, (qw, qx, qy, qz))]
    return Solver(
        body.solver_body(),
        [planted, [Task.support(edges)], [Task.posture(np.ones(body.nv))]],
        lower=limits.lower,
        upper=limits.upper,
        max_velocity=limits.max_velocity,
        max_acceleration=limits.max_acceleration,
        locked=np.zeros(body.nv, dtype=bool),
        n_ik=ITERATIONS,
        damping=0.0,
    )


def _targets(solver: Solver, stance: Stance, edges: FloatArray) -> FloatArray:
    targets = np.zeros(solver.target_size)
    soles = stance.soles
    goals = [
        (0, index, goal) for index, goal in enumerate(g for sole in soles for g in (sole.position, sole.orientation))
    ]
    for level, task, goal in [*goals, (1, 0, edges.ravel()), (2, 0, stance.q)]:
        start, stop = solver.target_slice(level, task)
        targets[start] = 1.0
        targets[start + 1 : stop] = goal
    return targets
