"""Sensor frames, which every reader yields: sensors over time, and where known the whole body and its rest skeleton.

World frame REP-103 (x forward, y left, z up), metres, seconds, quaternions wxyz. Arrays are float64 and read-only.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise
from math import fsum

import numpy as np
from numpy.typing import ArrayLike, NDArray

from retarget import rotations
from retarget.arithmetic import norm
from retarget.errors import UsageError, suggest
from retarget.types import BoolArray, FloatArray

SNAP = 1e-9
"""A time within this share of a frame interval of a frame is that frame, without interpolation."""


@dataclass(frozen=True)
class Instants:
    """n times on a clock of T frames: the neighbouring frames, and the share from one to the other, 0 to below 1.

    exact: true at the time of frame `before`.
    """

    before: NDArray[np.intp]
    after: NDArray[np.intp]
    share: FloatArray
    exact: NDArray[np.bool_]


def locate(clock: FloatArray, time: FloatArray) -> Instants:
    """Find times (n,) s on a strictly rising clock (T,) s, clipped to its ends."""
    held = np.clip(time, clock[0], clock[-1])
    before = np.clip(np.searchsorted(clock, held, side="right") - 1, 0, len(clock) - 1)
    after = np.minimum(before + 1, len(clock) - 1)
    share = (held - clock[before]) / np.where(after > before, clock[after] - clock[before], 1.0)
    before = np.where(share > 1.0 - SNAP, after, before)
    share = np.where((share < SNAP) | (share > 1.0 - SNAP), 0.0, share)
    return Instants(before, np.minimum(before + 1, len(clock) - 1), share, share == 0.0)


def along_lines(track: FloatArray, at: Instants) -> FloatArray:
    """Linear interpolation (n, k, 3) of positions (T, k, 3); NaN if a used neighbour is NaN."""
    a, b = track[at.before], track[at.after]
    return np.where(at.exact[:, None, None], a, a + at.share[:, None, None] * (b - a))


def along_arcs(track: FloatArray, at: Instants) -> FloatArray:
    """Interpolation (n, k, 4) of orientations (T, k, 4) along short arcs; NaN if a used neighbour is NaN."""
    a, b = track[at.before], track[at.after]
    share = np.broadcast_to(at.share[:, None], a.shape[:2])
    return np.where(at.exact[:, None, None], a, rotations.slerp(a, b, share))


def valid_at(valid: NDArray[np.bool_], at: Instants) -> NDArray[np.bool_]:
    """Validity (n, k) of interpolated values: that of all used neighbours (T, k)."""
    return np.asarray(valid[at.before] & (at.exact[:, None] | valid[at.after]))


def _both(*parts: str) -> tuple[str, ...]:
    return tuple(f"{side}_{part}" for part in parts for side in "lr")


SENSORS: tuple[str, ...] = (
    "head",
    *_both("wrist", "ankle"),
    "pelvis",
    "chest",
    *_both("knee", "elbow", "shoulder", "hip", "toe"),
)
"""Canonical sensor names. The first five are the default set."""

JOINTS: tuple[str, ...] = (
    *("pelvis", "spine", "chest", "neck", "head"),
    *_both("collar", "shoulder", "elbow", "wrist", "hip", "knee", "ankle", "toe", "hand"),
)
"""Canonical joint names."""

REFLECT_POSITION = np.array([1.0, -1.0, 1.0])
REFLECT_QUATERNION = np.array([1.0, -1.0, 1.0, -1.0])
"""Factors of (x, y, z) and (w, x, y, z) for a reflection in the plane y = 0."""


@dataclass(frozen=True)
class JointTracks:
    """Joint centres (T, m, 3) m over time, by canonical joint names; NaN if unknown."""

    names: tuple[str, ...]
    position: FloatArray

    def __post_init__(self) -> None:
        _freeze(self, "position", (None, len(self.names), 3))

    def of(self, name: str) -> FloatArray:
        """Track (T, 3) of one joint. Raises UsageError."""
        return np.asarray(self.position[:, _index(name, self.names, "joint")])


@dataclass(frozen=True)
class Skeleton:
    """Joint centres (m, 3) m of the rest pose of a file, by canonical joint names.

    It is upright and faces x, with the pelvis at the origin. Arms and legs are as in the file.
    """

    names: tuple[str, ...]
    position: FloatArray

    def __post_init__(self) -> None:
        _freeze(self, "position", (len(self.names), 3))

    def of(self, name: str) -> FloatArray:
        """Rest position (3,) of one joint. Raises UsageError."""
        return np.asarray(self.position[_index(name, self.names, "joint")])

    def distance(self, first: str, second: str) -> float:
        """Straight distance, m, between two joints."""
        return norm(self.of(first) - self.of(second))


@dataclass(frozen=True)
class SampleTimes:
    """Times of a live sample, s, NaN if unknown. captured, arrived: of the newest frame. shown: of capture of the poses
    in the sample, earlier by the playout delay."""

    captured: float = np.nan
    arrived: float = np.nan
    shown: float = np.nan


NO_TIMES = SampleTimes()
"""Times of a sample that is not live."""


@dataclass(frozen=True)
class SensorSample:
    """The k sensors at one instant: position (k, 3) m, orientation (k, 4) wxyz, valid (k,); NaN if invalid."""

    names: tuple[str, ...]
    position: FloatArray
    orientation: FloatArray
    valid: BoolArray
    times: SampleTimes = NO_TIMES

    @classmethod
    def of(
        cls, positions: Mapping[str, ArrayLike | None], orientations: Mapping[str, ArrayLike | None] | None = None
    ) -> "SensorSample":
        """A sample of positions (3,) m, None for a lost sensor, and known orientations (4,) wxyz. Raises UsageError."""
        names = tuple(positions) if isinstance(positions, Mapping) else ()
        for name in names:
            _index(name, SENSORS, "sensor", where="SensorSample.of, positions")
        for name in orientations if isinstance(orientations, Mapping) else ():
            _index(name, names, "sensor", where="SensorSample.of, orientations")
        position = _rows("positions", positions, names, 3)
        orientation = _rows("orientations", {} if orientations is None else orientations, names, 4)
        return cls(names, position, orientation, np.asarray(np.isfinite(position).all(axis=1)))


def _rows(argument: str, given: Mapping[str, ArrayLike | None], names: tuple[str, ...], numbers: int) -> FloatArray:
    """Rows (k, numbers) by name, NaN for None. Raises UsageError for anything else."""
    unknown = np.full(numbers, np.nan)
    try:
        found = [given.get(name) for name in names]
        rows = np.array([unknown if one is None else one for one in found], float)
    except (AttributeError, TypeError, ValueError):
        rows = unknown
    if rows.shape != (len(names), numbers):
        raise UsageError(
            f"no {argument} of sensors",
            where=f"SensorSample.of, {argument}",
            found=f"{given}"[:120],
            allowed=f"{numbers} numbers by the name of each sensor, None for one that is lost",
        )
    return rows


@dataclass(frozen=True)
class SensorFrames:
    """Sensors of one performer over time.

    time (T,) s, from 0, strictly rising. names: k canonical sensor names. position (T, k, 3) m, world, NaN if invalid.
    orientation (T, k, 4) wxyz, world, NaN if unknown or invalid: that of the segment behind the sensor's joint (wrist:
    hand, elbow: forearm, shoulder: upper arm, hip: thigh, knee: shank, ankle and toe: foot). It is the identity for a
    performer who stands upright, faces x, and lets the arms hang, thumbs forward. rate_hz: nominal. notes: warnings for
    the user. stature: m, if the user gave it.
    """

    time: FloatArray
    names: tuple[str, ...]
    position: FloatArray
    orientation: FloatArray
    valid: BoolArray
    joints: JointTracks | None = None
    skeleton: Skeleton | None = None
    source: str = ""
    rate_hz: float = 0.0
    notes: tuple[str, ...] = field(default=())
    stature: float | None = None

    def __post_init__(self) -> None:
        frames, sensors = len(self.time), len(self.names)
        assert frames > 0 and np.all(np.diff(self.time) > 0.0), "time must rise strictly"
        assert len(set(self.names)) == sensors, "a sensor name occurs twice"
        _freeze(self, "time", (frames,))
        _freeze(self, "position", (frames, sensors, 3))
        _freeze(self, "orientation", (frames, sensors, 4))
        _freeze(self, "valid", (frames, sensors), bool)
        assert self.joints is None or len(self.joints.position) == frames, "joints have another number of frames"

    def __len__(self) -> int:
        return len(self.time)

    @property
    def duration_s(self) -> float:
        """Seconds from the first frame to the last."""
        return float(self.time[-1] - self.time[0])

    def index(self, name: str) -> int:
        """Column of a sensor. Raises UsageError."""
        return _index(name, self.names, "sensor")

    def select(self, names: Sequence[str]) -> "SensorFrames":
        """Only these sensors, in this order. Raises UsageError."""
        return self._columns(tuple(names), [self.index(name) for name in names])

    def cut(self, start: float | None = None, end: float | None = None) -> "SensorFrames":
        """The frames from `start` to `end` (s, both included), from time 0 on. Raises UsageError if there are none."""
        first = 0.0 if start is None else float(start)
        last = float(self.time[-1]) if end is None else float(end)
        margin = SNAP * max(self.duration_s, 1.0)
        rows = np.flatnonzero((self.time >= first - margin) & (self.time <= last + margin))
        if not (first <= last < np.inf and rows.size):
            raise UsageError(
                "no frame between start and end",
                found=f"{first:g} to {last:g} s",
                allowed=f"0 to {self.time[-1]:.3f} s, start before end",
            )
        return self.at_rows(rows, self.time[rows] - self.time[rows[0]])

    def at_rows(self, rows: Sequence[int] | NDArray[np.integer], time: FloatArray) -> "SensorFrames":
        """The frames of these rows, at other times (s), which rise strictly."""
        joints = self.joints
        return replace(
            self,
            time=time,
            position=self.position[rows],
            orientation=self.orientation[rows],
            valid=self.valid[rows],
            joints=None if joints is None else JointTracks(joints.names, joints.position[rows]),
        )

    def mirror(self) -> "SensorFrames":
        """Left and right swapped: positions reflected at the x-z plane, names of the other side."""
        names, columns = _mirror_order(self.names)
        joints, skeleton = self.joints, self.skeleton
        if joints is not None:
            joint_names, order = _mirror_order(joints.names)
            joints = JointTracks(joint_names, joints.position[:, order] * REFLECT_POSITION)
        if skeleton is not None:
            joint_names, order = _mirror_order(skeleton.names)
            skeleton = Skeleton(joint_names, skeleton.position[order] * REFLECT_POSITION)
        there = self._columns(names, columns)
        return replace(
            there,
            position=there.position * REFLECT_POSITION,
            orientation=there.orientation * REFLECT_QUATERNION,
            joints=joints,
            skeleton=skeleton,
        )

    def sample(self, time: float) -> SensorSample:
        """The sensors at `time` (s): see `resample`."""
        there = self.resample([time])
        return SensorSample(there.names, there.position[0], there.orientation[0], there.valid[0])

    def resample(self, time: ArrayLike) -> "SensorFrames":
        """The same motion on another clock `time` (n,) s, strictly rising, whose rate is the new nominal rate.

        At the time of a frame, that frame is returned bit for bit. The first and the last one are held beyond the ends.
        """
        time = np.asarray(time, float)
        at = locate(self.time, time)
        joints = self.joints
        return replace(
            self,
            time=time,
            position=along_lines(self.position, at),
            orientation=along_arcs(self.orientation, at),
            valid=valid_at(self.valid, at),
            joints=None if joints is None else JointTracks(joints.names, along_lines(joints.position, at)),
            rate_hz=float((time.size - 1) / (time[-1] - time[0])) if time.size > 1 else self.rate_hz,
        )

    def _columns(self, names: tuple[str, ...], columns: Sequence[int]) -> "SensorFrames":
        return replace(
            self,
            names=names,
            position=self.position[:, columns],
            orientation=self.orientation[:, columns],
            valid=self.valid[:, columns],
        )


def mirrored_name(name: str) -> str:
    """The name on the other side of the body: l_wrist for r_wrist. A middle part keeps its name."""
    return {"l_": "r_", "r_": "l_"}.get(name[:2], name[:2]) + name[2:]


def _mirror_order(names: tuple[str, ...]) -> tuple[tuple[str, ...], list[int]]:
    """Names after mirroring, in the same order if both sides are present, and their columns."""
    mirrored = tuple(mirrored_name(name) for name in names)
    new_names = names if set(mirrored) == set(names) else mirrored
    return new_names, [mirrored.index(name) for name in new_names]


def _index(name: str, names: tuple[str, ...], what: str, *, where: str = "") -> int:
    if name not in names:
        raise UsageError(
            f"unknown {what}",
            where=where,
            found=repr(name),
            allowed=", ".join(names),
            next_step=suggest(name, names),
        )
    return names.index(name)


def _freeze(owner: object, name: str, shape: tuple[int | None, ...], dtype: type = float) -> None:
    """Check the shape of a field (None: any) and store it contiguous and read-only."""
    given = getattr(owner, name)
    array: NDArray[np.generic] = np.ascontiguousarray(given, dtype)
    assert array.ndim == len(shape) and all(
        want in (None, got) for want, got in zip(shape, array.shape, strict=True)
    ), f"{name} has shape {array.shape}, not {shape}"
    if array is given and array.flags.writeable:
        array = array.view()
    array.flags.writeable = False
    object.__setattr__(owner, name, array)


HEAD_CENTRE, ANKLE = 0.936, 0.039
"""Heights of the centre of the head (that of the eyes) and of the ankle by stature (Drillis, Contini)."""


def stature(skeleton: Skeleton) -> float | None:
    """Height in the skeleton's unit, along its bones, so in any rest pose. None without a leg, the neck or the head."""
    needed = ("l_hip", "r_hip", "l_knee", "l_ankle", "neck", "head")
    if not set(needed) <= set(skeleton.names):
        return None
    trunk = [0.5 * (skeleton.of("l_hip") + skeleton.of("r_hip"))]
    trunk += [skeleton.of(name) for name in ("chest", "neck", "head") if name in skeleton.names]
    leg = skeleton.distance("l_hip", "l_knee") + skeleton.distance("l_knee", "l_ankle")
    return (leg + fsum(norm(b - a) for a, b in pairwise(trunk))) / (HEAD_CENTRE - ANKLE)


# The grid is finer than any sensor. The last 30 bits of interpolated numbers hold no information, but do not compress.

STEP_M = 2.0**-20
"""Step of positions, a micrometre."""
STEP_TURN = 2.0**-22
"""Step of the entries of a quaternion, half a microradian."""


def on_grid(sensors: SensorSample) -> SensorSample:
    """The same sensors at the nearest points of the grid; NaN stays NaN."""
    return replace(
        sensors,
        position=np.rint(sensors.position / STEP_M) * STEP_M,
        orientation=np.rint(sensors.orientation / STEP_TURN) * STEP_TURN,
    )
