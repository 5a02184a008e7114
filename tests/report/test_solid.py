"""Bodies as solids in pictures: what is drawn, and in which order."""

import numpy as np

from retarget.model.body import load_body_text
from retarget.model.meshes import solid_body
from retarget.report.solid import facets_of, lit

BOX = """<mujoco><worldbody><body name="base"><freejoint/>
<geom type="box" size="0.1 0.2 0.3"/></body></worldbody></mujoco>"""


def test_what_is_near_is_drawn_last_and_what_faces_away_is_not() -> None:
    box = load_body_text(BOX, source="test")
    postures = np.array([box.qpos0, [1.0, 2.0, 3.0, 0.0, 0.0, 0.0, 1.0]])  # as it is, and turned by half about z
    corners, normal, colour = facets_of(solid_body(box, {"base": 1}), postures)
    np.testing.assert_allclose(corners[1].reshape(-1, 3).mean(axis=0), [1.0, 2.0, 3.0], atol=1e-12)
    for pose in range(2):
        outlines, shades = lit(corners[pose], normal[pose], colour)
        assert len(outlines) == len(shades) == 6  # three sides
        assert len({tuple(shade) for shade in shades.round(3).tolist()}) == 3
