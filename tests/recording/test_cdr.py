"""Messages of fixed size: byte for byte what CDR asks for."""

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from mcap.reader import DecodedMessageTuple, make_reader
from mcap_ros2.decoder import DecoderFactory

from recordings import Recorded, decoded, record
from retarget.model.robot import RobotBody, load_robot
from retarget.recording.cdr import layout_from, layout_of, schema
from retarget.recording.cycles import Done
from retarget.recording.topics import (
    EVENTS,
    FRAMES,
    GOALS,
    HUMAN_JOINTS,
    HUMAN_POSTURE,
    JOINTS,
    LANDMARKS,
    RECORDED,
    SENSORS,
    STEP,
    TICK,
    Topic,
    topics,
)
from retarget.run.options import RunOptions
from retarget.run.table import RunTable, Widths

KINDS = {"bool": "?", "uint8": "B", "int32": "i", "uint32": "I", "float32": "f", "float64": "d"}


JOINT_STATE = (
    *("00010000 01000000 0a000000", "01000000 00 000000", "02000000"),  # little-endian, stamp, no frame, two names
    *("02000000 6100 0000", "05000000 6b6e656500 000000"),  # "a" and "knee", each with its zero, padded to 4
    *("02000000 00000000", "000000000000e03f 000000000000f0bf"),  # 0.5 and -1.0, at a multiple of 8
    *("00000000", "00000000"),  # no velocity, no effort
)


def test_a_joint_state_is_what_cdr_asks_for() -> None:
    layout = layout_of("sensor_msgs/msg/JointState", {"name": ("a", "knee"), "position": 2})
    rows = layout.rows(2)
    rows["stamp.sec"], rows["stamp.nanosec"], rows["position"] = (1, 2), (10, 20), [[0.5, -1.0], [3.0, 4.0]]
    size = layout.dtype.itemsize
    assert rows.tobytes()[:size] == bytes.fromhex(" ".join(JOINT_STATE))
    second = decoded("sensor_msgs/msg/JointState", rows.tobytes()[size:])
    assert (second.header.stamp.sec, second.header.stamp.nanosec) == (2, 20)
    assert (second.name, second.position) == (["a", "knee"], [3.0, 4.0])


SERVOS = "retarget_msgs/msg/Servos"
LINES = schema(SERVOS).partition("=" * 80)[0].splitlines()
SEQUENCES = {name for kind, name in map(str.split, LINES) if kind.endswith("[]") and kind.removesuffix("[]") in KINDS}


@given(st.fixed_dictionaries({}, optional={name: st.integers(0, 5) for name in sorted(SEQUENCES)}))
def test_sequences_are_what_cdr_asks_for(counts: dict[str, int]) -> None:
    rows = layout_of("retarget_msgs/msg/Servos", counts).rows(1)
    for name in set(SEQUENCES) & set(rows.dtype.names or ()):
        rows[name] = 1
    message = decoded(SERVOS, rows.tobytes())
    assert all(list(getattr(message, name)) == [1] * counts.get(name, 0) for name in SEQUENCES)


def test_the_description_of_a_layout_is_enough_to_read_it() -> None:
    layout = layout_of("geometry_msgs/msg/PoseArray", {"frame_id": "world", "poses": 2})
    assert layout_from(layout.description) == layout.dtype
    rows = layout.rows(1)
    rows["poses"] = np.arange(14).reshape(1, 2, 7)
    again = np.frombuffer(rows.tobytes(), dtype=layout_from(layout.description))
    np.testing.assert_array_equal(again["poses"], rows["poses"])


# A recording holds what its own definitions say, for the reader that ROS users have.

STANDARD = {
    "std_msgs/Header": "builtin_interfaces/Time stamp, string frame_id",
    "builtin_interfaces/Time": "int32 sec, uint32 nanosec",
    "geometry_msgs/Pose": "geometry_msgs/Point position, geometry_msgs/Quaternion orientation",
    "geometry_msgs/Point": "float64 x, float64 y, float64 z",
    "geometry_msgs/Vector3": "float64 x, float64 y, float64 z",
    "geometry_msgs/Quaternion": "float64 x, float64 y, float64 z, float64 w",
    "geometry_msgs/Transform": "geometry_msgs/Vector3 translation, geometry_msgs/Quaternion rotation",
    "geometry_msgs/TransformStamped": (
        "std_msgs/Header header, string child_frame_id, geometry_msgs/Transform transform"
    ),
    "geometry_msgs/PoseArray": "std_msgs/Header header, geometry_msgs/Pose[] poses",
    "sensor_msgs/JointState": (
        "std_msgs/Header header, string[] name, float64[] position, float64[] velocity, float64[] effort"
    ),
    "tf2_msgs/TFMessage": "geometry_msgs/TransformStamped[] transforms",
    "rcl_interfaces/Log": (
        "builtin_interfaces/Time stamp, uint8 level, string name, string msg, string file, string function, uint32 line"
    ),
}
"""The messages of ROS 2 (Humble to Rolling) by which Foxglove and others know them: order and types are the format."""

MESSAGES = (
    *("geometry_msgs/msg/PoseArray", "sensor_msgs/msg/JointState", "tf2_msgs/msg/TFMessage", "rcl_interfaces/msg/Log"),
    *("retarget_msgs/msg/Servos", "retarget_msgs/msg/Posture", "retarget_msgs/msg/Tick"),
)


