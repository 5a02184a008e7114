"""`python -m benchmarks.one_stage FILE ...`: sensors mapped straight onto the OP3, beside the two stages.

One stage: the five sensors, scaled by the ratio of the heads' heights over the ground and placed over the feet, are the
robot's goals for hands and head; soles, balance, limits and reference governor are the same. Its heading is that of the
recorded whole body, which flatters it. Both are judged by the recorded whole body: what its landmarks, scaled limb by
limb, ask.
"""

import argparse
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from benchmarks.table import add_docs, show_table
from retarget import rotations
from retarget.frames import SensorFrames, SensorSample
from retarget.human.calibration import calibrate
from retarget.human.reconstruction import Reconstructor
from retarget.ik.hierarchy import Hierarchy
from retarget.ik.support_polygon import half_spaces, plant
from retarget.model.human import build_human
from retarget.model.human_dimensions import HumanDimensions
from retarget.model.robot import RobotBody, load_robot
from retarget.robot.follower import Follower
from retarget.robot.following_limits import following_limits
from retarget.robot.landmarks import AskedLandmarks, Facing, RobotReader, robot_frames, robot_postures
from retarget.robot.reference_governor import ReferenceGovernor
from retarget.schema.performer import load_performer
from retarget.schema.priorities import Priorities, load_priorities
from retarget.sources.open import open_source
from retarget.types import ORIENTED, FloatArray, HumanPosture

FIVE = ("head", "l_wrist", "r_wrist", "l_ankle", "r_ankle")
STRAIGHT = Priorities.model_validate(
    {
        "name": "one_stage",
        "description": "Sensors straight onto the robot",
        "levels": [
            {
                "name": "soles",
                "tasks": [
                    {"type": "position", "of": ["l_sole", "r_sole"]},
                    {"type": "orientation", "of": ["l_sole", "r_sole"]},
                ],
            },
            {"name": "balance", "tasks": [{"type": "centre_of_mass", "mode": "support", "margin": 0.01}]},
            {"name": "sensors", "tasks": [{"type": "position", "of": ["l_hand", "r_hand", "head"]}]},
            {"name": "posture", "tasks": [{"type": "posture", "towards": "stand", "settle": 0.5}]},
        ],
    }
)


@dataclass(frozen=True, eq=False)
class Track:
    """What a robot did: landmarks (T, k, 3) m asked of it and reached, its trunk (T, 4) wxyz, and the performer's
    heading (T, 2) that its world's x stands for."""

    asked: FloatArray
    reached: FloatArray
    trunk: FloatArray
    heading: FloatArray


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


def one_stage(robot: RobotBody, frames: SensorFrames, truth: Sequence[HumanPosture], dt: float) -> Track:
    """Five sensors straight onto the robot."""
    stance = plant(robot, robot.profile.postures.stand)
    limits, postures = following_limits(robot, stance), robot_postures(robot, stance)
    hierarchy = Hierarchy(STRAIGHT, robot.body, frames=robot_frames(robot), postures=postures, limits=limits)
    targets, reader, names = hierarchy.blank(), RobotReader(robot, stance), tuple(robot.profile.landmarks)
    for sole in stance.soles:
        hierarchy.set_position(targets, sole.frame.name, sole.position)
        hierarchy.set_orientation(targets, sole.frame.name, sole.orientation)
    hierarchy.set_support(targets, half_spaces(stance.edges(0.01)))
    still = frozenset(sole.frame.name for sole in stance.soles)
    governor = ReferenceGovernor(robot, hierarchy, still=still, trunk_at_stance=reader.trunk_at_stance)
    hierarchy.solver.reset(stance.q)
    facing, q, reached = Facing(), stance.q, reader.read(stance.q)
    scale = float(stance.points["head"][2]) / float(np.nanmax(frames.position[:, frames.index("head"), 2]))
    ankle = 0.5 * (stance.points["l_ankle"] + stance.points["r_ankle"])
    rows = []
    for sensors, posture in zip(over_feet(frames), truth, strict=True):
        x, y = heading(facing, posture, dt)
        turned = sensors @ np.array([[x, -y, 0.0], [y, x, 0.0], [0.0, 0.0, 1.0]])
        goals = dict(zip(names, reached.landmarks, strict=True))
        for name, (a, b, c) in zip(("head", "l_hand", "r_hand"), (ankle + scale * turned).tolist(), strict=True):
            goals[name] = (a, b, c)
        asked = AskedLandmarks([goals[name] for name in names], reached.limbs, (1.0, 0.0, 0.0, 0.0), (1.0, 0.0, 0.0))
        governor.aim(targets, asked, reached, dt)
        hierarchy.set_previous(targets, q, dt)
        q = hierarchy.solver.frame(targets, dt)
        reached = reader.read(q)
        rows.append((asked.landmarks, reached.points, reached.trunk, (x, y)))
    return Track(*(np.array(column) for column in zip(*rows, strict=True)))


