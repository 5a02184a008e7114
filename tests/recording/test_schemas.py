"""A recording holds what its own definitions say, for a strict reader and for the one that ROS users have."""

import math
from pathlib import Path
from typing import Any

import pytest
from mcap.reader import make_reader

from recordings import Recorded, record
from retarget.recording.cdr import schema as definition
from retarget.recording.topics import EVENTS, FRAMES, GOALS, HUMAN_JOINTS, JOINTS, LANDMARKS, SENSORS
from retarget.run.options import RunOptions
from ros2_messages import Field, decoded, parsed

STANDARD: dict[str, tuple[Field, ...]] = {
    "std_msgs/Header": (("stamp", "builtin_interfaces/Time", False), ("frame_id", "string", False)),
    "builtin_interfaces/Time": (("sec", "int32", False), ("nanosec", "uint32", False)),
    "geometry_msgs/Pose": (
        ("position", "geometry_msgs/Point", False),
        ("orientation", "geometry_msgs/Quaternion", False),
    ),
    "geometry_msgs/Point": tuple((axis, "float64", False) for axis in "xyz"),
    "geometry_msgs/Vector3": tuple((axis, "float64", False) for axis in "xyz"),
    "geometry_msgs/Quaternion": tuple((axis, "float64", False) for axis in "xyzw"),
    "geometry_msgs/Transform": (
        ("translation", "geometry_msgs/Vector3", False),
        ("rotation", "geometry_msgs/Quaternion", False),
    ),
    "geometry_msgs/TransformStamped": (
        ("header", "std_msgs/Header", False),
        ("child_frame_id", "string", False),
        ("transform", "geometry_msgs/Transform", False),
    ),
    "geometry_msgs/PoseArray": (("header", "std_msgs/Header", False), ("poses", "geometry_msgs/Pose", True)),
    "sensor_msgs/JointState": (
        ("header", "std_msgs/Header", False),
        ("name", "string", True),
        ("position", "float64", True),
        ("velocity", "float64", True),
        ("effort", "float64", True),
    ),
    "tf2_msgs/TFMessage": (("transforms", "geometry_msgs/TransformStamped", True),),
    "rcl_interfaces/Log": (
        ("stamp", "builtin_interfaces/Time", False),
        ("level", "uint8", False),
        ("name", "string", False),
        ("msg", "string", False),
        ("file", "string", False),
        ("function", "string", False),
        ("line", "uint32", False),
    ),
}
"""The messages of ROS 2 (Humble to Rolling) by which Foxglove and others know them: order and types are the format."""

MESSAGES = (
    *("geometry_msgs/msg/PoseArray", "sensor_msgs/msg/JointState", "tf2_msgs/msg/TFMessage", "rcl_interfaces/msg/Log"),
    *("retarget_msgs/msg/Servos", "retarget_msgs/msg/Posture", "retarget_msgs/msg/Tick"),
)


@pytest.fixture(scope="module", params=["robot", "human"])
def run(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Recorded:
    options = RunOptions(robot="op3") if request.param == "robot" else RunOptions(robot="human", bus="none")
    return record(tmp_path_factory.mktemp("schemas") / "run.mcap", options=options, seconds=0.2)


@pytest.mark.parametrize("name", MESSAGES)
def test_a_definition_has_all_that_it_needs_and_nothing_else(name: str) -> None:
    found = parsed(name, definition(name))
    every = {name.replace("/msg/", "/"): found.own, **found.types}
    for kind, fields in every.items():
        if not kind.startswith("retarget_msgs/"):
            assert STANDARD[kind] == fields, kind


def all_messages(path: Path) -> list[tuple[str, str, int, dict[str, Any]]]:
    """Topic, schema, time of the log and content of every message, by the definitions in the file alone."""
    found = []
    with path.open("rb") as stream:
        for schema, channel, message in make_reader(stream, validate_crcs=True).iter_messages():
            assert schema is not None and schema.encoding == "ros2msg" and channel.message_encoding == "cdr"
            definition = parsed(schema.name, schema.data.decode())
            found.append((channel.topic, schema.name, message.log_time, decoded(definition, message.data)))
    return found


def test_every_message_is_read_to_its_last_byte(run: Recorded) -> None:
    found = all_messages(run.path)
    assert len(found) > 2 * len(run.result.record)
    for topic, _, time, message in found:
        stamps = [one["header"]["stamp"] for one in message.get("transforms", ())]
        stamps += [message["stamp"] if "stamp" in message else message["header"]["stamp"]] if not stamps else []
        assert {stamp["sec"] * 10**9 + stamp["nanosec"] for stamp in stamps} == {time}, topic


def test_what_a_tool_draws_can_be_drawn(run: Recorded) -> None:
    """Unit quaternions, finite transforms, a parent for every frame, as many numbers as names, in the topics of ROS."""
    for topic, schema, _, message in all_messages(run.path):
        if topic in (SENSORS, LANDMARKS, HUMAN_JOINTS):
            assert schema == "geometry_msgs/msg/PoseArray" and message["header"]["frame_id"] == "world"
            for pose in message["poses"]:
                assert norm(pose["orientation"]) == pytest.approx(1.0, abs=1e-4)
        elif topic == FRAMES:
            assert topic == "/tf" and message["transforms"]
            children = [one["child_frame_id"] for one in message["transforms"]]
            assert len(set(children)) == len(children) and "world" not in children
            for one in message["transforms"]:
                assert one["header"]["frame_id"] == "world" and all(map(math.isfinite, flat(one["transform"])))
                assert norm(one["transform"]["rotation"]) == pytest.approx(1.0, abs=1e-4)
        elif topic in (JOINTS, GOALS):
            assert len(message["name"]) == len(message["position"]) > 0
            assert len(message["velocity"]) in (0, len(message["name"])) and message["effort"] == []
        elif topic == EVENTS:
            assert message["level"] in (20, 30, 40) and message["name"] and message["msg"]


def norm(turn: dict[str, float]) -> float:
    return math.sqrt(sum(value**2 for value in turn.values()))


def flat(value: dict[str, Any]) -> list[float]:
    return [number for part in value.values() for number in part.values()]


def test_the_reader_that_ros_users_have_reads_the_same(run: Recorded) -> None:
    oracle = pytest.importorskip("mcap_ros2.decoder")
    ours = all_messages(run.path)
    with run.path.open("rb") as stream:
        reader = make_reader(stream, validate_crcs=True, decoder_factories=[oracle.DecoderFactory()])
        for (topic, schema, time, message), theirs in zip(ours, reader.iter_decoded_messages(), strict=True):
            assert theirs.schema is not None
            assert (theirs.channel.topic, theirs.schema.name, theirs.message.log_time) == (topic, schema, time)
            assert_same(message, theirs.decoded_message, topic)


def assert_same(ours: Any, theirs: Any, where: str) -> None:
    """Numbers to the bit; NaN is NaN."""
    if isinstance(ours, dict):
        for name, value in ours.items():
            assert_same(value, getattr(theirs, name), f"{where}.{name}")
    elif isinstance(ours, list):
        assert len(ours) == len(theirs), where
        for number, (own, other) in enumerate(zip(ours, theirs, strict=True)):
            assert_same(own, other, f"{where}[{number}]")
    else:
        assert ours == theirs or (ours != ours and theirs != theirs), where
