"""The bodies of shipped robots against published numbers: joints, lengths, where the weight is in known poses."""

import math
from functools import cache

import mujoco
import numpy as np
import pytest

from observed import PosedBody
from retarget.model.robot import load_profile

Triple = tuple[float, float, float]
Anchors = dict[str, tuple[Triple, Triple]]


posed = cache(lambda name: PosedBody(load_profile(name)))


def assert_anchors(body: PosedBody, expected: Anchors, *, atol: float, axis_atol: float) -> None:
    for joint, (place, direction) in expected.items():
        anchor, axis = body.anchor(joint)
        np.testing.assert_allclose(anchor, place, atol=atol, err_msg=joint)
        np.testing.assert_allclose(axis, direction, atol=axis_atol, err_msg=joint)


def with_right(left: Anchors) -> Anchors:
    """The joints of a left side, and their mirror images."""
    return left | {"r" + name[1:]: ((x, -y, z), (a, -b, c)) for name, ((x, y, z), (a, b, c)) in left.items()}


# OP3.

# Zero-pose joint anchors in the base frame, m, and axes: computed from ROBOTIS' own model.
OP3_LEFT: Anchors = {
    "l_sho_pitch": ((-0.001, 0.06, 0.111), (0, 1, 0)),
    "l_sho_roll": ((0.018, 0.0885, 0.101), (-1, 0, 0)),
    "l_el": ((0.018, 0.1789, 0.1009), (1, 0, 0)),
    "l_hip_yaw": ((0, 0.035, 0), (0, 0, -1)),
    "l_hip_roll": ((-0.024, 0.035, -0.0285), (-1, 0, 0)),
    "l_hip_pitch": ((0.0001, 0.054, -0.0285), (0, 1, 0)),
    "l_knee": ((0.0001, 0.054, -0.13865), (0, 1, 0)),
    "l_ank_pitch": ((0.0001, 0.054, -0.24865), (0, -1, 0)),
    "l_ank_roll": ((-0.024, 0.035, -0.24865), (1, 0, 0)),
}
OP3_HEAD: Anchors = {"head_pan": ((-0.001, 0, 0.1365), (0, 0, 1)), "head_tilt": ((0.009, 0.019, 0.165), (0, -1, 0))}

# Stand frame (middle of the soles, made level): centre of mass, m. Poses of ROBOTIS' software, rad.
OP3_STANDUP = {
    "r_sho_pitch": 0.087437, "l_sho_pitch": -0.088971, "r_sho_roll": -0.794602, "l_sho_roll": 0.793068,
    "r_el": 0.788466, "l_el": -0.79, "l_hip_yaw": -0.001534, "r_hip_roll": 0.044485, "l_hip_roll": -0.046019,
    "r_hip_pitch": 0.161068, "l_hip_pitch": -0.162602, "r_knee": -0.233165, "l_knee": 0.231631,
    "r_ank_pitch": -0.158, "l_ank_pitch": 0.156466, "r_ank_roll": 0.021476, "l_ank_roll": -0.02301,
    "head_pan": 0.148796, "head_tilt": -0.006136,
}  # fmt: skip
OP3_WALK_READY = {
    "r_sho_pitch": 0.088971, "l_sho_pitch": -0.088971, "r_sho_roll": -0.785398, "l_sho_roll": 0.786932,
    "r_el": 0.78233, "l_el": -0.785398, "r_hip_yaw": -0.003068, "l_hip_yaw": -0.001534, "r_hip_roll": 0.035282,
    "l_hip_roll": -0.036816, "r_hip_pitch": 0.490874, "l_hip_pitch": -0.493942, "r_knee": -0.886641,
    "l_knee": 0.883573, "r_ank_pitch": -0.490874, "l_ank_pitch": 0.490874, "r_ank_roll": 0.033748,
    "l_ank_roll": -0.03835, "head_pan": -0.003068, "head_tilt": -0.17334,
}  # fmt: skip
OP3_CROUCH = {
    "r_sho_pitch": 0.261799, "l_sho_pitch": -0.261799, "r_sho_roll": -0.785398, "l_sho_roll": 0.785398,
    "r_el": 0.785398, "l_el": -0.785398, "r_hip_pitch": 1.22173, "l_hip_pitch": -1.22173, "r_knee": -2.478368,
    "l_knee": 2.478368, "r_ank_pitch": -1.22173, "l_ank_pitch": 1.22173, "head_tilt": -0.174533,
}  # fmt: skip
OP3_POSES: list[tuple[dict[str, float], Triple]] = [
    ({}, (-0.010568, 0.000072, 0.274312)),
    (OP3_STANDUP, (0.003469, 0.000027, 0.265685)),
    (OP3_WALK_READY, (0.007188, -0.000391, 0.250229)),
    (OP3_CROUCH, (-0.004291, 0.000072, 0.149202)),
]


