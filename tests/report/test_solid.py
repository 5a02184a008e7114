"""Bodies as solids: facets that close, face outward and lie where the shapes of the body file are."""

import numpy as np
import pytest

from retarget.model.body import load_body_text
from retarget.model.robot import load_robot
from retarget.report.solid import LEFT, MIDDLE, RIGHT, facets_of, lit, sides_of

BODY = """<mujoco><worldbody><body name="base"><freejoint/>
<geom type="{kind}" size="{size}" pos="0.1 0.2 0.3" mass="1"/></body></worldbody></mujoco>"""


@pytest.mark.parametrize(
    ("kind", "size", "volume"),
    [
        ("box", "0.1 0.2 0.3", 8 * 0.006),
        ("sphere", "0.2", 4 / 3 * np.pi * 0.008),
        ("capsule", "0.1 0.3", np.pi * 0.01 * (0.6 + 0.4 / 3)),
        ("cylinder", "0.1 0.3", np.pi * 0.01 * 0.6),
    ],
)
def test_facets_close_around_the_shape(kind: str, size: str, volume: float) -> None:
    """The divergence theorem: where all facets face outward and close, their flux is three times the volume."""
    shape = facets_of(load_body_text(BODY.format(kind=kind, size=size), source="test"), {}).corners
    area = 0.5 * np.cross(shape[:, 2] - shape[:, 0], shape[:, 3] - shape[:, 1])
    flux = np.einsum("fk,fk->", shape.mean(axis=1), area)
    assert flux / 3.0 == pytest.approx(volume, rel=0.04)
    assert np.abs(area.sum(axis=0)).max() < 1e-9


def test_what_is_near_is_drawn_last_and_what_faces_away_is_not() -> None:
    facets = facets_of(load_body_text(BODY.format(kind="box", size="0.1 0.2 0.3"), source="test"), {})
    outlines, shades = lit(facets.corners, facets.normal, facets.colour)
    assert len(outlines) == len(shades) == 3
    assert len({tuple(shade) for shade in shades.round(3).tolist()}) == 3


def test_the_sides_of_a_robot_are_those_of_its_limbs() -> None:
    robot = load_robot("op3")
    names = robot.profile.frames
    ends = {
        colour: [robot.frame(name).body for name in names if name.startswith(side)]
        for colour, side in ((LEFT, "l_"), (RIGHT, "r_"))
    }
    middle = [robot.frame(name).body for name in names if name[:2] not in ("l_", "r_")]
    sides = sides_of(robot.body, ends, middle)
    for link, name in enumerate(robot.body.body_names):
        wanted = {"l_": LEFT, "r_": RIGHT}.get(name[:2], MIDDLE)
        assert sides.get(link, MIDDLE) == wanted, name
