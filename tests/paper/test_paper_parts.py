"""Parts of the paper's experiments: recordings, outlines, cycles, and the law of damping."""

from itertools import pairwise

import numpy as np
import pytest

from benchmarks.paper.damping_law import DampedPoint, damped_points
from benchmarks.paper.outlines import scene_outlines
from benchmarks.paper.placement import crouch_cycles
from retarget.schema.scene import Scene
from retarget.types import FloatArray
from sim.performer import CYCLES, synthetic_performer

# Outlines: a sphere is a circle, a cylinder along its axis too, and zones are wider by the influence.


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


# Crouch cycles are found by the head alone.


def test_the_synthetic_performer_crouches_so_often() -> None:
    frames = synthetic_performer()
    head = frames.position[:, frames.index("head"), 2]
    cycles = crouch_cycles(head)
    assert len(cycles) == CYCLES
    assert cycles[0].start == 0 and cycles[-1].stop == len(frames)
    assert all(a.stop == b.start for a, b in pairwise(cycles))
    assert all(head[cycle].min() < 0.7 * head[0] for cycle in cycles)


def test_who_only_stands_has_no_cycle() -> None:
    assert crouch_cycles(np.full(100, 1.6)) == []


# Figure 4: what the compiled solver leaves of four displacements beside a sphere, against the law written out.


@pytest.fixture(scope="module")
def points() -> dict[str, DampedPoint]:
    return {point.name: point for point in damped_points()}


def test_outside_and_moving_away_nothing_is_altered(points: dict[str, DampedPoint]) -> None:
    for name in ("e1", "e4"):
        assert not points[name].acted
        np.testing.assert_allclose(points[name].got, points[name].asked, atol=1e-9)


def test_only_the_normal_motion_is_damped_by_alpha(points: dict[str, DampedPoint]) -> None:
    for name in ("e2", "e3"):
        point = points[name]
        asked, got = point.asked @ point.normal, point.got @ point.normal
        assert point.acted and asked < 0.0
        assert got == pytest.approx(point.share * asked, abs=1e-9)
        np.testing.assert_allclose(point.got - got * point.normal, point.asked - asked * point.normal, atol=1e-9)
