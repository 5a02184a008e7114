"""Whole-body stop: how a robot on its soles comes to rest from a posture.

Joints that each keep within their own limits may still be unable to stop together: where one must brake hard, others
would have to brake harder to keep the soles in place. So a goal comes with the path of its stop, and the gate verifies
both (`retarget.safety.gate`).
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
    """How a robot comes to rest. postures (k, nq): the one from which it stops, and then tick by tick to rest. footing:
    where its soles are planted; None: it has none. carries (k, 2): which of two soles do, of a robot that walks; None:
    all do."""

    postures: FloatArray
    footing: Footing | None = None
    carries: BoolArray | None = None


LONGEST = 100
"""Most ticks of a stop: a robot that takes longer is not at rest at the end of its path, and the gate refuses it."""
MASS = 40.0
"""A centre of mass that is off by its height over the soles weighs as much as a joint of a leg that is off by so many
rad: where legs move the mass, it goes where it should."""
OTHERS = 100.0
"""Weight of a joint that carries nothing beside one of a leg, in squares: arms brake in proportion, and do not swing to
brake the mass. With 1, more stops are found, but Poppy, whose ankles do not roll, falls in 01_01 with mass."""


class WholeBodyStop:
    """Plans the stops of a robot on its soles.

    All joints brake in proportion, so that the body goes on along its way, and soles and mass with it. Joints that each
    braked as hard as they can would come to rest one after the other: where the motions of trunk and legs had cancelled
    out, the mass would be thrown.
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
        """limits (nv,): whose ranges a stop keeps. widest (nv,): of the servos, whose speeds and accelerations it may
        use. carrying (nv,): the root and the joints of the legs. tips: a robot whose mass in motion would tip it; the
        mass of another brakes with its joints."""
        self._body, self._stance, self._carrying = body, stance, carrying
        self._height = float(body.solver_body().centre_of_mass(stance.q[None])[0, 2])
        self._pendulum = sqrt(self._height / GRAVITY) if tips else 0.0
        self._limits = JointLimits(limits.lower, limits.upper, widest.max_velocity, widest.max_acceleration)
        self._solver = self._make_solver()
        self.footing = footing(body.solver_body(), stance.soles) if stance.soles else None
        """Where the soles are planted, in the world of the stance."""
        self._last: tuple[FloatArray, FloatArray, StopPath] | None = None

    def path(self, q: FloatArray, velocity: FloatArray, dt: float) -> StopPath:
        """The path to rest from posture q (nq,), moving at velocity (nv,) in rad/s and m/s, in ticks of `dt` s: soles
        stay where they are, and mass and all joints brake in proportion as nearly as they can."""
        # It is asked for twice: with the goal, and for the observers of the next tick.
        if self._last is not None:
            at, moved, known = self._last
            if np.array_equal(at, q) and np.array_equal(moved, velocity):
                return known
        self._solver.reset(q, velocity)
        postures = np.concatenate([q[None], self._solver.brake(dt, LONGEST, pendulum=self._pendulum)])
        self._last = q, velocity, StopPath(postures, self.footing)
        return self._last[2]

    def _make_solver(self) -> Solver:
        """Soles first, then the centre of mass beside joints."""
        body, limits = self._body, self._limits
        frames = [sole.frame for sole in self._stance.soles]
        places = [Task.position(frame.body, as_vector(frame.position)) for frame in frames]
        planted = places + [Task.orientation(frame.body) for frame in frames]
        weights = np.where(self._carrying, 1.0, OTHERS)
        return Solver(
            body.solver_body(),
            [planted, [Task.centre_of_mass(weight=(MASS / self._height,) * 3), Task.posture(weights)]],
            lower=limits.lower,
            upper=limits.upper,
            max_velocity=limits.max_velocity,
            max_acceleration=limits.max_acceleration,
            locked=np.zeros(body.nv, dtype=bool),
            n_ik=1,
            damping=0.0,
        )
