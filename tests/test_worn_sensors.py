"""The worn sensors out of a source's samples."""

import numpy as np
import pytest

from retarget import rotations
from retarget.frames import SensorSample
from retarget.human import build_human
from retarget.human_dimensions import POINTS, proportional_dimensions
from retarget.human_joints import HUMAN_JOINTS
from retarget.performer import Performer, WornSensor
from retarget.worn_sensors import WornSensors

HUMAN = build_human(proportional_dimensions(1.75))
PERFORMER = Performer(
    name="p",
    description="p",
    sensors={
        "head": WornSensor(joint="head", orientation=True),
        "l_wrist": WornSensor(joint="l_wrist", orientation=True),
        "pelvis": WornSensor(joint="pelvis"),
    },
)
TURN = rotations.from_axis_angle(np.array([0.0, 0.0, 1.0]), np.array(0.5))


def sample() -> SensorSample:
    return SensorSample(
        ("l_wrist", "head"), np.arange(6.0).reshape(2, 3), np.stack([TURN, TURN]), np.array([True, True])
    )


def test_rows_are_the_performers_whatever_the_source_has() -> None:
    worn = WornSensors(PERFORMER, HUMAN, None)
    position, valid = worn.read(sample())
    assert worn.names == ("head", "l_wrist", "pelvis") and [POINTS[i] for i in worn.joints] == list(worn.names)
    assert position[:2] == pytest.approx(np.array([[3.0, 4.0, 5.0], [0.0, 1.0, 2.0]]))
    assert list(valid) == [True, True, False]


def test_positions_that_are_no_numbers_are_not_valid() -> None:
    broken = sample()
    broken.position[1, 2] = np.nan
    _, valid = WornSensors(PERFORMER, HUMAN, None).read(broken)
    assert list(valid) == [False, True, False]


def test_orientations_are_those_of_the_links() -> None:
    """The wrist sensor is the identity in a T-pose, where the hand hangs to the side."""
    rest = np.tile(rotations.IDENTITY, (len(HUMAN_JOINTS), 1))
    t_pose = rotations.from_axis_angle(np.array([1.0, 0.0, 0.0]), np.array(np.pi / 2))
    rest[[joint.name for joint in HUMAN_JOINTS].index("l_wrist")] = t_pose
    worn = WornSensors(PERFORMER, HUMAN, rest)
    worn.read(sample())
    head, hand = worn.orientations(sample())
    assert (head.sensor, hand.sensor) == ("head", "l_wrist")
    assert head.link == pytest.approx(TURN) and head.forward == pytest.approx((np.cos(0.5), np.sin(0.5)))
    assert hand.link == pytest.approx(rotations.multiply(TURN, t_pose))


def test_unknown_orientations_are_left_out() -> None:
    unknown = sample()
    unknown.orientation[0] = np.nan
    worn = WornSensors(PERFORMER, HUMAN, None)
    worn.read(unknown)
    assert [turn.sensor for turn in worn.orientations(unknown)] == ["head"]
