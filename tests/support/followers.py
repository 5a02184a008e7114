"""A performer whose whole body is known, and a robot that follows: what the tests of the robot's stage share."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np

from retarget.frames import SensorFrames
from retarget.human.calibration import dimensions_from_skeleton
from retarget.ik.support_polygon import Stance, plant, support_distance
from retarget.model.human_dimensions import HumanDimensions
from retarget.model.robot import RobotBody, load_robot
from retarget.report.tracking import ReferenceMotion
from retarget.robot.follower import Follower
from retarget.schema.priorities import load_priorities
from retarget.types import ORIENTED, FloatArray, HumanPosture, RobotPosture
from sim.performer import synthetic_performer

DT = 1.0 / 125.0
"""Tick of the OP3, s."""


ROBOTS = ("op3", "poppy", "toddlerbot", "wolfgang")
"""The shipped ones."""


@cache
def shipped(name: str) -> RobotBody:
    return load_robot(name)


def op3() -> RobotBody:
    return shipped("op3")


@cache
def stance(name: str = "op3") -> Stance:
    """A shipped robot on its soles, as in `stand`."""
    return plant(shipped(name), shipped(name).profile.postures.stand)


@cache
def performer() -> SensorFrames:
    return synthetic_performer()


def dimensions(frames: SensorFrames) -> HumanDimensions:
    assert frames.skeleton is not None
    return dimensions_from_skeleton(frames.skeleton)


def postures(frames: SensorFrames, *, speed: float = 1.0) -> list[HumanPosture]:
    """The recorded whole body at every tick of the robot, as a perfect reconstruction would have it."""
    frames = frames.resample(np.arange(0.0, frames.duration_s / speed, DT) * speed)
    assert frames.joints is not None
    orientations = np.stack([frames.orientation[:, frames.index(name)] for name in ORIENTED], axis=1)
    return [
        HumanPosture(
            q=np.zeros(0),
            joint_names=frames.joints.names,
            joints=np.ascontiguousarray(frames.joints.position[tick]),
            orientations=orientations[tick],
            centre_of_mass=np.zeros(3),
            sensor_error=np.zeros(0),
            balance_error=0.0,
            heading=(1.0, 0.0),
        )
        for tick in range(len(frames))
    ]


def performance(human: Sequence[HumanPosture], names: tuple[str, ...], asked: FloatArray) -> ReferenceMotion:
    """What was asked (T, k, 3) m when `performer` did this."""
    return ReferenceMotion(
        dimensions=dimensions(performer()),
        joint_names=human[0].joint_names,
        joints=np.array([posture.joints for posture in human]),
        pelvis=np.array([posture.orientation("pelvis") for posture in human]),
        landmark_names=names,
        landmarks=asked,
        dt=DT,
    )


def follower(frames: SensorFrames | None = None, *, parts: str = "whole", priorities: str = "servo") -> Follower:
    assert parts in ("whole", "upper")
    size = dimensions(frames or performer())
    return Follower(op3(), load_priorities(priorities), size, parts="upper" if parts == "upper" else "whole")


def settled(robot: Follower, human: HumanPosture) -> list[RobotPosture]:
    """The postures on the way from the start of a robot to what a human posture asks for."""
    way: list[RobotPosture] = []
    while (posture := robot.settle(human, DT)) is not None:
        way.append(posture)
    return way


@dataclass(frozen=True, eq=False)
class Followed:
    """What a robot did, its start included: q (T, nq), joints (T, n) rad, landmarks (T, k, 3) m."""

    names: tuple[str, ...]
    q: FloatArray
    joints: FloatArray
    asked: FloatArray
    reached: FloatArray


def follow(robot: Follower, human: Sequence[HumanPosture]) -> Followed:
    done = [robot.start(human[0]), *(robot.step(posture, DT) for posture in human)]
    return Followed(
        done[0].landmark_names,
        np.array([posture.q for posture in done]),
        np.array([posture.joint_positions for posture in done]),
        np.array([posture.landmarks_asked for posture in done]),
        np.array([posture.landmarks_reached for posture in done]),
    )


def assert_within_limits(joints: FloatArray) -> None:
    """Positions (T, n) rad keep every servo's limits, by finite differences."""
    limits = op3().limits
    velocity = np.abs(np.diff(joints, axis=0)) / DT
    acceleration = np.abs(np.diff(joints, n=2, axis=0)) / DT**2
    assert (joints >= limits.lower - 1e-9).all() and (joints <= limits.upper + 1e-9).all()
    assert (velocity <= limits.max_velocity * (1.0 + 1e-6)).all()
    assert (acceleration <= limits.max_acceleration * (1.0 + 1e-6)).all()


def balance_margin(robot: Follower, q: FloatArray) -> float:
    """Least distance (m) of the centre of mass from the edges of both soles, over postures (T, nq); below 0 outside."""
    com = op3().body.solver_body().centre_of_mass(np.ascontiguousarray(q))
    return float(support_distance(com, robot.stance.edges(0.0)).min())


def sole_errors(robot: Follower, q: FloatArray) -> tuple[float, float]:
    """Most that a corner of a sole is from its place (m) and that a sole is tilted (rad), over postures (T, nq)."""
    off = tilt = 0.0
    for sole in robot.stance.soles:
        corners = op3().body.solver_body().points(q, [sole.frame.body] * len(sole.corners), sole.corners)
        planted = np.column_stack([sole.outline, np.zeros(len(sole.outline))])
        off = max(off, float(np.linalg.norm(corners - planted, axis=-1).max()))
        quat = op3().orientations(q, (sole.frame.name,))[:, 0]
        tilt = max(tilt, float(2.0 * np.arcsin(np.hypot(quat[:, 1], quat[:, 2])).max()))
    return off, tilt
