"""What posture is natural at the height that the head has: upright, or more and more of a crouch.

Hips, knees and the lumbar spine bend together when somebody gets down. One reference posture for all heights would
leave it to the stiffness of single joints how; the spine, stiff while standing, would then hardly bend at all.
"""

import numpy as np

from retarget.human import Human
from retarget.human_dimensions import POINTS
from retarget.human_posture import PostureReader
from retarget.rotations import FloatArray

__all__ = ["Crouch"]


class Crouch:
    """Between two postures of the human, by how high the head is above the feet."""

    def __init__(self, human: Human, *, upright: str, lowered: str) -> None:
        postures = np.stack([human.posture(upright), human.posture(lowered)])
        self._upright = postures[0]
        self._change = postures[1] - postures[0]
        joints = PostureReader(human).joints(postures)
        ankles = [POINTS.index("l_ankle"), POINTS.index("r_ankle")]
        heights = joints[:, POINTS.index("head"), 2] - joints[:, ankles, 2].mean(axis=1)
        self._high, self._low = float(heights[0]), float(heights[1])

    def share(self, height: float) -> float:
        """How much of the crouch belongs to a head `height` m above the ankles: 0 upright, 1 lowered."""
        return min(max((self._high - height) / (self._high - self._low), 0.0), 1.0)

    def posture(self, height: float) -> FloatArray:
        """The posture (nq,) that is natural with the head `height` m above the ankles."""
        return np.asarray(self._upright + self.share(height) * self._change)