def test_op3_anchors_and_axes_at_the_zero_pose() -> None:
    assert_anchors(posed("op3").pose({}), with_right(OP3_LEFT) | OP3_HEAD, atol=1e-9, axis_atol=1e-9)


# Wolfgang.

# Zero-pose joint anchors in the torso's frame, m, and axes; computed from the team's URDF.
WOLFGANG_RIGHT: Anchors = {
    "RShoulderPitch": ((-0.0015, -0.0765, 0.2035), (0, -1, 0)),
    "RShoulderRoll": ((0.01545, -0.1185, 0.2035), (-1, 0, 0)),
    "RElbow": ((-0.00805, -0.0945, 0.0595), (0, 1, 0)),
    "RHipYaw": ((0, -0.055, 0), (0, 0, -1)),
    "RHipRoll": ((-0.046, -0.055, -0.0414), (1, 0, 0)),
    "RHipPitch": ((0.0231, -0.0285, -0.0414), (0, 1, 0)),
    "RKnee": ((0.0192, -0.0795, -0.2104), (0, -1, 0)),
    "RAnklePitch": ((0.0632, -0.029, -0.3747), (0, -1, 0)),
    "RAnkleRoll": ((-0.0036, -0.055, -0.3925), (-0.966, 0, -0.259)),
}
WOLFGANG_LEFT: Anchors = {
    "LShoulderPitch": ((-0.0015, 0.0765, 0.2035), (0, 1, 0)),
    "LShoulderRoll": ((0.0155, 0.1185, 0.2035), (-1, 0, 0)),
    "LElbow": ((-0.008, 0.0945, 0.0595), (0, -1, 0)),
    "LHipYaw": ((0, 0.055, 0), (0, 0, -1)),
    "LHipRoll": ((-0.046, 0.055, -0.0414), (1, 0, 0)),
    "LHipPitch": ((0.0231, 0.029, -0.0414), (0, -1, 0)),
    "LKnee": ((0.0187, 0.078, -0.2102), (0, 1, 0)),
    "LAnklePitch": ((0.0627, 0.0275, -0.3744), (0, 1, 0)),
    "LAnkleRoll": ((-0.004, 0.0535, -0.3923), (-0.966, 0, -0.259)),
}
WOLFGANG_HEAD: Anchors = {
    "HeadPan": ((-0.0095, 0, 0.2345), (0, 0, 1)),
    "HeadTilt": ((0.0265, -0.0235, 0.2585), (0, -1, 0)),
}
EXPORT_SLIP = 1.7e-3  # [m] by which the URDF's left leg misses the mirror image of the right one

WOLFGANG_WALK_READY = {
    "LShoulderPitch": 0.599379, "LShoulderRoll": -0.001778, "LElbow": 0.303843, "RShoulderPitch": -0.602554,
    "RShoulderRoll": 0.001772, "RElbow": -0.304506, "LHipYaw": -0.016442, "LHipRoll": 0.072538, "LHipPitch": 0.742081,
    "LKnee": 1.334528, "LAnklePitch": -0.55374, "LAnkleRoll": 0.074374, "RHipYaw": 0.023628, "RHipRoll": -0.104018,
    "RHipPitch": -0.735263, "RKnee": -1.322842, "RAnklePitch": 0.549504, "RAnkleRoll": -0.129135,
}  # fmt: skip
WOLFGANG_PARTLY_BENT = {
    "LHipPitch": 0.7, "LKnee": 1.0, "LAnklePitch": -0.4, "RHipPitch": -0.7, "RKnee": -1.0, "RAnklePitch": 0.4,
}  # fmt: skip
# Centre of mass, m, in the stand frame, with the kilogram on the torso.
WOLFGANG_POSES: list[tuple[dict[str, float], Triple]] = [
    ({}, (0.0339, -0.0007, 0.4203)),
    (WOLFGANG_WALK_READY, (0.0013, 0.007, 0.3921)),
    (WOLFGANG_PARTLY_BENT, (0.0239, -0.0007, 0.4066)),
]


