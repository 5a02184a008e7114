"""The OP3 body against published numbers, and the postures of its profile against statics and collisions."""

from pathlib import Path

import numpy as np
import pytest

from posed_body import PosedBody
from retarget.model.robot import load_profile

# Zero-pose joint anchors in the base frame, m, and axes: computed from ROBOTIS' own model.
LEFT = {
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
PITCH = ("sho_pitch", "hip_pitch", "knee", "ank_pitch")
RIGHT = {
    "r" + name[1:]: ((x, -y, z), tuple(-a for a in axis) if name[2:] in PITCH else axis)
    for name, ((x, y, z), axis) in LEFT.items()
}
HEAD = {"head_pan": ((-0.001, 0, 0.1365), (0, 0, 1)), "head_tilt": ((0.009, 0.019, 0.165), (0, -1, 0))}

# Stand frame (middle of the soles, made level): centre of mass, m. Poses of ROBOTIS' software, rad.
ZERO: dict[str, float] = {}
STANDUP = {
    "r_sho_pitch": 0.087437, "l_sho_pitch": -0.088971, "r_sho_roll": -0.794602, "l_sho_roll": 0.793068,
    "r_el": 0.788466, "l_el": -0.79, "l_hip_yaw": -0.001534, "r_hip_roll": 0.044485, "l_hip_roll": -0.046019,
    "r_hip_pitch": 0.161068, "l_hip_pitch": -0.162602, "r_knee": -0.233165, "l_knee": 0.231631,
    "r_ank_pitch": -0.158, "l_ank_pitch": 0.156466, "r_ank_roll": 0.021476, "l_ank_roll": -0.02301,
    "head_pan": 0.148796, "head_tilt": -0.006136,
}  # fmt: skip
WALK_READY = {
    "r_sho_pitch": 0.088971, "l_sho_pitch": -0.088971, "r_sho_roll": -0.785398, "l_sho_roll": 0.786932,
    "r_el": 0.78233, "l_el": -0.785398, "r_hip_yaw": -0.003068, "l_hip_yaw": -0.001534, "r_hip_roll": 0.035282,
    "l_hip_roll": -0.036816, "r_hip_pitch": 0.490874, "l_hip_pitch": -0.493942, "r_knee": -0.886641,
    "l_knee": 0.883573, "r_ank_pitch": -0.490874, "l_ank_pitch": 0.490874, "r_ank_roll": 0.033748,
    "l_ank_roll": -0.03835, "head_pan": -0.003068, "head_tilt": -0.17334,
}  # fmt: skip
CROUCH = {
    "r_sho_pitch": 0.261799, "l_sho_pitch": -0.261799, "r_sho_roll": -0.785398, "l_sho_roll": 0.785398,
    "r_el": 0.785398, "l_el": -0.785398, "r_hip_pitch": 1.22173, "l_hip_pitch": -1.22173, "r_knee": -2.478368,
    "l_knee": 2.478368, "r_ank_pitch": -1.22173, "l_ank_pitch": 1.22173, "head_tilt": -0.174533,
}  # fmt: skip
POSES = [
    (ZERO, (-0.010568, 0.000072, 0.274312)),
    (STANDUP, (0.003469, 0.000027, 0.265685)),
    (WALK_READY, (0.007188, -0.000391, 0.250229)),
    (CROUCH, (-0.004291, 0.000072, 0.149202)),
]
POSTURES = ("neutral", "stand", "rest", "attractor")


@pytest.fixture(scope="module")
def body(root: Path) -> PosedBody:
    return PosedBody(load_profile(root / "configs" / "robots" / "op3"))


def test_size_and_mass(body: PosedBody) -> None:
    assert (body.model.nq, body.model.nv, body.model.nu) == (27, 26, 20)
    assert body.model.body_mass.sum() == pytest.approx(3.14747, abs=1e-9)


@pytest.mark.parametrize(("joint", "place"), [*LEFT.items(), *RIGHT.items(), *HEAD.items()])
def test_anchor_and_axis_at_the_zero_pose(
    body: PosedBody, joint: str, place: tuple[tuple[float, ...], tuple[float, ...]]
) -> None:
    body.pose({})
    found = body.data.joint(joint)
    np.testing.assert_allclose(found.xanchor - body.data.qpos[:3], place[0], atol=1e-9)
    np.testing.assert_allclose(found.xaxis, place[1], atol=1e-9)


@pytest.mark.parametrize(("joints", "com"), POSES)
def test_centre_of_mass_of_published_poses(
    body: PosedBody, joints: dict[str, float], com: tuple[float, float, float]
) -> None:
    np.testing.assert_allclose(body.pose(joints).com_in_stand_frame(), com, atol=2e-6)


def test_joint_ranges_are_those_of_the_servos(body: PosedBody) -> None:
    for joint, servo in body.profile.servos.items():
        np.testing.assert_allclose(body.model.joint(joint).range, servo.limits, atol=1e-6)


def test_servo_ids_follow_the_actuators(body: PosedBody) -> None:
    names = [body.model.actuator(index).name for index in range(body.model.nu)]
    assert names == sorted(body.profile.servos, key=lambda joint: body.profile.servos[joint].id)
    assert list(body.profile.servos) == names


def test_a_pose_that_touches_is_seen(body: PosedBody) -> None:
    assert ("l_hip_roll_link", "l_ank_pitch_link") in body.pose(CROUCH).touching()


@pytest.mark.parametrize("name", [name for name in POSTURES if name != "rest"])
def test_postures_stand_flat_and_balanced(body: PosedBody, name: str) -> None:
    body.pose(getattr(body.profile.postures, name))
    for foot in body.profile.feet.values():
        np.testing.assert_allclose(body.frame(foot.frame)[1], np.eye(3), atol=1e-9)
    assert np.ptp(body.sole_corners()[:, 2]) < 1e-9
    assert body.support_margin() > 0.05
    assert abs(body.com_in_stand_frame()[0]) < 0.01


def test_at_rest_it_leans_so_that_torso_and_arms_balance(body: PosedBody) -> None:
    body.pose(body.profile.postures.rest)
    left, right = (body.frame(foot.frame)[1] for foot in body.profile.feet.values())
    np.testing.assert_allclose(left, right, atol=1e-9)
    np.testing.assert_allclose(left[:, 1], [0.0, 1.0, 0.0], atol=1e-9)  # forward, not aside
    assert 0.0 < np.degrees(np.arccos(left[0, 0])) < 5.0


def test_postures_are_mirror_images(body: PosedBody) -> None:
    for name in POSTURES:
        body.pose(getattr(body.profile.postures, name))
        for frame in [frame for frame in body.profile.frames if frame.startswith("l_")]:
            np.testing.assert_allclose(body.at(frame) * (1, -1, 1), body.at("r" + frame[1:]), atol=1e-9)


def test_soles_start_on_the_ground(body: PosedBody) -> None:
    body.pose({})
    assert body.at("l_sole")[2] == pytest.approx(0.0, abs=1e-9)
    assert body.data.geom("l_foot_wide").xpos[2] - 0.004 == pytest.approx(0.0, abs=1e-9)


def test_landmarks_ask_for_less_than_the_stretched_limb(body: PosedBody) -> None:
    body.pose({})
    landmarks = body.profile.landmarks
    arm = np.linalg.norm(body.at("l_hand") - body.at("l_shoulder"))
    leg = np.linalg.norm(body.at("l_ankle") - body.at("l_hip"))
    assert arm - 0.015 < landmarks["l_hand"].robot_length < arm
    assert leg - 0.015 < landmarks["l_sole"].robot_length < leg
    assert landmarks["pelvis"].robot_length == landmarks["l_sole"].robot_length
    trunk = body.at("head") - body.at("pelvis")
    assert landmarks["head"].robot_length == pytest.approx(np.linalg.norm(trunk), abs=1e-3)
    np.testing.assert_allclose(body.at("l_sole") - body.at("l_ankle"), landmarks["l_sole"].offset, atol=2e-4)


def test_observers_cover_their_links_loosely(body: PosedBody) -> None:
    """Ends of each capsule lie inside the shell of its link, so that none floats off it."""
    for name, observer in body.profile.observers.items():
        capsule = observer.shape.capsule
        if capsule is None:
            continue
        shell = body.model.geom(observer.link.removesuffix("_link") + "_shell")
        for end in (capsule.start, capsule.end):
            assert np.all(np.abs(np.array(end) - shell.pos) <= shell.size), name
