"""Sizes of a person: proportions, plausibility, and data that cannot be changed behind one's back."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from retarget.anthropometry import FRACTIONS
from retarget.errors import InputError
from retarget.frames import JOINTS
from retarget.human_dimensions import (
    PARENTS,
    POINTS,
    check_plausible,
    mirrored_dimensions,
    proportional_dimensions,
)
from support.messages import refuses


def test_the_points_are_the_canonical_joints_parents_first() -> None:
    assert set(POINTS) == set(JOINTS) and len(POINTS) == 23
    assert all(parent < i for i, parent in enumerate(PARENTS))


def test_average_proportions_scale_with_stature() -> None:
    person = proportional_dimensions(1.8)
    assert_allclose(person.offset, 1.8 * proportional_dimensions(1.0).offset)
    assert person.length("l_knee") == pytest.approx(0.245 * 1.8)
    assert person.mass == pytest.approx(22.5 * 1.8**2)
    assert proportional_dimensions(1.8, mass=80.0).mass == 80.0


def test_left_and_right_mirror_each_other() -> None:
    person = proportional_dimensions(1.7)
    for name in POINTS:
        if name.startswith("l_"):
            assert_allclose(person.of(name), person.of("r_" + name[2:]) * [1, -1, 1])


def test_mirrored_left_is_right_and_twice_is_nothing() -> None:
    usual = proportional_dimensions(1.7)
    offset = usual.offset.copy()
    offset[POINTS.index("l_knee")] *= 1.1
    offset[POINTS.index("spine"), 1] = 0.01
    person = replace(usual, offset=offset)
    mirrored = mirrored_dimensions(person)
    assert mirrored.length("r_knee") == person.length("l_knee") > mirrored.length("l_knee")
    assert mirrored.of("spine")[1] == -0.01 and mirrored.of("l_hip")[1] > 0.0
    assert_allclose(mirrored_dimensions(mirrored).offset, person.offset)


def test_the_head_of_a_standing_person_is_where_the_table_has_it() -> None:
    person = proportional_dimensions(1.7)
    head = person.pelvis_height + person.standing()[POINTS.index("head"), 2]
    assert head == pytest.approx(FRACTIONS.head_height * 1.7, abs=0.01)


def test_offsets_are_read_only() -> None:
    with pytest.raises(ValueError, match="read-only"):
        proportional_dimensions(1.7).offset[0] = 1.0


def test_what_is_no_human_is_refused() -> None:
    check_plausible(proportional_dimensions(1.7), source="file")
    with refuses(InputError, 170):
        check_plausible(proportional_dimensions(170.0), source="file")
    stretched = proportional_dimensions(1.7)
    offset = np.array(stretched.offset)
    offset[[POINTS.index("l_knee"), POINTS.index("r_wrist")]] *= [[5.0], [0.1]]
    with refuses(InputError, "l_hip", "l_knee", "r_elbow", "r_wrist"):
        check_plausible(replace(stretched, offset=offset), source="file")
