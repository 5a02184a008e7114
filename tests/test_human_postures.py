"""Reference postures are legal and look as they are described."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from people import place
from retarget.human import Human, build_human
from retarget.human_dimensions import proportional_dimensions
from retarget.human_postures import POSTURES


@pytest.fixture(scope="module")
def human() -> Human:
    return build_human(proportional_dimensions(1.75))


@pytest.mark.parametrize("name", [posture.name for posture in POSTURES])
def test_every_posture_is_inside_the_limits(human: Human, name: str) -> None:
    q = human.posture(name)
    single, address = human.body.scalar_joints()
    angles = q[address[single]]
    assert (angles >= human.body.lower[single]).all() and (angles <= human.body.upper[single]).all()
    assert (q[7:][human.locked[6:]] == 0.0).all()


def test_the_attractor_is_the_papers(human: Human) -> None:
    q = human.posture("attractor")
    stand = place(human, human.posture("stand"), ["l_wrist", "r_wrist"])
    arms = place(human, q, ["l_wrist", "r_wrist"])
    assert arms[0, 1] - stand[0, 1] > 0.25 and stand[1, 1] - arms[1, 1] > 0.25, "arms away from the torso"
    by_name = dict(zip(human.body.dof_names[6:], q[7:], strict=True))
    assert by_name["l_knee_flexion"] > 0.4 and by_name["spine_flexion"] == 0.0 and abs(by_name["l_hip_flexion"]) < 0.2


def test_the_natural_posture_has_vertical_legs_and_hanging_arms(human: Human) -> None:
    q = human.posture("natural")
    hip, ankle, chest, neck, shoulder, elbow = place(
        human, q, ["l_hip", "l_ankle", "chest", "neck", "l_shoulder", "l_elbow"]
    )
    assert_allclose(hip[:2], ankle[:2], atol=1e-9)
    arm, down = elbow - shoulder, chest - neck
    from_trunk = np.arccos(arm @ down / np.linalg.norm(arm) / np.linalg.norm(down))
    assert np.rad2deg(from_trunk) == pytest.approx(18.0, abs=0.1)


def test_the_t_pose_is_a_t(human: Human) -> None:
    shoulder, elbow, wrist = place(human, human.posture("t_pose"), ["r_shoulder", "r_elbow", "r_wrist"])
    assert_allclose(
        wrist - shoulder,
        [0.0, -human.dimensions.length("r_elbow") - human.dimensions.length("r_wrist"), 0.0],
        atol=1e-9,
    )
    assert elbow[1] < shoulder[1]
