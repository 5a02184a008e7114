"""Which servos lie between frames: by hand for the OP3, and where nothing lies between."""

import pytest

from followers import op3
from retarget.model.robot import RobotBody, joints_between, load_robot

ARM = {"l_sho_pitch", "l_sho_roll", "l_el"}
LEG = {"hip_yaw", "hip_roll", "hip_pitch", "knee", "ank_pitch", "ank_roll"}


def names(robot: RobotBody, frame: str, others: list[str]) -> set[str]:
    found = joints_between(robot, frame, others)
    return {joint for joint, between in zip(robot.joint_map.joints, found, strict=True) if between}


@pytest.mark.parametrize(
    ("frame", "others", "joints"),
    [
        ("l_hand", ["l_shoulder"], ARM),
        ("l_shoulder", ["l_hand"], ARM),
        ("l_elbow", ["l_hand"], set(op3().joint_map.joints)),  # on one link
        ("pelvis", ["l_sole"], {f"l_{joint}" for joint in LEG}),
        ("pelvis", ["l_sole", "r_sole"], {f"{side}_{joint}" for joint in LEG for side in "lr"}),
        ("l_sole", ["r_sole"], {f"{side}_{joint}" for joint in LEG for side in "lr"}),
        ("head", ["neck"], {"head_pan", "head_tilt"}),
        ("head", ["l_hand"], ARM | {"head_pan", "head_tilt"}),
        ("head", [], set(op3().joint_map.joints)),
    ],
)
def test_joints_on_the_way_of_the_op3(frame: str, others: list[str], joints: set[str]) -> None:
    assert names(op3(), frame, others) == joints


def test_a_waist_lies_between_trunk_and_soles_but_not_between_hand_and_shoulder() -> None:
    toddlerbot = load_robot("toddlerbot")
    assert {"waist_roll", "waist_yaw"} <= names(toddlerbot, "neck", ["l_sole", "r_sole"])
    assert not {"waist_roll", "waist_yaw"} & names(toddlerbot, "l_hand", ["l_shoulder"])
    assert not {"waist_roll", "waist_yaw"} & names(toddlerbot, "pelvis", ["l_ankle", "r_ankle"])
