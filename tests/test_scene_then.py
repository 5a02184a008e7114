"""The obstacles of a recorded run: as its scene was then, where they were at every tick; and why they are not shown."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from retarget.catalogue import Kind, find
from retarget.record import Phase
from retarget.recording.cycles import Cycles
from retarget.recording.played import played
from retarget.recording.reading import Recording, read_recording
from retarget.rotations import FloatArray
from retarget.viewer.from_mcap import open_viewed
from retarget.viewer.scene_then import SceneThen
from support.messages import shows
from test_view_mcap import recorded


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A recording beside its scene file, in which a ball moves at once."""
    folder = tmp_path_factory.mktemp("run")
    crossing = find(Kind.SCENE, "crossing_ball").read_text()
    (folder / "scene.yaml").write_text(crossing.replace("      - {time: 1, pos: [0.2, 0.6, 0.34]}\n", ""))
    recorded(folder / "run.mcap", robot="op3", scene=str(folder / "scene.yaml"))
    return folder


@pytest.fixture
def recording(place: Path) -> Recording:
    return read_recording(place / "run.mcap")


@pytest.fixture
def cycles(recording: Recording) -> Cycles:
    all_of_them = played(recording).cycles
    return all_of_them.taken(np.flatnonzero(all_of_them.kept))


def at(scene: SceneThen, row: int) -> FloatArray:
    poses = scene.at(row)
    assert poses is not None
    return poses


def test_obstacles_move_from_the_first_tick_that_followed(recording: Recording, cycles: Cycles) -> None:
    scene = SceneThen(recording, cycles)
    assert [one.name for one in scene.obstacles] == ["ball"] and scene.notes == ()
    first = int(np.flatnonzero(cycles.phase == Phase.FOLLOW)[0])
    assert first > 10
    for row in (0, first // 2, first):
        np.testing.assert_allclose(at(scene, row), [[0.2, 0.6, 0.34, 1.0, 0.0, 0.0, 0.0]])
    dt = recording.session.dt
    assert at(scene, first + 50)[0, 1] == pytest.approx(0.6 - 0.3 * 50 * dt, abs=1e-9), "1.2 m in 4 s"


def test_they_stand_while_nobody_leads(recording: Recording, cycles: Cycles) -> None:
    first = int(np.flatnonzero(cycles.phase == Phase.FOLLOW)[0])
    unled = cycles.unled.copy()
    unled[first + 10 : first + 20] = True
    scene, held = SceneThen(recording, cycles), SceneThen(recording, replace(cycles, unled=unled))
    np.testing.assert_allclose(at(held, first + 10), at(scene, first + 10))
    np.testing.assert_allclose(at(held, first + 19), at(scene, first + 10))
    np.testing.assert_allclose(at(held, first + 30), at(scene, first + 20))


def test_a_scene_that_changed_since_is_shown_as_it_was(recording: Recording, cycles: Cycles, place: Path) -> None:
    file = place / "scene.yaml"
    before = file.read_text()
    try:
        file.write_text(before.replace("radius: 0.05", "radius: 0.25"))
        scene = SceneThen(recording, cycles)
        assert np.abs(scene.obstacles[0].mesh[0]).max() == pytest.approx(0.05, abs=1e-3)
        assert len(scene.notes) == 1
        shows(scene.notes[0])
        assert sum("another one now" in note for note in open_viewed(recording.path).notes) == 1, "told once"
        file.unlink()
        assert len(SceneThen(recording, cycles).obstacles) == 1
    finally:
        file.write_text(before)


def test_why_it_is_not_shown(recording: Recording, cycles: Cycles, place: Path) -> None:
    """Not there any more, and not attached; the run is seen all the same."""
    session = recording.session.model_copy(update={"scene": "nowhere", "files": ()})
    scene = SceneThen(replace(recording, session=session, attachments={}), cycles)
    assert scene.obstacles == () and scene.at(0) is None
    assert len(scene.notes) == 1 and scene.notes[0].startswith("its scene is not shown: ")


def test_without_a_scene_there_is_nothing(recording: Recording, cycles: Cycles) -> None:
    session = recording.session.model_copy(update={"scene": None})
    scene = SceneThen(replace(recording, session=session), cycles)
    assert scene.obstacles == () and scene.at(0) is None and scene.notes == ()
