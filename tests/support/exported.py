"""Small motions of known bodies, and saved runs, for the tests of the exports."""

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from retarget.model.body import BodyModel, load_body, load_body_text
from retarget.model.robot import load_robot
from retarget.recording.motion import Motion, Tracks
from retarget.rotations import from_rotation_vector
from retarget.types import FloatArray

RATE = 50.0
SLIDER = """<mujoco><worldbody><body name="base"><freejoint name="root"/><geom size="0.1"/>
  <body name="my arm" pos="0.1 0 0.3" euler="30 20 10"><joint name="lift" type="slide" axis="0 0 1"/>
    <geom size="0.1" pos="0 0 0.2"/>
    <body name="tip" pos="0 0.2 0"><joint name="swing" axis="1 0 0" pos="0.02 0.03 0"/><geom size="0.02"/></body></body>
  <body name="my{arm" pos="-0.1 0 0.3"><joint name="roll" axis="1 1 0"/><geom size="0.1"/></body></body>
</worldbody></mujoco>"""
"""A slide, a hinge that does not turn about its link's origin, turned frames, names with a blank and a brace."""


def slider() -> BodyModel:
    return load_body_text(SLIDER, source="slider")


def moved(body: BodyModel, *, rows: int = 40, seed: int = 7, robot: str = "slider", rate_hz: float = RATE) -> Motion:
    """A body that sways through large angles while its root wanders and turns all around."""
    rng = np.random.default_rng(seed)
    time = np.arange(rows) / rate_hz
    single, address = body.scalar_joints()
    joints = int(np.count_nonzero(single))
    q = np.tile(body.qpos0, (rows, 1))
    phase, rate = rng.uniform(0.0, 6.3, joints), rng.uniform(0.5, 3.0, joints)
    q[:, address[single]] = 1.2 * np.sin(phase + np.outer(time, 6.3 * rate))
    q[:, :3] = np.cumsum(rng.normal(0.0, 0.01, (rows, 3)), axis=0) + np.array([0.1, 0.2, 0.4])
    q[:, 3:7] = from_rotation_vector(np.outer(np.linspace(0.0, 5.0, rows), [0.2, 0.4, 0.89]))
    return Motion("test.npz", robot, body, time, np.full(rows, "follow"), q)


def with_servos(motion: Motion) -> Motion:
    """With servos behind what was sent on all joints but the last, and one landmark that is not always known."""
    from dataclasses import replace

    servos = motion.joints - 0.01
    servos[:, -1] = np.nan
    goals = np.rint(motion.joints * 650).astype(np.int64) + 2048
    goals[:, -1] = -1
    asked = np.zeros((len(motion), 2, 3)) + np.arange(len(motion))[:, None, None]
    asked[0, 1] = np.nan
    return replace(motion, servos=servos, goal_ticks=goals, asked=Tracks(("hand", "lost"), asked))


def op3() -> BodyModel:
    return load_body(load_robot("op3").profile.body_path)


def saved(motion: Motion, path: Path, body: Path, **other: Any) -> Path:
    """A motion in the keys of `--save`; `other` replaces keys, None leaves one out."""
    arrays: dict[str, NDArray[Any] | None] = {
        "time": motion.time,
        "phase": motion.phase,
        "joint_names": np.array(motion.joint_names),
        "joint_positions": motion.joints,
        "root_position": motion.root_position,
        "root_quaternion": motion.root_quaternion,
        "body": np.array(str(body)),
        "goal_ticks": motion.goal_ticks,
        "servo_positions": motion.servos,
        "landmark_names": None if motion.asked is None else np.array(motion.asked.names),
        "landmarks_asked": None if motion.asked is None else motion.asked.position,
    }
    np.savez(path, allow_pickle=False, **{key: value for key, value in (arrays | other).items() if value is not None})
    return path


def angle_between(a: FloatArray, b: FloatArray) -> FloatArray:
    """Angles (...) rad between orientations, whatever the sign of the quaternions."""
    cosine = np.clip(np.abs(np.sum(a * b, axis=-1)), 0.0, 1.0)
    return np.asarray(2.0 * np.arccos(cosine))
