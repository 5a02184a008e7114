"""The ToddlerBot against published numbers: body, coupled waist, gears, turns; and its postures against statics."""

from dataclasses import replace
from functools import cache
from itertools import product

import mujoco
import numpy as np
import pytest
from numpy.typing import NDArray

from hardware.errors import HardwareError
from hardware.joint_map import JointMap
from hardware.servo import ServoMode
from messages import refuses
from observed import PosedBody
from retarget.model.robot import load_profile

Array = NDArray[np.float64]

# Zero pose: joint anchors in the base frame, m, and axes, as published.
PLACES = {
    "neck_yaw": ((-0.0005, 0, 0.124), (0, 0, 1)),
    "neck_pitch": ((-0.0005, 0.004, 0.139), (0, 1, 0)),
    "waist_yaw": ((-0.0165, 0, -0.0025), (0, 0, 1)),
    "waist_roll": ((0.0065, 0, -0.0165), (1, 0, 0)),
    "left_hip_pitch": ((-0.0162, 0.018, -0.0646), (0, 1, 0)),
    "left_hip_roll": ((0.0028, 0.037, -0.0886), (1, 0, 0)),
    "left_hip_yaw": ((-0.0162, 0.037, -0.1216), (0, 0, -1)),
    "left_knee": ((-0.0162, 0.018, -0.1661), (0, -1, 0)),
    "left_ankle_roll": ((-0.0392, 0.037, -0.2761), (1, 0, 0)),
    "left_ankle_pitch": ((-0.0162, 0.018, -0.2761), (0, 1, 0)),
    "left_shoulder_pitch": ((-0.02, 0.067, 0.1018), (0, 1, 0)),
    "left_shoulder_roll": ((-0.039, 0.094, 0.1018), (1, 0, 0)),
    "left_shoulder_yaw": ((-0.02, 0.094, 0.0767), (0, 0, -1)),
    "left_elbow_roll": ((-0.039, 0.094, 0.0157), (1, 0, 0)),
    "left_elbow_yaw": ((-0.02, 0.094, -0.0093), (0, 0, -1)),
    "left_wrist_pitch": ((-0.02, 0.116, -0.0703), (0, -1, 0)),
    "left_wrist_roll": ((-0.039, 0.094, -0.0703), (-1, 0, 0)),
    "right_hip_pitch": ((-0.0162, -0.018, -0.0646), (0, -1, 0)),
    "right_hip_roll": ((-0.0352, -0.037, -0.0886), (-1, 0, 0)),
    "right_hip_yaw": ((-0.0162, -0.037, -0.1216), (0, 0, -1)),
    "right_knee": ((-0.0162, -0.018, -0.1661), (0, 1, 0)),
    "right_ankle_roll": ((-0.0392, -0.037, -0.2761), (1, 0, 0)),
    "right_ankle_pitch": ((-0.0162, -0.018, -0.2761), (0, -1, 0)),
    "right_shoulder_pitch": ((-0.02, -0.067, 0.1018), (0, -1, 0)),
    "right_shoulder_roll": ((-0.001, -0.094, 0.1018), (-1, 0, 0)),
    "right_shoulder_yaw": ((-0.02, -0.094, 0.0767), (0, 0, -1)),
    "right_elbow_roll": ((-0.001, -0.094, 0.0157), (-1, 0, 0)),
    "right_elbow_yaw": ((-0.02, -0.094, -0.0093), (0, 0, -1)),
    "right_wrist_pitch": ((-0.02, -0.116, -0.0703), (0, 1, 0)),
    "right_wrist_roll": ((-0.001, -0.094, -0.0703), (1, 0, 0)),
}
SAME_SIGN = ("hip_roll", "shoulder_roll", "elbow_roll", "wrist_roll")
"""Joints with which a mirrored posture has the same sign on both sides; all others have the opposite one."""
HOME = {
    "left_hip_pitch": -0.091312, "left_knee": -0.380812, "left_ankle_pitch": -0.2895, "left_shoulder_pitch": 0.174533,
    "left_shoulder_roll": 0.087266, "left_shoulder_yaw": -1.570796, "left_elbow_roll": -0.523599,
    "left_elbow_yaw": 1.570796, "left_wrist_pitch": 1.22173,
}  # fmt: skip
TICK = 2.0 * np.pi / 4096.0


def both(left: dict[str, float]) -> dict[str, float]:
    """The posture with its right side, a mirror image of the left one."""
    right = {name.removeprefix("left_"): angle for name, angle in left.items()}
    return left | {f"right_{name}": angle if name in SAME_SIGN else -angle for name, angle in right.items()}


@cache
def body() -> PosedBody:
    return PosedBody(load_profile("toddlerbot"))


@cache
def joint_map() -> JointMap:
    return JointMap(body().profile.servo_specs())


