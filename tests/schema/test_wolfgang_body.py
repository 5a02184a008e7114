"""The Wolfgang body against published numbers: joints at the zero pose, lengths, where its weight is in known poses."""

import numpy as np
import pytest

from posed_body import PosedBody
from retarget.model.robot import load_profile

Triple = tuple[float, float, float]

# Zero-pose joint anchors in the torso's frame, m, and axes; computed from the team's URDF.
RIGHT: dict[str, tuple[Triple, Triple]] = {
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
LEFT: dict[str, tuple[Triple, Triple]] = {
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
HEAD: dict[str, tuple[Triple, Triple]] = {
    "HeadPan": ((-0.0095, 0, 0.2345), (0, 0, 1)),
    "HeadTilt": ((0.0265, -0.0235, 0.2585), (0, -1, 0)),
}
EXPORT_SLIP = 1.7e-3  # [m] by which the URDF's left leg misses the mirror image of the right one

WALK_READY = {
    "LShoulderPitch": 0.599379, "LShoulderRoll": -0.001778, "LElbow": 0.303843, "RShoulderPitch": -0.602554,
    "RShoulderRoll": 0.001772, "RElbow": -0.304506, "LHipYaw": -0.016442, "LHipRoll": 0.072538, "LHipPitch": 0.742081,
    "LKnee": 1.334528, "LAnklePitch": -0.55374, "LAnkleRoll": 0.074374, "RHipYaw": 0.023628, "RHipRoll": -0.104018,
    "RHipPitch": -0.735263, "RKnee": -1.322842, "RAnklePitch": 0.549504, "RAnkleRoll": -0.129135,
}  # fmt: skip
PARTLY_BENT = {
    "LHipPitch": 0.7, "LKnee": 1.0, "LAnklePitch": -0.4, "RHipPitch": -0.7, "RKnee": -1.0, "RAnklePitch": 0.4,
}  # fmt: skip
# Centre of mass, m, in the stand frame, with the kilogram on the torso.
POSES: list[tuple[dict[str, float], Triple]] = [
    ({}, (0.0339, -0.0007, 0.4203)),
    (WALK_READY, (0.0013, 0.007, 0.3921)),
    (PARTLY_BENT, (0.0239, -0.0007, 0.4066)),
]


@pytest.fixture(scope="module")
def body() -> PosedBody:
    return PosedBody(load_profile("wolfgang"))


@pytest.mark.parametrize(("joint", "place"), [*RIGHT.items(), *HEAD.items()])
def test_anchor_and_axis_at_the_zero_pose(body: PosedBody, joint: str, place: tuple[Triple, Triple]) -> None:
    anchor, axis = body.pose({}).anchor(joint)
    np.testing.assert_allclose(anchor, place[0], atol=6e-5)
    np.testing.assert_allclose(axis, place[1], atol=2e-4)


@pytest.mark.parametrize(("joint", "place"), LEFT.items())
def test_the_left_side_is_that_of_the_model_but_for_its_slip(
    body: PosedBody, joint: str, place: tuple[Triple, Triple]
) -> None:
    anchor, axis = body.pose({}).anchor(joint)
    np.testing.assert_allclose(anchor, place[0], atol=EXPORT_SLIP)
    np.testing.assert_allclose(axis, place[1], atol=2e-4)


@pytest.mark.parametrize(("joints", "com"), POSES)
def test_centre_of_mass_of_published_poses(body: PosedBody, joints: dict[str, float], com: Triple) -> None:
    np.testing.assert_allclose(body.pose(joints).com_in_stand_frame(), com, atol=EXPORT_SLIP)


def test_lengths(body: PosedBody) -> None:
    body.pose({})
    hip, knee, ankle = (body.anchor(joint)[0] for joint in ("RHipPitch", "RKnee", "RAnklePitch"))
    across = np.array([1.0, 0.0, 1.0])  # seen from the side
    assert np.linalg.norm((knee - hip) * across) == pytest.approx(0.16904, abs=1e-4)
    assert np.linalg.norm((ankle - knee) * across) == pytest.approx(0.17, abs=1e-4)
    elbow = body.anchor("RElbow")[0] + body.data.qpos[:3]
    assert np.linalg.norm(body.at("r_hand") - elbow) == pytest.approx(0.225182, abs=1e-4)
    sole, axes = body.frame("r_sole")
    assert (axes.T @ (body.at("r_ankle") - sole))[2] == pytest.approx(0.05, abs=1e-5)
    np.testing.assert_allclose(body.at("r_ankle")[[0, 2]] - body.data.qpos[[0, 2]], ankle[[0, 2]], atol=2e-4)


def test_a_straight_leg_is_15_degrees_from_zero(body: PosedBody) -> None:
    """Standing height with straight legs: 0.794 m; base upright, soles level."""
    body.pose({"LKnee": 0.261799, "RKnee": -0.261799})
    sole, axes = body.frame("l_sole")
    np.testing.assert_allclose(axes, np.eye(3), atol=1e-5)
    head = body.model.geom("head_shell")
    top = body.data.geom("head_shell").xpos[2] + head.size[2]
    assert top - sole[2] == pytest.approx(0.794, abs=1e-3)
    straight = body.com_in_stand_frame()
    bent = body.pose(body.profile.postures.stand).com_in_stand_frame()
    assert bent[2] < straight[2] - 0.005


def test_it_stands_on_its_cleats(body: PosedBody) -> None:
    """Lowest points of the cleats are the corners of the support polygon."""
    body.pose(body.profile.postures.stand)
    names = [body.model.geom(index).name for index in range(body.model.ngeom)]
    cleats = [name for name in names if "cleat" in name]
    assert len(cleats) == 8
    lowest = np.array([body.data.geom(name).xpos - (0, 0, body.model.geom(name).size[0]) for name in cleats])
    corners = body.sole_corners()
    for corner in corners:
        assert np.linalg.norm(lowest - corner, axis=1).min() < 1e-5
    plate = body.data.geom("l_foot_shell").xpos[2] - body.model.geom("l_foot_shell").size[2]
    assert plate > corners[:, 2].max() + 0.008


def test_servos(body: PosedBody) -> None:
    servos = body.profile.servos
    models = [servo.model for servo in servos.values()]
    assert (models.count("MX-64"), models.count("MX-106"), models.count("XH540-W270")) == (8, 10, 2)
    assert {joint for joint, servo in servos.items() if servo.model == "XH540-W270"} == {"LKnee", "RKnee"}
    assert [servo.id for servo in servos.values()] == list(range(1, 21))
    assert {(servo.direction, servo.zero_tick) for servo in servos.values()} == {(1, 2048)}
    assert {servo.gains.p for joint, servo in servos.items() if "Knee" in joint} == {4000}
