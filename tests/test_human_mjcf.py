"""The human as MJCF: masses at the table's places, sound inertias, one shape per segment, any skeleton."""

import mujoco
import numpy as np
import pytest
from numpy.testing import assert_allclose

from retarget.anthropometry import SEGMENTS
from retarget.human_dimensions import POINTS, HumanDimensions, proportional_dimensions
from retarget.human_mjcf import human_mjcf


def compiled(dimensions: HumanDimensions) -> mujoco.MjModel:
    return mujoco.MjModel.from_xml_string(human_mjcf(dimensions))


def test_each_segment_has_its_share_of_the_mass() -> None:
    model = compiled(proportional_dimensions(1.75, mass=70.0))
    for segment in SEGMENTS:
        sides = ("",) if segment.body in ("pelvis", "spine", "chest", "neck") else ("l_", "r_")
        for side in sides:
            assert model.body(side + segment.body).mass[0] == pytest.approx(70.0 * segment.mass)
    assert model.body("l_collar").mass[0] < 1e-5


def test_limbs_have_their_centre_and_radius_of_gyration_from_the_table() -> None:
    person = proportional_dimensions(1.75, mass=70.0)
    model = compiled(person)
    thigh = model.body("l_hip")
    assert_allclose(thigh.ipos, 0.433 * person.of("l_knee"), atol=1e-9)
    rod = thigh.mass[0] * (0.323 * person.length("l_knee")) ** 2
    assert rod < max(thigh.inertia) < 1.2 * rod


def test_inertias_are_those_of_solid_bodies() -> None:
    model = compiled(proportional_dimensions(1.75))
    for inertia in model.body_inertia[1:]:
        assert np.all(inertia > 0.0) and 2.0 * inertia.max() <= inertia.sum() * (1.0 + 1e-9)


def test_every_link_has_a_shape_that_the_physics_can_use() -> None:
    model = compiled(proportional_dimensions(1.75))
    assert set(model.geom_bodyid) == set(range(1, model.nbody))
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    feet = [model.geom("l_ankle").id, model.geom("r_ankle").id]
    lowest = [data.geom_xpos[i, 2] - model.geom_size[i, 0] for i in feet]
    assert_allclose(lowest, 0.0, atol=1e-9)


def test_a_skeleton_without_a_trunk_link_still_compiles() -> None:
    person = proportional_dimensions(1.7)
    offset = np.array(person.offset)
    offset[POINTS.index("neck")] = 0.0
    model = compiled(HumanDimensions(offset=offset, stature=1.7, mass=60.0, origin="test"))
    assert model.nv == 57
