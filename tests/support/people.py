"""People of known size for tests: four recorded skeletons, and points of the human in a posture."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from benchmarks.paper.replay import Replay as Run
from benchmarks.paper.replay import replay
from retarget import rotations
from retarget.frames import JointTracks, SensorFrames, SensorSample
from retarget.model.human import Human
from retarget.model.human_dimensions import PARENTS, POINTS, HumanDimensions
from retarget.schema.priorities import Priorities, load_priorities
from retarget.sources.asf_amc import read_amc
from retarget.types import FloatArray
from sim.performer import synthetic_performer

TRIALS = ("02_01", "01_01", "05_13", "49_18")
"""One trial of each recorded person."""


def trial(shared: Path, name: str) -> SensorFrames:
    return read_amc(shared / "mocap" / "cmu_asfamc" / f"{name}.amc")


def place(human: Human, q: FloatArray, names: Sequence[str]) -> FloatArray:
    """World positions (k, 3) of frames of the human in posture q."""
    frames = [human.body.frame(name) for name in names]
    local = np.array([frame.position for frame in frames])
    return np.asarray(human.body.solver_body().points(q[None], [frame.body for frame in frames], local)[0])


def at_rest(person: HumanDimensions, arms: float, *, turn: float = 0.0, splay: float = 0.05) -> dict[str, FloatArray]:
    """Every point of a person with straight limbs, the arms at an angle from hanging, the soles on the ground."""
    points: dict[str, FloatArray] = {}
    for name, parent in zip(POINTS, PARENTS, strict=True):
        side = 1.0 if name.startswith("l_") else -1.0
        angle = arms if name[2:] in ("elbow", "wrist", "hand") else splay if name[2:] in ("knee", "ankle") else 0.0
        offset = person.of(name)
        if angle:
            offset = person.length(name) * np.array([0.0, side * np.sin(angle), -np.cos(angle)])
        points[name] = offset + (points[POINTS[parent]] if parent >= 0 else 0.0)
    lift = 0.039 * person.stature - points["l_ankle"][2]
    cosine, sine = np.cos(turn), np.sin(turn)
    matrix = np.array([[cosine, -sine, 0.0], [sine, cosine, 0.0], [0.0, 0.0, 1.0]])
    return {name: matrix @ point + [2.0, -1.0, lift] for name, point in points.items()}


# Reconstructions for tests: motions that are thinned, or turned about the vertical.

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


def limbs_lie_along_their_bones(frames: SensorFrames) -> None:
    """In every frame each limb's segment, which hangs where its orientation is the identity, lies along its bone."""
    joints = frames.joints
    assert joints is not None
    for near, far in (("shoulder", "elbow"), ("elbow", "wrist"), ("hip", "knee"), ("knee", "ankle")):
        for side in ("l_", "r_"):
            bone = joints.of(side + far) - joints.of(side + near)
            hanging = rotations.rotate(frames.orientation[:, frames.index(side + near)], np.array([0.0, 0.0, -1.0]))
            length = np.linalg.norm(bone, axis=1, keepdims=True)
            np.testing.assert_allclose(hanging, bone / length, atol=2e-3, err_msg=side + near)


def limbs_rest_as_one(frames: SensorFrames, frame: int = 0) -> None:
    """In a frame of the rest pose hands are turned as forearms, feet as shanks, and thumbs are where the body faces."""
    turn = dict(zip(frames.names, frames.orientation[frame], strict=True))
    for side in ("l_", "r_"):
        for end, segment in (("wrist", "elbow"), ("ankle", "knee"), ("toe", "knee")):
            np.testing.assert_allclose(turn[side + end], turn[side + segment], atol=1e-12)
        facing = rotations.rotate(turn["pelvis"], np.array([1.0, 0.0, 0.0]))
        np.testing.assert_allclose(rotations.rotate(turn[side + "wrist"], np.array([1.0, 0.0, 0.0])), facing, atol=1e-9)


def close_passes() -> SensorFrames:
    """Two seconds at 120 Hz: ankles go past each other at 80 mm, and both wrists to the other side of the chest."""
    frames = synthetic_performer().cut(0.0, 2.0)
    position = np.repeat(frames.position[:1], len(frames.position), axis=0)
    time = frames.time - frames.time[0]
    at = {name: frames.names.index(name) for name in ("l_ankle", "r_ankle", "l_wrist", "r_wrist", "head")}
    stride = 0.25 * np.sin(3.0 * np.pi * time)
    for name, side in (("l_ankle", 1.0), ("r_ankle", -1.0)):
        position[:, at[name], 0] += side * stride
        position[:, at[name], 1] = side * 0.04
        position[:, at[name], 2] += 0.1 * np.maximum(side * np.cos(3.0 * np.pi * time), 0.0)
    share = np.clip(time / 0.4, 0.0, 1.0)[:, None]
    for name, side in (("l_wrist", 1.0), ("r_wrist", -1.0)):
        crossed = position[0, at["head"]] + [0.22, -0.18 * side, -0.40 + 0.02 * side]
        position[:, at[name]] += share * (crossed - position[0, at[name]])
    return replace(frames, position=position)
