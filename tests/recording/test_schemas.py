"""A recording holds what its own definitions say, for the reader that ROS users have."""

import math
from typing import Any

import pytest
from mcap.reader import DecodedMessageTuple, make_reader
from mcap_ros2.decoder import DecoderFactory

from recordings import Recorded, record
from retarget.recording.cdr import schema
from retarget.recording.topics import EVENTS, FRAMES, GOALS, HUMAN_JOINTS, JOINTS, LANDMARKS, SENSORS
from retarget.run.options import RunOptions

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