def test_wolfgang_anchors_and_axes_at_the_zero_pose() -> None:
    """The left side is that of the model but for its slip."""
    assert_anchors(posed("wolfgang").pose({}), WOLFGANG_RIGHT | WOLFGANG_HEAD, atol=6e-5, axis_atol=2e-4)
    assert_anchors(posed("wolfgang").pose({}), WOLFGANG_LEFT, atol=EXPORT_SLIP, axis_atol=2e-4)


@pytest.mark.parametrize(
    ("name", "atol", "joints", "com"),
    [("op3", 2e-6, *row) for row in OP3_POSES] + [("wolfgang", EXPORT_SLIP, *row) for row in WOLFGANG_POSES],
)
def test_the_centre_of_mass_of_published_poses(name: str, atol: float, joints: dict[str, float], com: Triple) -> None:
    np.testing.assert_allclose(posed(name).pose(joints).com_in_stand_frame(), com, atol=atol)


def test_wolfgang_stands_on_its_cleats() -> None:
    """Lowest points of the cleats are the corners of the support polygon."""
    body = posed("wolfgang").pose(posed("wolfgang").profile.postures.stand)
    cleats = [name for name in (body.model.geom(index).name for index in range(body.model.ngeom)) if "cleat" in name]
    assert len(cleats) == 8
    lowest = np.array([body.data.geom(name).xpos - (0, 0, body.model.geom(name).size[0]) for name in cleats])
    corners = body.sole_corners()
    for corner in corners:
        assert np.linalg.norm(lowest - corner, axis=1).min() < 1e-5
    plate = body.data.geom("l_foot_shell").xpos[2] - body.model.geom("l_foot_shell").size[2]
    assert plate > corners[:, 2].max() + 0.008


# Poppy.

# Joint anchors in the pelvis' frame, m, and axes of the model at its own zero, arms out to the sides: computed.
# Where the servo turns the other way than the model's axis (direction -1), the software's angle does too.
T_POSE: Anchors = {
    **with_right(
        {
            "l_hip_x": ((0, 0.0225, 0), (-1, 0, 0)),
            "l_hip_z": ((0.005, 0.0665, 0), (0, 0, -1)),
            "l_hip_y": ((0.005, 0.0665, -0.024), (0, 1, 0)),
            "l_knee_y": ((0.005, 0.0665, -0.206), (0, 1, 0)),
            "l_ankle_y": ((0.005, 0.0665, -0.386), (0, 1, 0)),
            "l_shoulder_y": ((0.0238, 0.0771, 0.2425), (0, 1, 0)),
            "l_shoulder_x": ((0.0238, 0.1055, 0.2425), (0, 0, -1)),
            "l_arm_z": ((0.0238, 0.1418, 0.224), (0, 1, 0)),
            "l_elbow_y": ((0.0238, 0.2535, 0.234), (-1, 0, 0)),
        }
    ),
    "r_arm_z": ((0.0238, -0.1417, 0.224), (0, -1, 0)),
    "abs_y": ((0.017, 0, 0.061), (0, -1, 0)),
    "abs_x": ((0.017, 0, 0.061), (1, 0, 0)),
    "abs_z": ((0.017, 0, 0.1126), (0, 0, 1)),
    "bust_y": ((0.0198, 0, 0.1925), (0, -1, 0)),
    "bust_x": ((0.0198, 0, 0.1925), (1, 0, 0)),
    "head_z": ((0.0248, 0, 0.2765), (0, 0, 1)),
    "head_y": ((0.0248, 0, 0.2965), (0, -1, 0)),
}
OFFSETS = {"head_y": 20, "l_shoulder_y": 90, "l_shoulder_x": -90, "r_shoulder_y": 90, "r_shoulder_x": 90}  # [degrees]
TRIM = {"l_hip_y": 2}  # [degrees] of the specimen whose poses are published

