"""The axes and units that live streams use, by name, and the one place where each becomes REP-103.

A convention is a signed permutation M of the axes and a length unit. A position p becomes M p. The vector part of a
quaternion is the axis of a turn, which a reflection turns round: it becomes det(M) M v, and w stays. So "turn, then
convert" and "convert, then turn" agree for left-handed senders too.
"""

from dataclasses import dataclass, field
from types import MappingProxyType

import numpy as np
from numpy.typing import ArrayLike

from retarget.errors import UsageError, suggest
from retarget.rotations import FloatArray

__all__ = ["CONVENTIONS", "Convention", "convention"]


@dataclass(frozen=True, eq=False)
class Convention:
    """Axes and length unit of a sender. x, y, z: what its axes mean, in words of the body ("right", "up", ...).

    metres: of one of its length units. yaw_known: False where "forward" is whatever the operator chose; the heading
    is then right up to a turn about the vertical, which calibration finds.
    """

    name: str
    x: str
    y: str
    z: str
    metres: float = 1.0
    yaw_known: bool = True
    handedness: int = field(init=False)
    """1 right-handed, -1 left-handed."""
    _point: FloatArray = field(init=False, repr=False)
    _axis: FloatArray = field(init=False, repr=False)
    _same: bool = field(init=False, repr=False)

    def __post_init__(self) -> None:
        matrix = np.stack([_DIRECTIONS[word] for word in (self.x, self.y, self.z)], axis=1)
        assert np.array_equal(matrix @ matrix.T, np.eye(3)), f"{self.name}: the axes are not at right angles"
        hand = float(np.round(np.linalg.det(matrix)))
        for name, value in (("_point", matrix.T * self.metres), ("_axis", hand * matrix.T), ("handedness", int(hand))):
            object.__setattr__(self, name, value)
        object.__setattr__(self, "_same", bool(np.array_equal(matrix, np.eye(3))))

    def positions(self, positions: ArrayLike) -> FloatArray:
        """Positions (..., 3) of the sender, in its unit -> (..., 3) m, REP-103; the same array if they agree."""
        positions = np.asarray(positions, float)
        if self._same:
            return positions if self.metres == 1.0 else positions * self.metres
        return np.asarray(positions @ self._point)

    def orientations(self, orientations: ArrayLike) -> FloatArray:
        """Quaternions (..., 4) wxyz of the sender -> (..., 4) wxyz, REP-103; norm and sign stay."""
        orientations = np.asarray(orientations, float)
        if self._same:
            return orientations
        out = np.empty(orientations.shape)
        out[..., 0] = orientations[..., 0]
        out[..., 1:] = orientations[..., 1:] @ self._axis
        return out


_DIRECTIONS = {
    word: sign * np.eye(3)[axis]
    for axis, pair in enumerate((("forward", "back"), ("left", "right"), ("up", "down")))
    for word, sign in zip(pair, (1.0, -1.0), strict=True)
}
"""Unit vectors of REP-103."""

CONVENTIONS = MappingProxyType(
    {
        row.name: row
        for row in (
            Convention("rep103", "forward", "left", "up"),
            Convention("unity", "right", "up", "forward"),  # VMC, VRChat OSC and Rokoko too
            Convention("openxr", "right", "up", "back"),  # OpenVR and WebXR too
            Convention("motive_y_up", "left", "up", "forward", yaw_known=False),
            Convention("motive_z_up", "forward", "left", "up", yaw_known=False),
            Convention("xsens", "forward", "left", "up"),  # poses with quaternions (MXTP02)
            Convention("xsens_y_up", "left", "up", "forward"),  # poses with Euler angles (MXTP01)
            Convention("vicon_mm", "forward", "left", "up", metres=1e-3, yaw_known=False),
            Convention("qtm_mm", "forward", "left", "up", metres=1e-3, yaw_known=False),
        )
    }
)
"""By name. Facts: left-handed Unity was measured on SlimeVR's bytes; a y-up lab is turned as y-up motion files are."""


def convention(name: str, *, where: str = "") -> Convention:
    """The convention of this name. Raises UsageError with the nearest names."""
    try:
        return CONVENTIONS[name]
    except KeyError:
        raise UsageError(
            "unknown axes",
            where=where,
            found=repr(name),
            allowed=", ".join(CONVENTIONS),
            next_step=suggest(name, CONVENTIONS),
        ) from None
