"""Cycles as messages: which cycles a topic keeps, when, and what of them."""

import numpy as np
import pytest

from retarget.model.robot import RobotBody, load_robot
from retarget.recording.cycles import Cycles, Done, Shape
from retarget.recording.topics import (
    FRAMES,
    HUMAN_JOINTS,
    HUMAN_POSTURE,
    SENSORS,
    STEP,
    TICK,
    Topic,
    topics,
)

NAMES, LIMBS, MARKS = ("head", "l_wrist"), ("a", "b", "c"), ("l_hand",)


@pytest.fixture(scope="module")
def robot() -> RobotBody:
    return load_robot("op3")


def shape(robot: RobotBody | None) -> Shape:
    servos = 0 if robot is None else len(robot.joint_map)
    rest = 0 if robot is None else robot.body.nq - servos
    return Shape(len(NAMES), servos, rest, 11, len(LIMBS), len(MARKS), 2, 0)


def made(robot: RobotBody | None) -> dict[str, Topic]:
    found = topics(shape(robot), sensors=NAMES, human_joints=LIMBS, landmarks=MARKS, dt=0.008, robot=robot)
    return {topic.name: topic for topic in found}


def cycles(robot: RobotBody | None, count: int = 40) -> Cycles:
    rows = Cycles.empty(count, shape(robot))
    rows.index[:], rows.kept[:], rows.sampled[:], rows.read[:] = np.arange(count), True, Done.WELL, Done.WELL
    rows.sensor_orientation[:] = [0.8, 0.0, 0.6, 0.0]
    if robot is not None:
        rows.rest[:, 3] = 1.0
    return rows


def kept(topic: Topic, rows: Cycles) -> list[int]:
    return [index for index, _, _ in topic.messages(rows, rows.index * 8_000_000)]


def test_a_human_alone_has_no_servos_and_every_posture() -> None:
    found = made(None)
    assert set(found) == {SENSORS, TICK, HUMAN_JOINTS, HUMAN_POSTURE}
    assert kept(found[HUMAN_POSTURE], cycles(None)) == list(range(40))


def content(topic: Topic, rows: Cycles) -> np.ndarray:
    data = b"".join(data for _, _, data in topic.messages(rows, rows.index * 8_000_000))
    return np.frombuffer(data, topic.layout.dtype)


def test_sensors_are_bit_by_bit_and_turned_as_ros_has_them(robot: RobotBody) -> None:
    rows = cycles(robot, 3)
    rows.sensor_position[:] = np.random.default_rng(1).normal(size=(3, 2, 3))
    rows.sensor_orientation[1, 0] = np.nan
    poses = content(made(robot)[SENSORS], rows)["poses"]
    np.testing.assert_array_equal(poses[..., :3], rows.sensor_position)
    assert poses[0, 0, 3:].tolist() == [0.0, 0.6, 0.0, 0.8] and poses[1, 0, 3:].tolist() == [0.0, 0.0, 0.0, 1.0]


def test_frames_are_where_the_links_are(robot: RobotBody) -> None:
    rows = cycles(robot, 1)
    rows.q[0] = 0.3
    rows.rest[0, :3] = [0.1, 0.2, 0.4]
    frames = content(made(robot)[FRAMES], rows)
    q = np.zeros((1, robot.body.nq))
    q[0, 3], q[0, :3], q[:, robot.servo_columns] = 1.0, [0.1, 0.2, 0.4], 0.3
    for link, name in enumerate(robot.body.body_names[1:], start=1):
        solver = robot.body.solver_body()
        place, turn = solver.points(q, [link], np.zeros((1, 3)))[0, 0], solver.orientations(q, [link])[0, 0]
        np.testing.assert_allclose(frames[f"{name}.pose"][0], [*place, *turn[1:], turn[0]], atol=STEP)
