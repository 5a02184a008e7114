"""The proportions are one consistent table."""

import numpy as np
import pytest

from retarget.anthropometry import FRACTIONS, SEGMENTS, TRUNK_LEVELS

TRUNK = ("pelvis", "spine", "chest", "neck")


def test_masses_of_both_sides_sum_to_the_body() -> None:
    assert sum(s.mass * (1 if s.body in TRUNK else 2) for s in SEGMENTS) == pytest.approx(1.0, abs=1e-12)


def test_the_parts_of_the_trunk_have_the_trunks_own_mass_and_centre() -> None:
    level = {"hips": 0.0, "l4_l5": TRUNK_LEVELS.l4_l5, "t12_l1": TRUNK_LEVELS.t12_l1, "c7_t1": TRUNK_LEVELS.c7_t1}
    parts = [s for s in SEGMENTS if s.body in TRUNK[:3]]
    masses = np.array([s.mass for s in parts])
    centres = np.array([level[s.start] + s.com * (level[s.end] - level[s.start]) for s in parts])
    assert masses.sum() == pytest.approx(0.497)  # Winter (2009), Table 4.1, trunk
    assert masses @ centres / masses.sum() == pytest.approx(0.50, abs=1e-3)


def test_heights_of_the_standing_body_agree_with_drillis_and_contini() -> None:
    f = FRACTIONS
    hip = f.ankle_height + f.shank + f.thigh
    assert hip == pytest.approx(0.530)
    neck = hip + f.pelvis_rise + 3 * f.spine_link
    assert neck + f.collar_rise == pytest.approx(0.818)
    assert neck + f.head_rise == pytest.approx(f.head_height, abs=0.003)
    assert f.heel_back + f.toe_forward + f.toe_tip == pytest.approx(0.152)