@pytest.mark.parametrize("name", MESSAGES)
def test_a_definition_is_that_of_ros(name: str) -> None:
    for section in f"MSG: {name.replace('/msg/', '/')}\n{schema(name)}".split("=" * 80 + "\n"):
        title, *lines = section.splitlines()
        kind = title.removeprefix("MSG: ")
        if not kind.startswith("retarget_msgs/"):
            assert ", ".join(line for line in lines if "=" not in line) == STANDARD[kind], kind


@pytest.fixture(scope="module", params=["robot", "human"])
def run(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Recorded:
    options = RunOptions(robot="op3") if request.param == "robot" else RunOptions(robot="human", bus="none")
    return record(tmp_path_factory.mktemp("schemas") / "run.mcap", options=options, seconds=0.1)


@pytest.fixture(scope="module")
def messages(run: Recorded) -> list[DecodedMessageTuple]:
    """By the definitions in the file alone."""
    with run.path.open("rb") as stream:
        reader = make_reader(stream, validate_crcs=True, decoder_factories=[DecoderFactory()])
        return list(reader.iter_decoded_messages())


@pytest.mark.long
def test_every_message_has_the_time_of_its_cycle(messages: list[DecodedMessageTuple], run: Recorded) -> None:
    assert len(messages) > 2 * len(run.result.record)
    for _, channel, message, read in messages:
        parts = getattr(read, "transforms", None) or [read]
        stamps = [part.stamp if hasattr(part, "stamp") else part.header.stamp for part in parts]
        assert {stamp.sec * 10**9 + stamp.nanosec for stamp in stamps} == {message.log_time}, channel.topic


def test_what_a_tool_draws_can_be_drawn(messages: list[DecodedMessageTuple]) -> None:
    """Unit quaternions, finite transforms, a parent for every frame, as many numbers as names, in the topics of ROS."""
    for kind, channel, _, read in messages:
        assert kind is not None and kind.encoding == "ros2msg" and channel.message_encoding == "cdr"
        topic = channel.topic
        if topic in (SENSORS, LANDMARKS, HUMAN_JOINTS):
            assert kind.name == "geometry_msgs/msg/PoseArray" and read.header.frame_id == "world"
            assert all(norm(pose.orientation) == pytest.approx(1.0, abs=1e-4) for pose in read.poses)
        elif topic == FRAMES:
            children = [one.child_frame_id for one in read.transforms]
            assert topic == "/tf" and len(set(children)) == len(children) > 0 and "world" not in children
            for one in read.transforms:
                place = one.transform.translation
                assert one.header.frame_id == "world" and math.isfinite(place.x + place.y + place.z)
                assert norm(one.transform.rotation) == pytest.approx(1.0, abs=1e-4)
        elif topic in (JOINTS, GOALS):
            assert len(read.name) == len(read.position) > 0 and len(read.effort) == 0
            assert len(read.velocity) in (0, len(read.name))
        elif topic == EVENTS:
            assert read.level in (20, 30, 40) and read.name and read.msg


def norm(turn: Any) -> float:
    return math.hypot(turn.x, turn.y, turn.z, turn.w)


# Cycles as messages: which cycles a topic keeps, when, and what of them.

NAMES, LIMBS, MARKS = ("head", "l_wrist"), ("a", "b", "c"), ("l_hand",)


@pytest.fixture(scope="module")
def robot() -> RobotBody:
    return load_robot("op3")


def widths(robot: RobotBody | None) -> Widths:
    servos = 0 if robot is None else len(robot.joint_map)
    rest = 0 if robot is None else robot.body.nq - servos
    names = {"sensors": len(NAMES), "joints": len(LIMBS), "landmarks": len(MARKS)}
    return names | {"servos": servos, "rest": rest, "human": 11, "observers": 2}


def made(robot: RobotBody | None) -> dict[str, Topic]:
    found = topics(widths(robot), {"sensors": NAMES, "joints": LIMBS, "landmarks": MARKS}, dt=0.008, robot=robot)
    return {topic.name: topic for topic in found}


def cycles(robot: RobotBody | None, count: int = 40) -> RunTable:
    rows = RunTable.empty(count, widths(robot), RECORDED)
    rows.index[:], rows.kept[:], rows.sampled[:], rows.read[:] = np.arange(count), True, Done.WELL, Done.WELL
    rows.sensor_orientation[:] = [0.8, 0.0, 0.6, 0.0]
    if robot is not None:
        rows.q_rest[:, 3] = 1.0
    return rows


def kept(topic: Topic, rows: RunTable) -> list[int]:
    return [index for index, _, _ in topic.messages(rows, rows.index * 8_000_000)]


def test_a_human_alone_has_no_servos_and_every_posture() -> None:
    found = made(None)
    assert set(found) == {SENSORS, TICK, HUMAN_JOINTS, HUMAN_POSTURE}
    assert kept(found[HUMAN_POSTURE], cycles(None)) == list(range(40))


def content(topic: Topic, rows: RunTable) -> np.ndarray:
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
    rows.q_servos[0] = 0.3
    rows.q_rest[0, :3] = [0.1, 0.2, 0.4]
    frames = content(made(robot)[FRAMES], rows)
    q = np.zeros((1, robot.body.nq))
    q[0, 3], q[0, :3], q[:, robot.servo_columns] = 1.0, [0.1, 0.2, 0.4], 0.3
    for link, name in enumerate(robot.body.body_names[1:], start=1):
        solver = robot.body.solver_body()
        place, turn = solver.points(q, [link], np.zeros((1, 3)))[0, 0], solver.orientations(q, [link])[0, 0]
        np.testing.assert_allclose(frames[f"{name}.pose"][0], [*place, *turn[1:], turn[0]], atol=STEP)
