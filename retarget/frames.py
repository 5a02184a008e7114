"""Sensor frames, which every reader yields: sensors over time, the whole body where it is known, its rest skeleton.

World frame REP-103 (x forward, y left, z up), metres, seconds, quaternions wxyz. Arrays are float64, C-contiguous and
read-only, so that one recording can be shared by every stage.
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

# Tracks between their frames: positions straight, orientations along the short arc, valid where both ends are.

SNAP = 1e-9
"""A time within this share of a frame interval of a frame is that frame, not a mixture of two."""


@dataclass(frozen=True)
class Instants:
    """n times on a clock of T frames.

    before, after (n): neighbouring frames. share (n): way from one to the other, 0 to below 1. exact (n): the time is
    that of frame `before`, whose values are then returned bit for bit.
    """

    before: NDArray[np.intp]
    after: NDArray[np.intp]
    share: FloatArray
    exact: NDArray[np.bool_]


def locate(clock: FloatArray, time: FloatArray) -> Instants:
    """Find where the times (n,) s lie on a clock (T,) s that rises strictly. Times outside of it are held at its
    ends."""
    held = np.clip(time, clock[0], clock[-1])
    before = np.clip(np.searchsorted(clock, held, side="right") - 1, 0, len(clock) - 1)
    after = np.minimum(before + 1, len(clock) - 1)
    share = (held - clock[before]) / np.where(after > before, clock[after] - clock[before], 1.0)
    before = np.where(share > 1.0 - SNAP, after, before)
    share = np.where((share < SNAP) | (share > 1.0 - SNAP), 0.0, share)
    return Instants(before, np.minimum(before + 1, len(clock) - 1), share, share == 0.0)


def along_lines(track: FloatArray, at: Instants) -> FloatArray:
    """Interpolate positions (n, k, 3) m of a track (T, k, 3) linearly; NaN where a neighbour that counts is NaN."""
    a, b = track[at.before], track[at.after]
    return np.where(at.exact[:, None, None], a, a + at.share[:, None, None] * (b - a))


def along_arcs(track: FloatArray, at: Instants) -> FloatArray:
    """Orientations (n, k, 4) wxyz of a track (T, k, 4); NaN where a neighbour that counts is NaN."""
    a, b = track[at.before], track[at.after]
    share = np.broadcast_to(at.share[:, None], a.shape[:2])
    return np.where(at.exact[:, None, None], a, rotations.slerp(a, b, share))


def valid_at(valid: NDArray[np.bool_], at: Instants) -> NDArray[np.bool_]:
    """Validity (n, k) at instants between the frames of a track with validity (T, k)."""
    return np.asarray(valid[at.before] & (at.exact[:, None] | valid[at.after]))


def _both(*parts: str) -> tuple[str, ...]:
    """Names of paired body parts, left before right."""
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
"""Factors of (x, y, z) and (w, x, y, z) that reflect in the plane y = 0: y changes its sign, and turns about x and z
do."""


@dataclass(frozen=True)
class JointTracks:
    """Joint centres of the whole body over time, as far as the source has them.

    names: m canonical joint names, only those that the source has. position (T, m, 3) m, world; NaN where unknown.
    """

    names: tuple[str, ...]
    position: FloatArray

    def __post_init__(self) -> None:
        _freeze(self, "position", (None, len(self.names), 3))

    def of(self, name: str) -> FloatArray:
        """Track (T, 3) m of one joint. Raises UsageError with the nearest names."""
        return np.asarray(self.position[:, _index(name, self.names, "joint")])


@dataclass(frozen=True)
class Skeleton:
    """Joint centres of the rest pose, from which bone lengths are read.

    names: m canonical joint names. position (m, 3) m: upright, facing x, the pelvis at the origin; arms and legs as the
    file's own rest pose has them (T-pose, arms down, legs apart).
    """

    names: tuple[str, ...]
    position: FloatArray

    def __post_init__(self) -> None:
        _freeze(self, "position", (len(self.names), 3))

    def of(self, name: str) -> FloatArray:
        """Rest position (3,) m of one joint. Raises UsageError with the nearest names."""
        return np.asarray(self.position[_index(name, self.names, "joint")])

    def distance(self, first: str, second: str) -> float:
        """Straight distance (m) between two joints of the rest pose."""
        return norm(self.of(first) - self.of(second))


@dataclass(frozen=True)
class SampleTimes:
    """Times of a live sample, s, on the run's clock; NaN: not known. captured, arrived: of the newest frame that had
    arrived; shown: when the poses that the sample shows were captured, which the playout delay puts before that."""

    captured: float = np.nan
    arrived: float = np.nan
    shown: float = np.nan


NO_TIMES = SampleTimes()
"""Of a sample that is not live."""


@dataclass(frozen=True)
class SensorSample:
    """The sensors at one instant: names (k), position (k, 3), orientation (k, 4) wxyz, valid (k); NaN where invalid.

    times: of a live one.
    """

    names: tuple[str, ...]
    position: FloatArray
    orientation: FloatArray
    valid: BoolArray
    times: SampleTimes = NO_TIMES

    @classmethod
    def of(
        cls, positions: Mapping[str, ArrayLike | None], orientations: Mapping[str, ArrayLike | None] | None = None
    ) -> "SensorSample":
        """A sample from positions (3,) m by sensor, None for a lost one, and orientations (4,) wxyz of those known.

        Raises UsageError for what are no such numbers, and for unknown sensors, with the nearest name.
        """
        names = tuple(positions) if isinstance(positions, Mapping) else ()
        for name in names:
            _index(name, SENSORS, "sensor", where="SensorSample.of, positions")
        for name in orientations if isinstance(orientations, Mapping) else ():
            _index(name, names, "sensor", where="SensorSample.of, orientations")
        position = _rows("positions", positions, names, 3)
        orientation = _rows("orientations", {} if orientations is None else orientations, names, 4)
        return cls(names, position, orientation, np.asarray(np.isfinite(position).all(axis=1)))


def _rows(argument: str, given: Mapping[str, ArrayLike | None], names: tuple[str, ...], numbers: int) -> FloatArray:
    """So many numbers of each name (k, numbers), NaN where there are none. Raises UsageError for anything else."""
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

    time (T,) s, from 0, strictly rising. names: k canonical sensor names. position (T, k, 3) m, world, NaN where
    invalid. orientation (T, k, 4) wxyz, world, NaN where unknown or invalid. It is the orientation of the body segment
    that the joint of the sensor's name carries (wrist: hand, elbow: forearm, shoulder: upper arm, hip: thigh, knee:
    shank, ankle and toe: foot, chest: thorax), and the identity of who stands upright, faces x and lets the arms hang,
    thumbs forward. valid (T, k). joints: the whole body where the source has it. skeleton: its rest pose. source: where
    it comes from. rate_hz: nominal frame rate. notes: warnings for the user. stature: m, of the performer, where the
    user says it.
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
        """Column of a sensor. Raises UsageError with the nearest names."""
        return _index(name, self.names, "sensor")

    def select(self, names: Sequence[str]) -> "SensorFrames":
        """Only these sensors, in this order. Raises UsageError with the nearest names for one that is not there."""
        return self._columns(tuple(names), [self.index(name) for name in names])

    def cut(self, start: float | None = None, end: float | None = None) -> "SensorFrames":
        """The frames from `start` to `end` (s, both included), with time counted from 0 again.

        Raises UsageError if a time is not finite, the order is wrong, or no frame lies between.
        """
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
        """The frames of these rows, in this order, at other times (s), which rise strictly."""
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
        """Left and right exchanged: every position reflected at the world's x-z plane, every name on its other side."""
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
        """The same motion on another clock: `time` (n,) s, strictly rising.

        Positions go straight and orientations along the short arc between the two neighbouring frames; a sensor is
        valid where it is valid in both. At the time of a frame, that frame is returned bit for bit. Before the first
        frame and after the last, the first and the last are held. The nominal rate is that of the new clock.
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
        """The sensors of these columns, by these names."""
        return replace(
            self,
            names=names,
            position=self.position[:, columns],
            orientation=self.orientation[:, columns],
            valid=self.valid[:, columns],
        )


def mirrored_name(name: str) -> str:
    """The name on the other side of the body: l_wrist for r_wrist; a middle part keeps its name."""
    return {"l_": "r_", "r_": "l_"}.get(name[:2], name[:2]) + name[2:]


def _mirror_order(names: tuple[str, ...]) -> tuple[tuple[str, ...], list[int]]:
    """Names after mirroring and, for each, the column it comes from. Names with both sides present keep their order."""
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
    """Check the shape of an array field (None: any) and store it contiguous and read-only."""
    given = getattr(owner, name)
    array: NDArray[np.generic] = np.ascontiguousarray(given, dtype)
    assert array.ndim == len(shape) and all(
        want in (None, got) for want, got in zip(shape, array.shape, strict=True)
    ), f"{name} has shape {array.shape}, not {shape}"
    if array is given and array.flags.writeable:
        array = array.view()
    array.flags.writeable = False
    object.__setattr__(owner, name, array)


# How tall a body is, measured along its bones.

HEAD_CENTRE, ANKLE = 0.936, 0.039
"""Heights of the eyes (level with the centre of the head) and of the ankle, as shares of stature (Drillis, Contini)."""


def stature(skeleton: Skeleton) -> float | None:
    """Height in the skeleton's unit, None without a leg, the neck or the head.

    Along the bones (ankle, knee, hip, middle of the hips, chest, neck, centre of the head), so it does not depend on
    how the rest pose stands.
    """
    needed = ("l_hip", "r_hip", "l_knee", "l_ankle", "neck", "head")
    if not set(needed) <= set(skeleton.names):
        return None
    trunk = [0.5 * (skeleton.of("l_hip") + skeleton.of("r_hip"))]
    trunk += [skeleton.of(name) for name in ("chest", "neck", "head") if name in skeleton.names]
    leg = skeleton.distance("l_hip", "l_knee") + skeleton.distance("l_knee", "l_ankle")
    return (leg + fsum(norm(b - a) for a, b in pairwise(trunk))) / (HEAD_CENTRE - ANKLE)


# The grid to which sensors are rounded: finer than any sensor's resolution, so that a recording of them stays small.
#
# Interpolation, smoothing and turning fill all 52 bits of a number, of which the last 30 hold no information. They
# cannot be compressed, and replay needs the followed samples to the bit. So these samples are rounded first.

STEP_M = 2.0**-20
"""Step, m, to which positions are rounded: a micrometre."""
STEP_TURN = 2.0**-22
"""Step to which the numbers of a quaternion are rounded: half a microradian. It misses unit length by less than
that."""


def on_grid(sensors: SensorSample) -> SensorSample:
    """The same sensors at the nearest points of the grid; what is NaN stays so."""
    return replace(
        sensors,
        position=np.rint(sensors.position / STEP_M) * STEP_M,
        orientation=np.rint(sensors.orientation / STEP_TURN) * STEP_TURN,
    )