# Masses with which the centres of mass below were computed, kg.
MODEL_MASSES = {
    "pelvis": 0.1852, "r_hip": 0.08438, "r_hip_motor": 0.08317, "r_thigh": 0.11639, "r_shin": 0.11558,
    "r_foot": 0.04679, "l_hip": 0.08438, "l_hip_motor": 0.08317, "l_thigh": 0.11485, "l_shin": 0.11558,
    "l_foot": 0.04683, "abs_motors": 0.16767, "abdomen": 0.03841, "spine": 0.09268, "bust_motors": 0.15888,
    "chest": 0.26293, "neck": 0.00588, "head": 0.18856, "l_shoulder": 0.00844, "l_shoulder_motor": 0.08281,
    "l_upper_arm": 0.16814, "l_forearm": 0.04865, "r_shoulder": 0.00848, "r_shoulder_motor": 0.08281,
    "r_upper_arm": 0.16814, "r_forearm": 0.04865,
}  # fmt: skip
STAND_POSITION = {
    "r_hip_z": -2, "l_hip_z": 2, "r_hip_x": -2, "l_hip_x": 2, "l_shoulder_x": 20, "r_shoulder_x": -20,
    "l_shoulder_y": 10, "r_shoulder_y": 10, "l_elbow_y": -20, "r_elbow_y": -20, "l_ankle_y": -3, "r_ankle_y": -2,
    "abs_y": -2, "head_y": 1,
}  # fmt: skip
# Degrees of the software, and the centre of mass in the stand frame, m.
POPPY_POSES: list[tuple[dict[str, int], Triple]] = [
    ({}, (-0.028215, 7.9e-05, 0.468073)),
    (STAND_POSITION, (-0.014564, 0.000108, 0.470017)),
]


def test_poppy_anchors_and_axes_at_the_zero_of_the_model() -> None:
    poppy = posed("poppy")
    signs = {joint: servo.direction for joint, servo in poppy.profile.servos.items()}
    expected: Anchors = {
        joint: (place, (signs[joint] * x, signs[joint] * y, signs[joint] * z))
        for joint, (place, (x, y, z)) in T_POSE.items()
    }
    poppy.pose({name: math.radians(-offset) for name, offset in OFFSETS.items()})
    assert_anchors(poppy, expected, atol=1e-4, axis_atol=1e-4)


@pytest.mark.parametrize(("degrees", "com"), POPPY_POSES)
def test_poppy_centre_of_mass_of_published_poses(degrees: dict[str, int], com: Triple) -> None:
    light = PosedBody(load_profile("poppy"))
    for link, mass in MODEL_MASSES.items():
        light.model.body(f"{link}_link").mass = mass
    mujoco.mj_setConst(light.model, light.data)
    angles = {joint: math.radians(degrees.get(joint, 0) + TRIM.get(joint, 0)) for joint in {*degrees, *TRIM}}
    np.testing.assert_allclose(light.pose(angles).com_in_stand_frame(), com, atol=7e-4)


MOVED = {
    "{}_shoulder_y": "{}_hand x-", "{}_shoulder_x": "{}_hand y+", "{}_elbow_y": "{}_hand x-",
    "{}_hip_x": "{}_sole y-", "{}_hip_z": "{}_toe y+", "{}_hip_y": "{}_sole x-",
    "{}_knee_y": "{}_sole x-", "{}_ankle_y": "{}_toe z-",
    "abs_y": "head x+", "abs_x": "head y+", "bust_y": "head x+", "bust_x": "head y+",
}  # fmt: skip
"""What 15 degrees of the software move, on both sides, and where."""


@pytest.mark.parametrize("joint", MOVED)
def test_where_15_degrees_of_the_software_move_what(joint: str) -> None:
    poppy = posed("poppy")
    for side in ("l", "r") if "{}" in joint else ("",):
        frame, axis = MOVED[joint].format(side).split()
        before = poppy.pose({}).at(frame)
        moved = poppy.pose({joint.format(side): math.radians(15)}).at(frame) - before
        assert moved["xyz".index(axis[0])] * float(axis[1] + "1") > 0.005, side


def test_poppy_stands_on_the_flat_of_its_soles_with_the_offsets_of_the_software() -> None:
    poppy = posed("poppy")
    for joint, servo in poppy.profile.servos.items():
        count, turn, centre = (1024, 300.0, 512) if servo.model == "AX-12A" else (4096, 360.0, 2048)
        assert servo.zero_tick == round(centre + servo.direction * OFFSETS.get(joint, 0) * count / turn), joint
    poppy.pose(poppy.profile.postures.stand)
    for side, foot in (("l", "left"), ("r", "right")):
        plate = poppy.model.geom(f"{side}_sole_plate")
        np.testing.assert_allclose(plate.size[:2], poppy.profile.feet[foot].polygon[0], atol=2e-4)
        middle = poppy.data.geom(f"{side}_sole_plate").xpos - (0, 0, plate.size[2])
        np.testing.assert_allclose(poppy.at(f"{side}_sole"), middle, atol=1e-4)
