"""The gantry: a rope from a point straight above the robot's hook, which pulls and never pushes, and straps that damp
its swinging."""

from typing import Any

import numpy as np

from retarget.body import Frame
from retarget.rotations import FloatArray

__all__ = ["add_rope", "damp_swinging"]

ROPE, HOOK, TOP = "physics_rope", "physics_hook", "physics_rope_top"
SWING_DAMPING = 0.5
"""Of the straps, N s/m per kg of robot."""
TURN_DAMPING = 0.01
"""The same for turns, N m s/rad per kg."""
GRAVITY = 9.81  # [m/s^2]


def add_rope(spec: Any, link: str, frame: Frame, *, at: FloatArray, length: float) -> None:
    """Hang a body by the hook `frame` on `link`, which begins `at` (3,) m, world, from a rope of `length` m."""
    spec.body(link).add_site(name=HOOK, pos=frame.position)
    spec.worldbody.add_site(name=TOP, pos=at + np.array([0.0, 0.0, length]))
    rope = spec.add_tendon(name=ROPE)
    rope.limited, rope.range = True, [0.0, length]
    rope.solref_limit = [0.02, 1.0]
    rope.wrap_site(TOP)
    rope.wrap_site(HOOK)


def damp_swinging(model: Any, weight: float) -> None:
    """Let the straps take energy from a hanging robot of `weight` N, whose free joint is the first."""
    mass = weight / GRAVITY
    model.dof_damping[:3] = SWING_DAMPING * mass
    model.dof_damping[3:6] = TURN_DAMPING * mass
