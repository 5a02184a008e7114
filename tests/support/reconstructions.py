"""Reconstructions for tests: motions that are thinned, or turned about the vertical."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from benchmarks.paper.replay import Replay as Run
from benchmarks.paper.replay import replay
from retarget import rotations
from retarget.frames import JointTracks, SensorFrames, SensorSample
from retarget.schema.priorities import Priorities, load_priorities

__all__ = ["Run", "reconstruct", "thinned", "turned"]


def reconstruct(
    frames: SensorFrames,
    priorities: str | Priorities,
    *,
    performer: str = "five",
    iterations: int | None = None,
    change: Callable[[int, SensorSample], SensorSample] = lambda frame, sample: sample,
) -> Run:
    """All frames through a reconstructor; `change` may replace each sample."""
    chosen = load_priorities(priorities) if isinstance(priorities, str) else priorities
    return replay(frames, chosen, sensors=performer, iterations=iterations, change=change)


def thinned(frames: SensorFrames, every: int) -> SensorFrames:
    """Every n-th frame."""
    return frames.resample(frames.time[::every])


def turned(frames: SensorFrames, angle: float) -> SensorFrames:
    """The whole motion turned to the left about the vertical through the origin, by `angle` rad."""
    turn = rotations.from_axis_angle(np.array([0.0, 0.0, 1.0]), np.array(angle))
    joints = frames.joints
    return replace(
        frames,
        position=rotations.rotate(turn, frames.position),
        orientation=rotations.multiply(turn, frames.orientation),
        joints=None if joints is None else JointTracks(joints.names, rotations.rotate(turn, joints.position)),
    )
