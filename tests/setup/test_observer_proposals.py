"""Each link gets a capsule, or what fits it far better; what is written still encloses."""

import numpy as np
import pytest

from messages import shows
from retarget.errors import UsageError
from retarget.model.body_file import compile_body_text
from retarget.rotations import normalise, to_matrix
from retarget.setup.enclosing_shapes import Capsule, Solid, distances_to_segment, link_geometries
from retarget.setup.observer_proposals import Proposal, Zones, propose, round_up

ZONES = Zones(0.03, 0.005)
FOOT = '<geom name="sole" type="box" size="0.0635 0.028 0.004"/>'
WIDE = '<geom type="box" size="0.057 0.039 0.004" quat="1 0.1 0.2 0.3"/>'


def proposal(geoms: str, *, name: str = "arm") -> Proposal:
    text = f"""<mujoco><worldbody><body name="base"><geom size="0.01"/>
      <body name="{name}"><joint/>{geoms}</body></body></worldbody></mujoco>"""
    return propose(link_geometries(compile_body_text(text, source="test").model)[0], ZONES)[1]


def test_a_limb_gets_a_capsule_which_says_how_large_it_is() -> None:
    found = proposal('<geom type="box" size="0.02 0.02 0.1"/>')
    assert isinstance(found.shape, Capsule) and not found.why
    assert found.ratio is not None and 1.5 < found.ratio < 2.2
    assert 0.008 < found.stands_out < 0.03


def test_a_capsule_gets_itself() -> None:
    found = proposal('<geom type="capsule" size="0.02 0.1"/>')
    assert isinstance(found.shape, Capsule)
    assert found.shape.radius == pytest.approx(0.02, abs=2e-5)
    assert found.shape.length == pytest.approx(0.2, abs=2e-5)
    assert found.ratio == pytest.approx(1.0, abs=0.02)
    assert found.stands_out < 1e-4


def test_a_flat_foot_gets_its_geom_with_a_reason() -> None:
    found = proposal(FOOT)
    assert isinstance(found.shape, Solid) and found.shape.geom == "sole"
    shows(found.why)


def test_a_flat_disc_gets_its_cylinder() -> None:
    found = proposal('<geom name="disc" type="cylinder" size="0.1 0.005"/>')
    assert isinstance(found.shape, Solid) and found.shape.kind == "cylinder"
    assert found.why.startswith("cylinder: ")


def test_a_foot_of_two_boxes_gets_a_box_around_both() -> None:
    found = proposal(FOOT + FOOT.replace("sole", "toe").replace("/>", ' pos="0.02 0 0"/>'))
    assert isinstance(found.shape, Solid) and not found.shape.geom
    assert found.shape.size == pytest.approx([0.0735, 0.028, 0.004])
    assert found.shape.pos == pytest.approx([0.01, 0.0, 0.0])


def test_a_chunky_body_gets_a_box_if_a_capsule_would_reach_out_farther_than_it_acts() -> None:
    chunky = '<geom name="g" type="box" size="{} {} {}"/>'
    assert isinstance(proposal(chunky.format(0.09, 0.07, 0.08)).shape, Solid)
    assert isinstance(proposal(chunky.format(0.009, 0.007, 0.008)).shape, Capsule)


@pytest.mark.parametrize("geoms", [FOOT + WIDE, WIDE, '<geom type="ellipsoid" size="0.031 0.032 0.2" pos="1 2 3"/>'])
def test_what_is_rounded_still_encloses(geoms: str) -> None:
    text = f"""<mujoco><worldbody><body name="arm"><joint/>{geoms}</body></worldbody></mujoco>"""
    geometry = link_geometries(compile_body_text(text, source="test").model)[0][0]
    shape = propose((geometry,), ZONES)[0].shape
    if isinstance(shape, Capsule):
        assert np.array_equal(np.round(shape.start, 5), shape.start)
        assert (distances_to_segment(geometry.centres, shape.start, shape.end) <= shape.radius + 1e-9).all()
    else:
        assert isinstance(shape, Solid)
        local = (geometry.centres - shape.pos) @ to_matrix(normalise(shape.quat))
        assert (np.abs(local) <= shape.size + 1e-9).all()


def test_names_lose_an_ending_only_where_they_stay_different() -> None:
    assert proposal(FOOT, name="arm_link").name == "arm"
    assert proposal(FOOT, name="base_link").name == "base_link"


@pytest.mark.parametrize(("value", "rounded"), [(0.02, 0.02), (0.1 + 0.2, 0.3), (0.020001, 0.02001), (1e-9, 1e-5)])
def test_lengths_are_rounded_up(value: float, rounded: float) -> None:
    assert round_up(value) == rounded


@pytest.mark.parametrize("zones", [(0.0, 0.0), (np.nan, 0.0), (np.inf, 0.0), (0.1, 0.1), (0.1, -0.1), (0.1, np.nan)])
def test_zones_that_no_profile_may_have_are_refused(zones: tuple[float, float]) -> None:
    with pytest.raises(UsageError):
        Zones(*zones)