@pytest.mark.parametrize(("joint", "place"), PLACES.items())
def test_anchor_and_axis_at_the_zero_pose(joint: str, place: tuple[tuple[float, ...], tuple[float, ...]]) -> None:
    anchor, axis = body().pose({}).anchor(joint)
    np.testing.assert_allclose(anchor, place[0], atol=6e-5)  # published with four decimals
    np.testing.assert_allclose(axis, place[1], atol=1e-12)


@pytest.mark.parametrize(
    ("joints", "com"),
    [({}, (-0.019405, -0.001142, 0.285898)), (both(HOME), (0.000606, -0.00117, 0.282278))],
    ids=["zero", "home"],
)
def test_centre_of_mass_of_published_poses(joints: dict[str, float], com: tuple[float, float, float]) -> None:
    """The published foot is 0.03 mm lower, and 30 g of gears and rods sit where they are carried."""
    np.testing.assert_allclose(body().pose(joints).com_in_stand_frame(), com, atol=2e-4)


def test_ranges_and_ids_are_those_of_the_servos() -> None:
    names = [body().model.actuator(index).name for index in range(30)]
    assert names == list(joint_map().joints)
    assert [servo.id for servo in joint_map().servos] == list(range(30))
    for joint, servo in body().profile.servos.items():
        np.testing.assert_allclose(body().model.joint(joint).range, servo.limits, atol=1e-6)


@pytest.mark.parametrize(
    ("roll", "yaw", "ticks"),
    [(0.0, 0.0, (2048, 2048)), (0.3, -0.7, (618, 1288)), (0.5, 0.0, (1489, 2607)), (0.0, 1.2, (3925, 3925))],
)
def test_ticks_of_the_waist(roll: float, yaw: float, ticks: tuple[int, int]) -> None:
    joints = np.zeros(30)
    joints[2:4] = roll, yaw
    assert tuple(joint_map().to_ticks(joints)[2:4]) == ticks
    shafts = np.array([-roll / 0.29166667 + yaw / 0.20833333, roll / 0.29166667 + yaw / 0.20833333]) / 2.0
    assert tuple(np.rint(2048 + shafts / TICK)) == ticks, "by the makers' formula"


@pytest.mark.parametrize(
    ("joint", "angle", "tick"),
    [
        ("neck_yaw", 0.5, 1689),  # geared 1 : 1.1, and turned round
        ("left_hip_yaw", 0.4, 1744),  # 1 : 7/6
        ("right_hip_yaw", -0.4, 2352),
        ("left_shoulder_yaw", -1.0, 2700),
        ("left_knee", -1.0, 1396),
        ("right_knee", 1.0, 2700),
    ],
)
def test_ticks_of_a_geared_joint(joint: str, angle: float, tick: int) -> None:
    joints, place = np.zeros(30), joint_map().joints.index(joint)
    joints[place] = angle
    assert joint_map().to_ticks(joints)[place] == tick


def test_a_waist_beyond_its_servos_is_refused() -> None:
    one_turn = [replace(servo, mode=ServoMode.POSITION) for servo in joint_map().servos]
    with refuses(HardwareError, "waist_roll", "waist_yaw", -493, 4589):
        JointMap(one_turn)
    fast = [replace(servo, max_velocity=3.0) if servo.id == 3 else servo for servo in joint_map().servos]
    with refuses(HardwareError, "max_velocity", "waist_roll", "waist_yaw"):
        JointMap(fast)


def test_pairs_that_are_not_checked_cannot_touch() -> None:
    """But the hip's bracket and the pelvis, which are nested."""
    model, random, between = body().model, np.random.default_rng(9), np.zeros(6)
    pairs = [entry.pair for entry in body().profile.ignore_pairs if "cannot touch" in entry.reason]
    solid = [geom for geom in range(model.ngeom) if model.geom_contype[geom] or model.geom_conaffinity[geom]]
    geoms = [[[geom for geom in solid if model.geom_bodyid[geom] == model.body(link).id] for link in pair]
             for pair in pairs]  # fmt: skip
    assert all(ours and theirs for ours, theirs in geoms)
    assert len(pairs) == 14
    ends = joint_map()
    inside = random.uniform(ends.lower, ends.upper, (400, len(ends)))
    at_end = np.where(random.random(inside.shape) < 0.5, ends.lower, ends.upper)  # many joints at a limit
    for posture in np.where(random.random(inside.shape) < 0.25, at_end, inside):
        posed = body().pose(dict(zip(joint_map().joints, posture.tolist(), strict=True)))
        for pair, (ours, theirs) in zip(pairs, geoms, strict=True):
            for one, other in product(ours, theirs):
                assert mujoco.mj_geomDistance(model, posed.data, one, other, 0.01, between) > 0.001, pair
