"""The measuring of collisions: whole runs of the synthetic performer, and what is placed in its way."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from benchmarks.collision_numbers import Numbers, beyond_influence, numbers, unhindered
from benchmarks.collision_placement import (
    INFLUENCE,
    MARGIN,
    height_scale,
    place,
    scene_distances,
    scene_obstacles,
    write_scene,
)
from benchmarks.collision_runs import Motion, play, unobserving
from benchmarks.collisions import HEADS, measured, row_of, worst
from retarget.human.samples import Playback
from retarget.model.scene_state import SceneState
from retarget.run.options import RunOptions
from retarget.schema.priorities import load_priorities
from retarget.schema.scene import load_scene
from sim.performer import synthetic_performer

SHORT = RunOptions("op3", playback=Playback(end=3.0))
BRIEF = RunOptions("op3", playback=Playback(end=2.0))


@pytest.fixture(scope="module")
def free() -> Motion:
    return play(synthetic_performer(), SHORT)


@pytest.fixture(scope="module")
def scene(free: Motion, tmp_path_factory: pytest.TempPathFactory) -> SceneState:
    folder = tmp_path_factory.mktemp("placed")
    placed = place(free, folder)
    assert placed
    return SceneState(load_scene(write_scene(placed, folder / "placed.yaml", scale=height_scale(free))))


def test_observers_are_taken_out_and_nothing_else(tmp_path: Path) -> None:
    for robot, name in (("op3", "servo"), ("human", "human")):
        bare, whole = load_priorities(str(unobserving(robot, tmp_path))), load_priorities(name)
        kept = [[t for t in level.tasks if t.type not in ("reactive", "preventive")] for level in whole.levels]
        assert [list(level.tasks) for level in bare.levels] == kept
        assert sum(map(len, kept)) < sum(len(level.tasks) for level in whole.levels)


def test_what_is_placed_is_met_by_the_arms_alone_and_clear_at_the_start(free: Motion, scene: SceneState) -> None:
    obstacles, scale = scene_obstacles(free), height_scale(free)
    assert 0.9 < scale < 1.1
    np.testing.assert_allclose(scene.shapes.influence, INFLUENCE * scale, rtol=1e-3)
    assert len(obstacles.start.rows) == free.first + 1
    start = obstacles.start.to_scene(scene, obstacles.start_times).smallest
    rest = obstacles.rest.to_scene(scene, obstacles.times).smallest
    assert start is not None and start >= 2.0 * MARGIN * scale
    assert rest is not None and rest >= MARGIN * scale
    assert (-scene_distances(obstacles.arms, scene, obstacles.times).min(axis=0) > 0.01).all()


def test_hands_are_hindered_only_near_an_obstacle(free: Motion, scene: SceneState) -> None:
    ticks = np.arange(0, free.end - free.first, 10)
    far = beyond_influence(free, ticks, scene)
    assert far.any()
    assert not far.all()
    change, share = unhindered(free, free, scene)
    assert change == 0.0
    assert share == pytest.approx(far.mean(), abs=0.05)
    off = replace(free, reached=free.asked + np.array([0.0, 0.0, 0.5]))
    on = replace(free, reached=free.asked + np.array([0.0, 0.3, 0.0]))
    assert unhindered(off, on, scene)[0] == pytest.approx(0.2)


def test_a_row_says_what_was_sent(free: Motion) -> None:
    row = numbers("one", "free", free, free=None, without=free)
    assert row.frames == len(free.run.record)
    assert all("hip" in pair for pair in row.left_out)
    assert row.self_mm is not None
    assert row.jerk_ratio == pytest.approx(1.0)
    assert (row.scene_mm, row.unhindered_mm, row.stop) == (None, None, None)
    assert row.path_ratio is not None and 0.5 < row.path_ratio < 1.2
    assert row.gated is not None and 0.0 <= row.gated <= 1.0


def test_every_recording_gets_its_rows() -> None:
    found = list(measured("demo", synthetic_performer(), BRIEF, ("free", "obstacles")))
    rows = [row for row in found if isinstance(row, Numbers)]
    assert [row.scene == "free" for row in rows] == [True, False]
    assert rows[1].scene_mm is not None
    assert rows[1].unhindered_mm is not None
    assert all(len(row_of(row)) == len(HEADS) for row in [*rows, *worst(rows)])
    assert any("into the" in note for note in found if isinstance(note, str))


def test_the_worst_of_each_number_is_shown(free: Motion) -> None:
    row = numbers("one", "free", free, free=None, without=None)
    a, b = (
        replace(row, self_mm=-2.0, self_deep=3, jerk_ratio=1.0),
        replace(row, self_mm=4.0, jerk_ratio=1.5, stop="why"),
    )
    (found,) = worst([a, b])
    assert (found.self_mm, found.self_deep, found.jerk_ratio, found.stop) == (-2.0, 3 + row.self_deep, 1.5, "1 runs")
    assert found.frames == 2 * row.frames
