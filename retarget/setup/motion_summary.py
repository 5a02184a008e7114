"""Summary of a recording: sensors, body size, heights, speeds, and jumps that are impossible for a human."""

from dataclasses import dataclass

import numpy as np

from retarget import rotations
from retarget.frames import SensorFrames, Skeleton, stature
from retarget.types import FloatArray

TRUNK_SPEED = 8.0
LIMB_SPEED = 15.0
"""Greatest speeds of pelvis, chest and head, and of hands and feet, outside of competitive sport, m/s."""
TURN_SPEED = np.radians(5000.0)
"""Greatest angular speed of a segment, except of an arm in a professional throw, rad/s."""
TRUNK = ("pelvis", "chest", "head")

_BONES = {
    "thigh": ("hip", "knee"),
    "shank": ("knee", "ankle"),
    "upper arm": ("shoulder", "elbow"),
    "forearm": ("elbow", "wrist"),
}
_SPANS = {
    "hip width": ("l_hip", "r_hip"),
    "shoulder width": ("l_shoulder", "r_shoulder"),
    "pelvis to neck": ("pelvis", "neck"),
}


@dataclass(frozen=True)
class Jump:
    """A step of a sensor that is impossibly fast. frame: index of its first frame."""

    frame: int
    time_s: float
    sensor: str
    distance_m: float
    turn_deg: float


@dataclass(frozen=True)
class SensorSummary:
    """Summary of one sensor. valid, oriented: shares of frames with a position and with an orientation. Heights and
    speed are those of valid frames, NaN if there is none."""

    name: str
    valid: float
    oriented: float
    lowest_m: float
    highest_m: float
    max_speed_m_s: float
    jumps: int


@dataclass(frozen=True)
class MotionSummary:
    """Summary of a recording. stature_m: of the rest skeleton, if there is one. lengths_m: bone -> length, mean of both
    sides. travel_m: diagonal of the floor that the trunk covers."""

    source: str
    frames: int
    rate_hz: float
    duration_s: float
    sensors: tuple[SensorSummary, ...]
    joints: tuple[str, ...]
    stature_m: float | None
    lengths_m: dict[str, float]
    travel_m: float
    jumps: tuple[Jump, ...]
    notes: tuple[str, ...]


def summarise(frames: SensorFrames) -> MotionSummary:
    """Summarise all frames of a recording."""
    jumps = find_jumps(frames)
    # Speeds (T - 1, k), m/s, NaN if either frame is invalid.
    speed = np.linalg.norm(np.diff(frames.position, axis=0), axis=-1) / np.diff(frames.time)[:, None]
    sensors = tuple(_sensor(frames, i, speed, jumps) for i in range(len(frames.names)))
    trunk = next((name for name in TRUNK if name in frames.names), frames.names[0])
    ground = frames.position[:, frames.index(trunk), :2]
    seen = ground[np.isfinite(ground).all(axis=1)]
    return MotionSummary(
        source=frames.source,
        frames=len(frames),
        rate_hz=frames.rate_hz,
        duration_s=frames.duration_s,
        sensors=sensors,
        joints=() if frames.joints is None else frames.joints.names,
        stature_m=None if frames.skeleton is None else stature(frames.skeleton),
        lengths_m={} if frames.skeleton is None else body_lengths(frames.skeleton),
        travel_m=float(np.linalg.norm(np.ptp(seen, axis=0))) if len(seen) else 0.0,
        jumps=jumps,
        notes=frames.notes,
    )


def find_jumps(frames: SensorFrames) -> tuple[Jump, ...]:
    """Return steps between valid frames that are faster than a human, in the order of time."""
    interval = np.diff(frames.time)[:, None]
    distance = np.linalg.norm(np.diff(frames.position, axis=0), axis=-1)
    turn = rotations.angle_between(frames.orientation[:-1], frames.orientation[1:])
    limit = np.where([name in TRUNK for name in frames.names], TRUNK_SPEED, LIMB_SPEED)
    # Comparisons with NaN (no position, no orientation) are false.
    found = (distance / interval > limit) | (turn / interval > TURN_SPEED)
    return tuple(
        Jump(
            frame=int(i),
            time_s=float(frames.time[i]),
            sensor=frames.names[k],
            distance_m=float(distance[i, k]),
            turn_deg=float(np.degrees(turn[i, k])),
        )
        for i, k in np.argwhere(found)
    )


def body_lengths(skeleton: Skeleton) -> dict[str, float]:
    """Return lengths, m, between known joints of the rest skeleton, the mean of both sides for paired bones."""
    lengths = {}
    for bone, (a, b) in _BONES.items():
        sides = [
            skeleton.distance(f"{s}_{a}", f"{s}_{b}") for s in "lr" if {f"{s}_{a}", f"{s}_{b}"} <= set(skeleton.names)
        ]
        if sides:
            lengths[bone] = sum(sides) / len(sides)
    for span, (a, b) in _SPANS.items():
        if {a, b} <= set(skeleton.names):
            lengths[span] = skeleton.distance(a, b)
    return lengths


def _sensor(frames: SensorFrames, i: int, speed: FloatArray, jumps: tuple[Jump, ...]) -> SensorSummary:
    height = frames.position[frames.valid[:, i], i, 2]
    known = speed[np.isfinite(speed[:, i]), i]
    return SensorSummary(
        name=frames.names[i],
        valid=float(frames.valid[:, i].mean()),
        oriented=float(np.isfinite(frames.orientation[:, i]).all(axis=1).mean()),
        lowest_m=float(height.min()) if height.size else float("nan"),
        highest_m=float(height.max()) if height.size else float("nan"),
        max_speed_m_s=float(known.max()) if known.size else float("nan"),
        jumps=sum(jump.sensor == frames.names[i] for jump in jumps),
    )
