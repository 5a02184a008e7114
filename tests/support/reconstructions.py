"""Reconstructions for tests: a motion through a reconstructor, and motions turned about the vertical."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from retarget import rotations
from retarget.frames import JointTracks, SensorFrames, SensorSample
from retarget.human.calibration import calibrate, rest_orientations
from retarget.human.reconstruction import Reconstructor
from retarget.model.human import Human, build_human
from retarget.model.human_dimensions import POINTS
from retarget.schema.performer import load_performer
from retarget.schema.priorities import Priorities, load_priorities
from retarget.types import FloatArray, HumanPosture

UNSENSED = ("pelvis", "l_knee", "r_knee", "l_elbow", "r_elbow", "l_shoulder", "r_shoulder", "neck")
"""Joints that five sensors do not see and every recording knows."""

Change = Callable[[int, SensorSample], SensorSample]


@dataclass(frozen=True, eq=False)
class Run:
    """A reconstructed motion: T postures, in columns."""

    human: Human
    frames: SensorFrames
    postures: tuple[HumanPosture, ...]

    @property
    def joints(self) -> FloatArray:
        """(T, m, 3) m."""
        return np.array([posture.joints for posture in self.postures])

    @property
    def q(self) -> FloatArray:
        """(T, nq)."""
        return np.array([posture.q for posture in self.postures])

    @property
    def errors_mm(self) -> FloatArray:
        """Distance of each sensor (T, k) mm."""
        return 1e3 * np.array([posture.sensor_error for posture in self.postures])

    @property
    def balance_mm(self) -> FloatArray:
        """Distance of the centre of mass from its goal (T,) mm."""
        return 1e3 * np.array([posture.balance_error for posture in self.postures])

    def unsensed_mm(self) -> float:
        """Mean error of the joints that no sensor sees, mm."""
        assert self.frames.joints is not None
        off = [self.joints[:, POINTS.index(name)] - self.frames.joints.of(name) for name in UNSENSED]
        return float(1e3 * np.linalg.norm(off, axis=-1).mean())


def reconstruct(
    frames: SensorFrames,
    priorities: str | Priorities,
    *,
    performer: str = "five",
    iterations: int | None = None,
    change: Change | None = None,
) -> Run:
    """All frames through a reconstructor; `change` may replace each sample."""
    human = build_human(calibrate(frames))
    reconstructor = Reconstructor(
        human,
        load_priorities(priorities) if isinstance(priorities, str) else priorities,
        load_performer(performer),
        rest=None if frames.skeleton is None else rest_orientations(frames.skeleton),
        iterations=iterations,
    )
    postures = []
    for k, time in enumerate(frames.time):
        sample = SensorSample(frames.names, frames.position[k], frames.orientation[k], frames.valid[k])
        if change is not None:
            sample = change(k, sample)
        postures.append(
            reconstructor.start(sample) if k == 0 else reconstructor.step(sample, time - frames.time[k - 1])
        )
    return Run(human, frames, tuple(postures))


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
