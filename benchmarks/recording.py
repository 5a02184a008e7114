"""A recorded performer as a benchmark motion, of the human and of a robot."""

from __future__ import annotations

import os
from dataclasses import replace
from pathlib import Path

import numpy as np

from benchmarks.bodies import BenchBody, Floats, Point
from benchmarks.motion import RATE, Motion
from benchmarks.ours import Ours
from retarget.frames import SensorFrames
from retarget.human.calibration import calibrate
from retarget.model.robot import RobotBody, load_robot
from retarget.robot.follower import Follower
from retarget.schema.priorities import load_priorities
from retarget.types import ORIENTED, HumanPosture

SHARED = Path(os.environ.get("RETARGET_SHARED", str(Path(__file__).resolve().parent.parent.parent / "shared")))
RECORDING = SHARED / "mocap" / "cmu_asfamc" / "02_06.amc"
LANDMARK = {"l_wrist": "l_hand", "r_wrist": "r_hand"}
"""Names that differ on a robot."""
SETTLE = 240  # frames of standing still, so that no side begins with a jump


def recording(body: BenchBody, source: SensorFrames) -> Motion:
    """Five sensors of a performer of the body's size, and the path of the centre of mass that goes with them.

    The paper keeps the centre of mass over the root. The peers take world targets only, so the path is the one that
    our own solver reaches with the paper's task.
    """
    points = source.position[:, [source.names.index(point.name) for point in body.points]]
    start, com = first_guess(body, source), np.zeros((len(points), 3))
    over_root = Motion(Path(source.source).stem, com, points, start, (1.0, 1.0, 0.0))
    ours = Ours(body, over_root, over=1)
    ours.aim(over_root.com[0], points[0])
    for _ in range(SETTLE):
        ours.solve()
    start = ours.posture()
    postures = np.zeros((len(points), body.model.nq))
    for k in range(len(points)):
        ours.aim(over_root.com[k], points[k])
        ours.solve()
        postures[k] = ours.posture()
    return replace(over_root, com=body.model.solver_body().centre_of_mass(postures), start=start)


def followed(robot: BenchBody, source: SensorFrames) -> tuple[BenchBody, Motion]:
    """What the recording asks of a robot that stands: ankles still, hands and head by the landmarks of the recording.

    The path of the centre of mass is the one that the robot's own stage takes. What is asked is not always in reach,
    nor always within its speed. The body that is returned has the landmarks' frames as points.
    """
    profile = load_robot(robot.name)
    follower = Follower(profile, load_priorities(profile.profile.retarget), calibrate(source))
    points = tuple(_point(profile, point.name) for point in robot.points)
    ankles = [follower.stance.points[point.name] for point in points if "ankle" in point.name]
    columns = [follower.landmark_map.names.index(LANDMARK.get(p.name, p.name)) for p in points if "ankle" not in p.name]
    asked, com = np.zeros((len(source), len(points), 3)), np.zeros((len(source), 3))
    for tick, posture in enumerate(recorded(source)):
        done = follower.step(posture, 1.0 / RATE) if tick else follower.start(posture)
        asked[tick] = [*ankles, *done.landmarks_asked[columns]]
        com[tick] = done.centre_of_mass
    motion = Motion(Path(source.source).stem, com, asked, follower.stance.q, (1.0, 1.0, 0.0))
    return replace(robot, points=points), motion


def recorded(frames: SensorFrames) -> list[HumanPosture]:
    """The whole body as the file knows it."""
    assert frames.joints is not None
    turns = np.stack([frames.orientation[:, frames.index(name)] for name in ORIENTED], axis=1)
    names, position = frames.joints.names, frames.joints.position
    empty, nowhere = np.zeros(0), np.zeros(3)
    return [
        HumanPosture(empty, names, np.ascontiguousarray(at), turn, nowhere, empty, 0.0, (1.0, 0.0))
        for at, turn in zip(position, turns, strict=True)
    ]


def _point(robot: RobotBody, name: str) -> Point:
    """The profile's frame for a tracked point."""
    frame = robot.profile.frames[LANDMARK.get(name, name)]
    return Point(name, frame.link, frame.pos)


def first_guess(body: BenchBody, source: SensorFrames) -> Floats:
    """The attractor posture (nq,) at the recorded pelvis, facing the way the hips face."""
    joints = source.joints
    assert joints is not None, "the recording must know the hips"
    pelvis, left, right = (joints.position[0, joints.names.index(name)] for name in ("pelvis", "l_hip", "r_hip"))
    across = left - right
    heading = np.arctan2(-across[0], across[1])
    q = body.attractor.copy()
    q[:3], q[3:7] = pelvis, [np.cos(heading / 2.0), 0.0, 0.0, np.sin(heading / 2.0)]
    return q
