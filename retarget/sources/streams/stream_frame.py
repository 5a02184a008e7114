"""The frame that every live stream is decoded into: poses of one datagram by the sender's names, in world axes.

A new protocol needs a decoder here (`vrchat.py` is the shortest), its axes in `skeletons.yaml`, its address in
`live/address.py`, its sensors in `live/roles.py`, a row in `live/open_stream.py`, and its first bytes in
`datagram_kinds.py`; `docs/live.md` and the help in `cli/run.py` list the addresses. Its tests: the maker's datagrams,
and each field cut short, too long, NaN or repeated.
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
TOO_LONG = "datagram longer than 64 KiB"
SENT_TWICE = "pose sent twice in one datagram"
MAX_POSES = 256
"""Poses of one datagram that are used; further ones are dropped."""


@dataclass(frozen=True, slots=True, eq=False)
class StreamFrame:
    """The poses of one datagram, all of one performer, in the world (REP-103: x forward, y left, z up).

    names: the sender's names of k poses, each once. position (k, 3) m and orientation (k, 4) wxyz: NaN where not sent.
    tracked (k,): the sender's mark. stamp: s of the sender's clock; number: of the frame; both as sent (they may jump,
    wrap or repeat). camera: True for a camera's poses, which are rare and already smoothed.
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
        assert self.tracked.dtype == np.bool_, f"tracked has type {self.tracked.dtype}, not bool"


@dataclass(eq=False)
class Dropped:
    """Counts of unused data by reason. Reasons are constants of the decoder, never text from outside."""

    reasons: Counter[str] = field(default_factory=Counter)

    def note(self, reason: str, times: int = 1) -> None:
        """Add to the count of a reason."""
        if times:
            self.reasons[reason] += times

    @property
    def count(self) -> int:
        """Sum over all reasons."""
        return self.reasons.total()


class StreamDecoder(Protocol):
    """Decoder of one sender's datagrams. Its state is bounded, and it reads no clock."""

    dropped: Dropped

    def decode(self, datagram: bytes) -> list[StreamFrame]:
        """The frames of one datagram, usually one. Never raises: unusable data are counted in `dropped`."""
        ...


@runtime_checkable
class SkeletonSender(Protocol):
    """A decoder whose sender also sends the performer's joints at rest."""

    def rest_of(self, names: Sequence[str]) -> Skeleton | None:
        """The skeleton whose bones have poses of these names; None if it was not sent."""
        ...


@dataclass(frozen=True, eq=False)
class Convention:
    """Axes and length unit of a sender, and their conversion to REP-103.

    x, y, z: directions of its axes ("right", "up", ...). metres: per length unit. With M the signed permutation of the
    axes, a position p becomes M p. The vector part v of a quaternion becomes det(M) M v, so left-handed senders convert
    too.
    """

    name: str
    x: str
    y: str
    z: str
    metres: float = 1.0

    @cached_property
    def _matrix(self) -> FloatArray:
        """The sender's axes (3, 3) as rows in REP-103."""
        rows = np.stack([_DIRECTIONS[word] for word in (self.x, self.y, self.z)])
        assert np.array_equal(matmul(rows, rows.T), np.eye(3)), f"{self.name}: the axes are not at right angles"
        return rows

    @cached_property
    def _turned(self) -> FloatArray:
        """The same for axes of rotation: det(M) M."""
        return self._matrix * dot(np.cross(self._matrix[0], self._matrix[1]), self._matrix[2])

    @cached_property
    def _same(self) -> bool:
        return np.array_equal(self._matrix, np.eye(3))

    def positions(self, positions: ArrayLike) -> FloatArray:
        """Positions (..., 3) in the sender's axes and unit -> (..., 3) m, REP-103; the same array if they agree."""
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


MAX_COORDINATE = 1e6
"""Largest coordinate: beyond, in any unit from millimetres up, it is outside of any room."""

LEAST_SQUARE = (1.0 - NORM_TOLERANCE) * (1.0 - NORM_TOLERANCE)
MOST_SQUARE = (1.0 + NORM_TOLERANCE) * (1.0 + NORM_TOLERANCE)
"""Bounds of the squared norm of an accepted quaternion."""


def unusable(position: FloatArray, orientation: FloatArray) -> BoolArray:
    """Mask of the k poses, position (k, 3) and orientation (k, 4), that are not finite, too far away, or no
    rotation."""
    square = squares(orientation)
    # Comparisons with NaN are False, so usable poses are selected.
    good = np.all(np.abs(position) <= MAX_COORDINATE, axis=1) & (square >= LEAST_SQUARE) & (square <= MOST_SQUARE)
    return np.asarray(~good)


def make_unit(position: FloatArray, orientation: FloatArray) -> BoolArray:
    """Normalise quaternions (k, 4) in place and set unusable poses to NaN. Returns the mask of these, (k,)."""
    bad = unusable(position, orientation)
    if bad.any():
        position[bad], orientation[bad] = np.nan, np.nan
    orientation /= norms(orientation)[:, None]
    return bad