def over_feet(frames: SensorFrames) -> FloatArray:
    """Head and wrists (T, 3, 3) m from the middle of the ankles."""
    head, left, right, *ankles = (frames.position[:, frames.index(name)] for name in FIVE)
    return np.asarray(np.stack([head, left, right], axis=1) - 0.5 * (ankles[0] + ankles[1])[:, None])


def heading(facing: Facing, posture: HumanPosture, dt: float) -> tuple[float, float]:
    """The performer's heading, from the recorded whole body."""
    w, x, y, z = posture.orientation("pelvis").tolist()
    feet = [(posture.joint(f"{side}_toe") - posture.joint(f"{side}_ankle")).tolist() for side in "lr"]
    return facing.update((w, x, y, z), feet[0], feet[1], dt)


def headings(human: Sequence[HumanPosture], dt: float) -> FloatArray:
    """Headings (T, 2) of postures, as the second stage takes them."""
    facing = Facing()
    return np.array([heading(facing, posture, dt) for posture in human])


def two_stages(robot: RobotBody, frames: SensorFrames, size: HumanDimensions, dt: float, step: float) -> Track:
    """Five sensors to the virtual human, and its landmarks to the robot. step: s of the performer's time per tick."""
    reconstructor = Reconstructor(build_human(size), load_priorities("human"), load_performer("five"))
    five, human = frames.select(FIVE), []
    for tick in range(len(frames)):
        sample = SensorSample(FIVE, five.position[tick], five.orientation[tick], five.valid[tick])
        human.append(reconstructor.step(sample, step) if tick else reconstructor.start(sample))
    follower = Follower(robot, load_priorities("servo"), size)
    reader = RobotReader(robot, follower.stance)
    rows = []
    for tick, (posture, ahead) in enumerate(zip(human, headings(human, dt), strict=True)):
        done = follower.step(posture, dt) if tick else follower.start(posture)
        trunk = reader.read(done.q).trunk
        rows.append((done.landmarks_asked, done.landmarks_reached, trunk, ahead))
    return Track(*(np.array(column) for column in zip(*rows, strict=True)))


def wanted(robot: RobotBody, truth: Sequence[HumanPosture], size: HumanDimensions, dt: float) -> Track:
    """What the recorded whole body asks, scaled limb by limb."""
    landmarks = Follower(robot, load_priorities("servo"), size).landmark_map
    asked = [landmarks.ask(posture, dt) for posture in truth]
    points = np.array([one.landmarks for one in asked])
    return Track(points, points, np.array([one.trunk for one in asked]), headings(truth, dt))


def judge(done: Track, goal: Track, names: tuple[str, ...]) -> list[float]:
    """Mean errors of hands, pelvis (mm) and trunk (deg) against `goal`."""
    hands, pelvis = [names.index("l_hand"), names.index("r_hand")], names.index("pelvis")
    # What faces elsewhere is not wrong: the robot's world is turned to where the recorded body faces.
    (ax, ay), (bx, by) = goal.heading.T, done.heading.T
    away = rotations.from_axis_angle(np.array([0.0, 0.0, 1.0]), np.arctan2(ax * by - ay * bx, ax * bx + ay * by))
    error = 1e3 * np.linalg.norm(rotations.rotate(away[:, None], done.reached) - goal.asked, axis=2)
    turn = np.rad2deg(rotations.angle_between(goal.trunk, rotations.multiply(away, done.trunk)))
    return [float(value) for value in (error[:, hands].mean(), error[:, pelvis].mean(), turn.mean())]


def main() -> None:
    """Play every file at the speed asked for, and print a row for each way."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("files", nargs="+", type=Path)
    parser.add_argument("--speed", type=float, default=0.5)
    add_docs(parser)
    options = parser.parse_args()
    robot = load_robot("op3")
    names, dt = tuple(robot.profile.landmarks), 1.0 / robot.profile.safety.rate_hz
    rows = []
    for path in options.files:
        frames = open_source(path)
        size = calibrate(frames)
        frames = frames.resample(np.arange(0.0, frames.duration_s, options.speed * dt))
        truth = recorded(frames)
        goal = wanted(robot, truth, size, dt)
        ways = {
            "one stage": one_stage(robot, frames, truth, dt),
            "two stages": two_stages(robot, frames, size, dt, options.speed * dt),
        }
        for way, done in ways.items():
            rows.append([path.stem, way, *(f"{value:.0f}" for value in judge(done, goal, names))])
    show_table("one-stage", ["motion", "way", "hands, mm", "pelvis, mm", "trunk, deg"], rows, text=2, docs=options.docs)


if __name__ == "__main__":
    main()
