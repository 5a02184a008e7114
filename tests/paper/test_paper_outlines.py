"""Outlines: a sphere is a circle, a cylinder along its axis too, and zones are wider by the influence."""

import numpy as np
import pytest

from benchmarks.paper.outlines import scene_outlines
from retarget.schema.scene import Scene
from retarget.types import FloatArray


def scene(shape: dict[str, object]) -> Scene:
    obstacle = {"shape": shape, "influence": 0.2, "margin": 0.0}
    return Scene.model_validate({"name": "one", "description": "one", "obstacles": {"thing": obstacle}})


def along_y(points: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    return points[:, 0], points[:, 2], -points[:, 1]


@pytest.mark.parametrize(
    "shape",
    [
        {"sphere": {"at": (1.0, 2.0, 3.0), "radius": 0.5}},
        {"cylinder": {"from": (1.0, 1.0, 3.0), "to": (1.0, 3.0, 3.0), "radius": 0.5}},
    ],
)
def test_seen_along_the_axis_both_are_circles(shape: dict[str, object]) -> None:
    (outline,) = scene_outlines(scene(shape), along_y)
    for corners, radius in ((outline.solid, 0.5), (outline.zone, 0.7)):
        np.testing.assert_allclose(np.linalg.norm(corners - [1.0, 3.0], axis=1), radius, atol=2e-3)
    assert outline.near == pytest.approx(-2.0)
