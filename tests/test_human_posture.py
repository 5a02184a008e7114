"""Joint centres, orientations and centre of mass of postures."""

import numpy as np
import pytest

import people
from retarget import rotations
from retarget.human import build_human
from retarget.human_dimensions import POINTS, proportional_dimensions
from retarget.human_posture import ORIENTED, HumanPosture, PostureReader
from support.messages import refuses


def test_reads_what_the_body_has() -> None:
    human = build_human(proportional_dimensions(1.75))
    reader = PostureReader(human)
    q = human.posture("natural")
    q[:3] = 1.0, 2.0, 3.0
    q[3:7] = rotations.from_axis_angle(np.array([0.0, 0.0, 1.0]), np.array(0.7))
    rows = np.stack([q, human.posture("stand")])
    assert reader.joints(rows).shape == (2, len(POINTS), 3)
    assert reader.joints(rows)[0] == pytest.approx(people.place(human, q, POINTS))
    assert reader.orientations(rows)[0, ORIENTED.index("pelvis")] == pytest.approx(q[3:7])
    assert reader.orientations(rows)[1] == pytest.approx(np.tile(rotations.IDENTITY, (3, 1)))
    assert reader.centre_of_mass(rows)[0, :2] == pytest.approx([1.0, 2.0], abs=0.1)


def test_one_posture_is_read_as_many_are() -> None:
    human = build_human(proportional_dimensions(1.75))
    reader = PostureReader(human)
    rows = np.stack([human.posture("crouch"), human.posture("stand")])
    for i in (0, 1, 0):
        joints, orientations, centre = reader.read(rows[i])
        assert (joints == reader.joints(rows)[i]).all()
        assert (orientations == reader.orientations(rows)[i]).all()
        assert (centre == reader.centre_of_mass(rows)[i]).all()
    with refuses(ValueError):
        reader.read(rows[0, 1:])


def test_looked_up_by_name() -> None:
    joints, orientations = np.arange(69.0).reshape(23, 3), np.eye(4)[:3]
    posture = HumanPosture(
        q=np.zeros(58),
        joint_names=POINTS,
        joints=joints,
        orientations=orientations,
        centre_of_mass=np.zeros(3),
        sensor_error=np.zeros(5),
        balance_error=0.0,
        heading=(1.0, 0.0),
    )
    assert (posture.joint("pelvis") == joints[0]).all()
    assert (posture.orientation("head") == orientations[2]).all()
