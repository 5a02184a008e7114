"""The measuring of collisions: whole runs of the synthetic performer, and what is placed in its way."""

import numpy as np
import pytest

from benchmarks.collision_placement import (
    INFLUENCE,
    MARGIN,
    Motion,
    height_scale,
    place,
    play,
    scene_clearance,
    scene_distances,
    scene_obstacles,
    write_scene,
)
from benchmarks.collisions import DOCS_HEADS, HEADS, Row, cells_of, measured, worst
from retarget.human.samples import Playback
from retarget.model.scene_state import SceneState
from retarget.run.options import RunOptions
from retarget.schema.scene import load_scene
from sim.performer import synthetic_performer


@pytest.fixture(scope="module")
def free() -> Motion:
    return play(synthetic_performer(), RunOptions("op3", playback=Playback(end=2.0)))


@pytest.fixture(scope="module")
def scene(free: Motion, tmp_path_factory: pytest.TempPathFactory) -> SceneState:
    folder = tmp_path_factory.mktemp("placed")
    placed = place(free, folder)
    assert placed
    return SceneState(load_scene(write_scene(placed, folder / "placed.yaml", scale=height_scale(free))))


def test_what_is_placed_is_met_by_the_arms_alone_and_clear_at_the_start(free: Motion, scene: SceneState) -> None:
    obstacles, scale = scene_obstacles(free), height_scale(free)
    assert 0.9 < scale < 1.1
    np.testing.assert_allclose(scene.shapes.influence, INFLUENCE * scale, rtol=1e-3)
    assert len(obstacles.start.position) == free.first + 1
    start = scene_clearance(obstacles.body, obstacles.start, scene, obstacles.start_times)
    rest = scene_clearance(obstacles.body, obstacles.rest, scene, obstacles.times)
    assert start >= 2.0 * MARGIN * scale and rest >= MARGIN * scale
    assert (-scene_distances(obstacles.body, obstacles.arms, scene, obstacles.times).min(axis=0) > 0.01).all()


@pytest.mark.long
def test_every_recording_gets_its_rows() -> None:
    found = list(measured("demo", synthetic_performer(), RunOptions("op3", playback=Playback(end=1.0))))
    rows = [row for row in found if isinstance(row, Row)]
    assert [row.scene == "free" for row in rows] == [True, False]
    assert rows[1].scene_mm is not None
    assert {len(cells_of(row)) for row in rows} == {len(HEADS)}
    assert {len(cells) for cells in worst(rows)} == {len(DOCS_HEADS)}
    assert any("into the" in note for note in found if isinstance(note, str))
