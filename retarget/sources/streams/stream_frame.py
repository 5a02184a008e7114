"""The frame that every live stream is decoded into: poses of one datagram by the sender's names, in world axes.

A new protocol needs a decoder, `retarget/sources/streams/NAME.py` with `decode(datagram) -> list[StreamFrame]`, that
never raises, reads no clock, and bounds everything that it counts (`vrchat.py` is the shortest). Then rows: its axes
here, its address in `retarget/live/address.py` (KINDS), names of sensors in `retarget/live/roles.py`, decoder and
stamps in `retarget/live/open_stream.py`, and how the doctor recognises it in `datagram_kinds.py`. Its
tests: the datagrams of the maker's documentation, and every field cut short, too long, NaN or repeated.
"""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from types import MappingProxyType
from typing import Protocol, runtime_checkable

import numpy as np
from numpy.typing import ArrayLike

from retarget.arithmetic import dot, matmul, norms, squares
from retarget.frames import Skeleton
from retarget.rotations import NORM_TOLERANCE
from retarget.sources.skeletons import TABLES
from retarget.types import BoolArray, FloatArray

MAX_DATAGRAM = 65_536
"""Bytes of the longest datagram that is decoded."""
MAX_POSES = 256
"""Poses of one datagram that are used; further ones are dropped."""


@dataclass(frozen=True, slots=True, eq=False)
class StreamFrame:
    """The poses of one datagram, all of one performer. World REP-103 (x forward, y left, z up).

    names: the sender's own names of k poses, each once. position (k, 3) m and orientation (k, 4) wxyz: NaN where the
    datagram has none. tracked (k,): whether the sender marks the pose as tracked; True where it has no such mark.
    stamp: time of capture, s of the sender's clock, and number: of the frame; both as they came (they may jump, wrap or
    repeat), None where the sender sends none. camera: whether they are of a camera's pictures, which come
    seldom, and are smoothed by their decoder.
    """

    names: tuple[str, ...]
    position: FloatArray
    orientation: FloatArray
    tracked: BoolArray
    stamp: float | None = None
    number: int | None = None
    camera: bool = False

    def __post_init__(self) -> None:
        count = len(self.names)
        shapes = self.position.shape, self.orientation.shape, self.tracked.shape
        assert shapes == ((count, 3), (count, 4), (count,)), f"{count} names, and arrays of shape {shapes}"
        assert self.tracked.dtype == np.bool_, f"tracked is of {self.tracked.dtype}, not of bool"


@dataclass(eq=False)
class Dropped:
    """What was not used, by reason; `reasons` are few and written down in the decoder, never text from outside."""

    reasons: Counter[str] = field(default_factory=Counter)

    def note(self, reason: str) -> None:
        """Count one that was dropped, with its reason."""
        self.reasons[reason] += 1

    @property
    def count(self) -> int:
        """Number of all that was dropped, whatever the reason."""
        return self.reasons.total()


class StreamDecoder(Protocol):
    """Datagrams of one sender in, frames out. It holds bounded state and reads no clock."""

    dropped: Dropped

    def decode(self, datagram: bytes) -> list[StreamFrame]:
        """The frames of one datagram, mostly one. Never raises: what cannot be used is counted in `dropped`."""
        ...


@runtime_checkable
class SkeletonSender(Protocol):
    """A decoder of a sender that also sends the performer's joints at rest."""

    def rest_of(self, names: Sequence[str]) -> Skeleton | None:
        """The skeleton of which poses of these names are bones; None where it was not sent."""
        ...


# The axes and units that live streams use, by name, and the one place where each becomes REP-103.
#
# A convention is a signed permutation M of the axes and a length unit. A position p becomes M p. The vector part of a
# quaternion is the axis of a turn, which a reflection turns round: it becomes det(M) M v, and w stays. So "turn, then
# convert" and "convert, then turn" agree for left-handed senders too.


@dataclass(frozen=True, eq=False)
class Convention:
    """Axes and length unit of a sender. x, y, z: what its axes mean, in words of the body ("right", "up", ...).

    metres: of one of its length units. Where "forward" is whatever the operator chose, the heading is right up to a
    turn about the vertical, which calibration finds.
    """

    name: str
    x: str
    y: str
    z: str
    metres: float = 1.0

    @cached_property
    def _matrix(self) -> FloatArray:
        """(3, 3), the sender's axes as rows in REP-103."""
        rows = np.stack([_DIRECTIONS[word] for word in (self.x, self.y, self.z)])
        assert np.array_equal(matmul(rows, rows.T), np.eye(3)), f"{self.name}: the axes are not at right angles"
        return rows

    @cached_property
    def _turned(self) -> FloatArray:
        """(3, 3), the same for axes of turns, which a reflection (determinant -1) turns round."""
        return self._matrix * dot(np.cross(self._matrix[0], self._matrix[1]), self._matrix[2])

    @cached_property
    def _same(self) -> bool:
        return np.array_equal(self._matrix, np.eye(3))

    def positions(self, positions: ArrayLike) -> FloatArray:
        """Positions (..., 3) of the sender, in its unit -> (..., 3) m, REP-103; the same array if they agree."""
        positions = np.asarray(positions, float)
        turned = positions if self._same else matmul(positions, self._matrix)
        return turned if self.metres == 1.0 else turned * self.metres

    def orientations(self, orientations: ArrayLike) -> FloatArray:
        """Quaternions (..., 4) wxyz of the sender -> (..., 4) wxyz, REP-103; norm and sign stay."""
        orientations = np.asarray(orientations, float)
        if self._same:
            return orientations
        out = np.empty(orientations.shape)
        out[..., 0] = orientations[..., 0]
        out[..., 1:] = matmul(orientations[..., 1:], self._turned)
        return out


_DIRECTIONS = {
    word: sign * np.eye(3)[axis]
    for axis, pair in enumerate((("forward", "back"), ("left", "right"), ("up", "down")))
    for word, sign in zip(pair, (1.0, -1.0), strict=True)
}
"""Unit vectors of REP-103."""

CONVENTIONS = MappingProxyType({name: Convention(name, *row) for name, row in TABLES["axes"].items()})
"""By name."""


# Checks of a pose from outside, before anything is computed from it.

MAX_COORDINATE = 1e6
"""Largest coordinate: a larger one, in any unit from millimetres up, is no place in a room."""

LEAST_SQUARE = (1.0 - NORM_TOLERANCE) * (1.0 - NORM_TOLERANCE)
MOST_SQUARE = (1.0 + NORM_TOLERANCE) * (1.0 + NORM_TOLERANCE)
"""Bounds of the squared norm of a quaternion that is accepted."""


def unusable(position: FloatArray, orientation: FloatArray) -> BoolArray:
    """Mask of those of k poses, position (k, 3) and orientation (k, 4), that are not finite, not in a room, or no
    rotation.

    Values must not exceed float32's, so that squares stay finite.
    """
    square = squares(orientation)
    # Comparisons with NaN are False, so the question is what is good.
    good = np.all(np.abs(position) <= MAX_COORDINATE, axis=1) & (square >= LEAST_SQUARE) & (square <= MOST_SQUARE)
    return np.asarray(~good)


def make_unit(position: FloatArray, orientation: FloatArray) -> BoolArray:
    """Make the quaternions (k, 4) unit, in place, and every pose NaN that is unusable. Returns which are, (k,)."""
    bad = unusable(position, orientation)
    if bad.any():
        position[bad], orientation[bad] = np.nan, np.nan
    orientation /= norms(orientation)[:, None]
    return bad
