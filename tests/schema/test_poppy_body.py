"""The Poppy body against published numbers: joints at the model's zero pose, weight in known poses, servo zeros."""

import math

import mujoco
import numpy as np
import pytest

from posed_body import PosedBody
from retarget.model.robot import load_profile

Triple = tuple[float, float, float]

# Joint anchors in the pelvis' frame, m, and axes of the model at its own zero, arms out to the sides: computed.
# Where the servo turns the other way than the model's axis (direction -1), the software's angle does too.
T_POSE: dict[str, tuple[Triple, Triple]] = {
    "l_hip_x": ((0, 0.0225, 0), (-1, 0, 0)),
    "l_hip_z": ((0.005, 0.0665, 0), (0, 0, -1)),
    "l_hip_y": ((0.005, 0.0665, -0.024), (0, 1, 0)),
    "l_knee_y": ((0.005, 0.0665, -0.206), (0, 1, 0)),
    "l_ankle_y": ((0.005, 0.0665, -0.386), (0, 1, 0)),
    "r_hip_x": ((0, -0.0225, 0), (-1, 0, 0)),
    "r_hip_z": ((0.005, -0.0665, 0), (0, 0, -1)),
    "r_hip_y": ((0.005, -0.0665, -0.024), (0, -1, 0)),
    "r_knee_y": ((0.005, -0.0665, -0.206), (0, -1, 0)),
    "r_ankle_y": ((0.005, -0.0665, -0.386), (0, -1, 0)),
    "abs_y": ((0.017, 0, 0.061), (0, -1, 0)),
    "abs_x": ((0.017, 0, 0.061), (1, 0, 0)),
    "abs_z": ((0.017, 0, 0.1126), (0, 0, 1)),
    "bust_y": ((0.0198, 0, 0.1925), (0, -1, 0)),
    "bust_x": ((0.0198, 0, 0.1925), (1, 0, 0)),
    "head_z": ((0.0248, 0, 0.2765), (0, 0, 1)),
    "head_y": ((0.0248, 0, 0.2965), (0, -1, 0)),
    "l_shoulder_y": ((0.0238, 0.0771, 0.2425), (0, 1, 0)),
    "l_shoulder_x": ((0.0238, 0.1055, 0.2425), (0, 0, -1)),
    "l_arm_z": ((0.0238, 0.1418, 0.224), (0, 1, 0)),
    "l_elbow_y": ((0.0238, 0.2535, 0.234), (-1, 0, 0)),
    "r_shoulder_y": ((0.0238, -0.0771, 0.2425), (0, -1, 0)),
    "r_shoulder_x": ((0.0238, -0.1055, 0.2425), (0, 0, -1)),
    "r_arm_z": ((0.0238, -0.1417, 0.224), (0, -1, 0)),
    "r_elbow_y": ((0.0238, -0.2535, 0.234), (-1, 0, 0)),
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
POSES: list[tuple[dict[str, int], Triple]] = [
    ({}, (-0.028215, 7.9e-05, 0.468073)),
    (STAND_POSITION, (-0.014564, 0.000108, 0.470017)),
]


@pytest.fixture(scope="module")
def body() -> PosedBody:
    return PosedBody(load_profile("poppy"))


def in_rad(degrees: dict[str, int]) -> dict[str, float]:
    """Posture of this body for angles of the software on the specimen with the trim."""
    return {joint: math.radians(degrees.get(joint, 0) + TRIM.get(joint, 0)) for joint in {*degrees, *TRIM}}


@pytest.mark.parametrize("joint", T_POSE)
def test_anchor_and_axis_at_the_zero_of_the_model(body: PosedBody, joint: str) -> None:
    body.pose({name: math.radians(-offset) for name, offset in OFFSETS.items()})
    anchor, axis = body.anchor(joint)
    place, model_axis = T_POSE[joint]
    np.testing.assert_allclose(anchor, place, atol=1e-4)
    np.testing.assert_allclose(axis, body.profile.servos[joint].direction * np.array(model_axis), atol=1e-4)


@pytest.mark.parametrize(("degrees", "com"), POSES)
def test_centre_of_mass_of_published_poses(degrees: dict[str, int], com: Triple) -> None:
    light = PosedBody(load_profile("poppy"))
    for link, mass in MODEL_MASSES.items():
        light.model.body(f"{link}_link").mass = mass
    mujoco.mj_setConst(light.model, light.data)
    np.testing.assert_allclose(light.pose(in_rad(degrees)).com_in_stand_frame(), com, atol=7e-4)


def test_arms_hang_at_zero(body: PosedBody) -> None:
    body.pose({})
    for side in "lr":
        shoulder, elbow, hand = (body.at(f"{side}_{part}") for part in ("shoulder", "elbow", "hand"))
        assert (elbow - shoulder)[2] == pytest.approx(-0.148, abs=1e-3)
        np.testing.assert_allclose(hand - elbow, (0, 0, -0.2135), atol=1e-6)


@pytest.mark.parametrize(
    ("joint", "frame", "moved"),
    [
        ("l_shoulder_y", "l_hand", "x-"), ("r_shoulder_y", "r_hand", "x-"),
        ("l_shoulder_x", "l_hand", "y+"), ("r_shoulder_x", "r_hand", "y+"),
        ("l_elbow_y", "l_hand", "x-"), ("r_elbow_y", "r_hand", "x-"),
        ("l_hip_x", "l_sole", "y-"), ("r_hip_x", "r_sole", "y-"),
        ("l_hip_z", "l_toe", "y+"), ("r_hip_z", "r_toe", "y+"),
        ("l_hip_y", "l_sole", "x-"), ("r_hip_y", "r_sole", "x-"),
        ("l_knee_y", "l_sole", "x-"), ("r_knee_y", "r_sole", "x-"),
        ("l_ankle_y", "l_toe", "z-"), ("r_ankle_y", "r_toe", "z-"),
        ("abs_y", "head", "x+"), ("abs_x", "head", "y+"), ("bust_y", "head", "x+"), ("bust_x", "head", "y+"),
    ],
)  # fmt: skip
def test_where_15_degrees_of_the_software_move_what(body: PosedBody, joint: str, frame: str, moved: str) -> None:
    before = body.pose({}).at(frame)
    way = body.pose({joint: math.radians(15)}).at(frame) - before
    assert way["xyz".index(moved[0])] * float(moved[1] + "1") > 0.005


def test_zero_ticks_are_the_offsets_of_the_software(body: PosedBody) -> None:
    for joint, servo in body.profile.servos.items():
        count, turn, centre = (1024, 300.0, 512) if servo.model == "AX-12A" else (4096, 360.0, 2048)
        raw = servo.direction * OFFSETS.get(joint, 0)
        assert servo.zero_tick == round(centre + raw * count / turn), joint


def test_it_stands_on_the_flat_of_its_soles(body: PosedBody) -> None:
    body.pose(body.profile.postures.stand)
    for side, foot in (("l", "left"), ("r", "right")):
        plate = body.model.geom(f"{side}_sole_plate")
        np.testing.assert_allclose(plate.size[:2], body.profile.feet[foot].polygon[0], atol=2e-4)
        middle = body.data.geom(f"{side}_sole_plate").xpos - (0, 0, plate.size[2])
        np.testing.assert_allclose(body.at(f"{side}_sole"), middle, atol=1e-4)


def test_servos_and_lines(body: PosedBody) -> None:
    models = [servo.model for servo in body.profile.servos.values()]
    assert (models.count("MX-28"), models.count("MX-64"), models.count("AX-12A")) == (19, 4, 2)
    assert {bus.protocol for bus in body.profile.buses.values()} == {1}
    assert {servo.bus for joint, servo in body.profile.servos.items() if servo.id < 30} == {"lower"}
