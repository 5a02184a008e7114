"""How fast the joints of a human can move, as data.

There are no acceleration limits: those of a human depend on muscle, load and posture, a recorded sensor is the motion
that really happened, and a limit would only make the virtual human lag behind it. A robot has both kinds.
"""

import numpy as np

from retarget.body import BodyModel
from retarget.joint_limits import JointLimits
from retarget.joint_weights import joint_weights

__all__ = ["human_limits"]

FASTEST: tuple[tuple[str, float], ...] = (
    ("root_x", 15.0),
    ("root_y", 15.0),
    ("root_z", 15.0),
    ("root_rx", 20.0),
    ("root_ry", 20.0),
    ("root_rz", 20.0),
    ("spine", 15.0),
    ("chest", 15.0),
    ("neck", 15.0),
    ("collar", 15.0),
    ("shoulder", 25.0),
    ("elbow", 25.0),
    ("wrist", 25.0),
    ("hip", 20.0),
    ("knee", 25.0),
    ("ankle", 20.0),
)
"""m/s and rad/s: about what people reach in sport, throwing excepted, so that no limit shapes an ordinary motion."""


def human_limits(body: BodyModel) -> JointLimits:
    """Anatomical positions, the speeds above, no limit on acceleration."""
    return JointLimits(
        lower=body.lower,
        upper=body.upper,
        max_velocity=joint_weights(body, FASTEST, default=15.0),
        max_acceleration=np.full(body.nv, np.inf),
    )
