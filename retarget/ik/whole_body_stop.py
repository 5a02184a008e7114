"""Whole-body stop: the path on which a robot on its soles comes to rest.

Joints within their own limits may be unable to stop together while the soles stay in place. So a goal comes with the
path of its stop, and the gate verifies both.
"""

from dataclasses import dataclass
from math import sqrt

import numpy as np

from retarget._solver import Footing, Solver, Task
from retarget.ik.gravity_torque import GRAVITY
from retarget.ik.support_polygon import Stance, footing
from retarget.model.body import BodyModel, JointLimits
from retarget.rotations import as_vector
from retarget.types import BoolArray, FloatArray


@dataclass(frozen=True, eq=False)
class StopPath:
    """A path to rest. postures (k, nq): the one in which the stop begins, then one a tick. footing: of the
    planted soles. carries (k, 2): mask of the carrying soles of a walking robot; None: all."""

    postures: FloatArray
    footing: Footing | None = None
    carries: BoolArray | None = None


LONGEST_STOP_TICKS = 100  # ticks of a stop; the gate refuses a longer one, as it does not end at rest
MASS_WEIGHT = 40.0
"""The centre of mass, off by its height, weighs as much as a leg joint that is off by this many rad."""
OTHER_WEIGHT = 100.0
"""Weight, in squares, of a joint beside one of a leg: arms must not swing to brake the mass."""


class WholeBodyStop:
    """Plans the stops of a robot on its soles.

    All joints brake in proportion, so soles and mass stay on their paths. Joints that each brake as hard as they can
    would rest one after another and throw the mass.
    """

    def __init__(
        self,
        body: BodyModel,
        limits: JointLimits,
        widest: JointLimits,
        stance: Stance,
        carrying: BoolArray,
        *,
        tips: bool = True,
    ) -> None:
        """limits (nv,): ranges of a stop. widest (nv,): speeds and accelerations of the servos. carrying (nv,): mask of
        the root and the legs. tips: True for a robot that its mass in motion would tip."""
        height = float(body.solver_body().centre_of_mass(stance.q[None])[0, 2])
        self._pendulum = sqrt(height / GRAVITY) if tips else 0.0
        frames = [sole.frame for sole in stance.soles]
        soles = [Task.position(frame.body, as_vector(frame.position)) for frame in frames]
        soles += [Task.orientation(frame.body) for frame in frames]
        mass = Task.centre_of_mass(weight=(MASS_WEIGHT / height,) * 3)
        self._solver = Solver(
            body.solver_body(),
            [soles, [mass, Task.posture(np.where(carrying, 1.0, OTHER_WEIGHT))]],
            lower=limits.lower,
            upper=limits.upper,
            max_velocity=widest.max_velocity,
            max_acceleration=widest.max_acceleration,
            locked=np.zeros(body.nv, dtype=bool),
            n_ik=1,
            damping=0.0,
        )
        self.footing = footing(body.solver_body(), stance.soles) if stance.soles else None
        """Places of the soles, in the world of the stance."""
        self._last: tuple[FloatArray, FloatArray, StopPath] | None = None

    def path(self, q: FloatArray, velocity: FloatArray, dt: float) -> StopPath:
        """The path to rest from posture q (nq,) at velocity (nv,), rad/s and m/s, in ticks of `dt` s."""
        if self._last is not None:
            at, moved, known = self._last
            if np.array_equal(at, q) and np.array_equal(moved, velocity):
                return known
        self._solver.reset(q, velocity)
        postures = np.concatenate([q[None], self._solver.brake(dt, LONGEST_STOP_TICKS, pendulum=self._pendulum)])
        self._last = q, velocity, StopPath(postures, self.footing)
        return self._last[2]
