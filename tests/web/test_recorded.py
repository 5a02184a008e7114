"""The obstacles of a recorded run: as its scene was then, where they were at every tick; and why they are not shown."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from messages import Facts, refuses, shows
from recordings import recorded, saved_run
from retarget.errors import InputError
from retarget.recording.motion import Motion
from retarget.recording.read_run import read_recorded
from retarget.run.record import Phase
from retarget.schema.catalogue import Kind, find
from retarget.web.recorded import ShownRun, open_recorded, page_files, recorded_obstacles
from retarget.web.shown import joint_tracks, present


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A recording next to its scene file, in which a ball moves at once."""
    folder = tmp_path_factory.mktemp("run")
    crossing = find(Kind.SCENE, "crossing_ball").read_text()
    (folder / "scene.yaml").write_text(crossing.replace("      - {time: 1, pos: [0.2, 0.6, 0.34]}\n", ""))
    recorded(folder / "run.mcap", robot="op3", scene=str(folder / "scene.yaml"))
    return folder


@pytest.fixture
def whole(place: Path) -> Motion:
    return read_recorded(place / "run.mcap")


def first_followed(run: Motion) -> int:
    return int(np.flatnonzero(run.phase == Phase.FOLLOW)[0])


@pytest.mark.long
def test_obstacles_move_from_the_first_tick_that_followed(whole: Motion) -> None:
    obstacles, poses, notes = recorded_obstacles(whole)
    assert len(obstacles) == 1 and notes == () and poses is not None and len(poses) == len(whole)
    first = first_followed(whole)
    assert first > 10
    for row in (0, first // 2, first):
        np.testing.assert_allclose(poses[row], [[0.2, 0.6, 0.34, 1.0, 0.0, 0.0, 0.0]])
    assert whole.recording is not None
    dt = whole.recording.session.dt
    assert poses[first + 50, 0, 1] == pytest.approx(0.6 - 0.3 * 50 * dt, abs=1e-9), "1.2 m in 4 s"


def test_a_scene_that_changed_since_is_shown_as_it_was(whole: Motion, place: Path) -> None:
    file = place / "scene.yaml"
    before = file.read_text()
    try:
        file.write_text(before.replace("radius: 0.05", "radius: 0.25"))
        obstacles, _, notes = recorded_obstacles(whole)
        assert np.abs(obstacles[0].vertices).max() == pytest.approx(0.05, abs=1e-3)
        assert len(notes) == 1
        shows(notes[0])
        assert sum("scene.yaml" in note for note in open_recorded(place / "run.mcap").notes) == 1, "noted once"
        file.unlink()
        assert len(recorded_obstacles(whole)[0]) == 1
    finally:
        file.write_text(before)


def test_why_it_is_not_shown(whole: Motion, place: Path) -> None:
    """Not there any more, and not attached; the run is seen all the same."""
    recording = whole.recording
    assert recording is not None
    session = recording.session.model_copy(update={"scene": "nowhere", "files": ()})
    bare = replace(whole, recording=replace(recording, session=session, attachments={}))
    obstacles, poses, notes = recorded_obstacles(bare)
    assert not obstacles and poses is None
    assert len(notes) == 1 and notes[0].startswith("its scene is not shown: ")


@pytest.fixture(scope="module")
def path(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return saved_run(tmp_path_factory.mktemp("run") / "run.npz", robot="op3")


@pytest.fixture(scope="module")
def run(path: Path) -> ShownRun:
    return open_recorded(path)


@pytest.fixture(scope="module")
def arrays(path: Path) -> dict[str, Any]:
    with np.load(path) as saved:
        return dict(saved)


def test_every_row_is_as_it_was(arrays: dict[str, Any], run: ShownRun) -> None:
    robot = run.cast.robot
    assert robot is not None and run.cast.joints == tuple(arrays["joint_names"])
    assert not run.cast.servos_measure
    assert set(run.doing) == {"approaching", "following", "stopping"}
    np.testing.assert_array_equal(run.q[:, :3], arrays["root_position"])
    column = robot.body.joint_qpos[robot.body.joint_index("l_knee")]
    joint = run.cast.joints.index("l_knee")
    np.testing.assert_array_equal(run.q[:, column], arrays["joint_positions"][:, joint])
    np.testing.assert_array_equal(present(run.cast, run, run.q)[:, column], run.present[:, joint])
    tracks = joint_tracks(run.cast, run)
    np.testing.assert_allclose(tracks["goal"], np.degrees(arrays["joint_positions"]))
    np.testing.assert_allclose(tracks["servo"], np.degrees(arrays["servo_positions"]))
    assert np.isnan(tracks["temperature"]).all()
    np.testing.assert_array_equal(run.time, arrays["time"])


class Shown:
    """What the page of a run brings along."""

    def __init__(self, run: ShownRun) -> None:
        self.files = page_files(run, "a <b>run</b>")
        html = self.files[""].decode()
        assert "<b>run</b>" not in html and f"<h1>{run.robot}: a &lt;b&gt;run&lt;/b&gt;</h1>" in html
        self.data: Any = json.loads(html.split('id="motion">')[1].split("</script>")[0])

    def numbers(self, place: list[int], kind: str) -> np.ndarray[Any, np.dtype[np.float64]]:
        """Of a track."""
        begin, count = place
        return np.frombuffer(self.files["tracks"], kind, count, begin).astype(float)


def test_the_page_has_every_tick(run: ShownRun) -> None:
    page, robot = Shown(run), run.cast.robot
    data = page.data
    assert robot is not None and data["every"] == 1 and data["performer"]["layers"] == ["servos"]
    np.testing.assert_allclose(np.array(data["time"]), 1e3 * run.time, atol=0.06)
    shown = data["robot"]["goal"]
    place = page.numbers(shown["numbers"], "<i2").reshape(len(run), -1, 7)[..., :3] * shown["step"]
    place[..., :2] += page.numbers(data["robot"]["centre"], "<f4").reshape(len(run), 1, 2)
    np.testing.assert_allclose(place, robot.poses(run.q)[..., :3], atol=1e-3)
    assert data["robot"]["poses"] != shown, "where its servos are"
    words = [words for _, words, _ in data["doing"]]
    assert words == ["approaching", "following", "stopping"]
    angles = page.numbers(data["joints"]["goal"], "<f4").reshape(len(run), -1)
    np.testing.assert_allclose(angles, joint_tracks(run.cast, run)["goal"], atol=1e-4)
    assert not data["joints"]["measured"] and data["joints"]["names"] == list(run.cast.joints)


def test_a_long_run_is_shown_more_coarsely(run: ShownRun, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("retarget.web.recorded.MOST_ROWS", len(run) // 2)
    data = Shown(run).data
    assert data["every"] == 3 and len(data["time"]) == len(data["phase"]) == -(-len(run) // 3)


def test_sensors_are_shown_where_they_were_kept(arrays: dict[str, Any], run: ShownRun, tmp_path: Path) -> None:
    assert run.cast.sensors == tuple(arrays["sensor_names"])
    np.testing.assert_array_equal(run.sensors, arrays["sensor_positions"])
    older = tmp_path / "older.npz"
    np.savez(older, **{key: value for key, value in arrays.items() if not key.startswith("sensor_")})
    assert open_recorded(older).cast.sensors == () and "sensors" not in open_recorded(older)


@pytest.mark.parametrize(
    ("change", "found"),
    [
        (lambda a: {name: a[name] for name in a.keys() - {"human_q"}}, "human_q"),
        (lambda a: a | {"human_q": a["human_q"][:-1]}, "human_q"),
        (lambda a: a | {"sensor_positions": a["sensor_positions"][:-1]}, "sensor_positions"),
        (lambda a: a | {"sensor_names": a["sensor_names"][1:]}, "sensor_positions"),
        (lambda a: a | {"joint_positions": a["joint_positions"][:, 1:]}, "joint_positions"),
        (lambda a: a | {"human_q": a["human_q"][:, 1:]}, ()),
        (lambda a: a | {"human_mjcf": np.array("<mujoco")}, ()),
    ],
)
def test_what_is_no_run_is_refused(arrays: dict[str, Any], tmp_path: Path, change: Any, found: Facts) -> None:
    changed = tmp_path / "changed.npz"
    np.savez(changed, **change(arrays))
    with refuses(InputError, found) as refused:
        open_recorded(changed)
    assert str(changed) in str(refused.value)
