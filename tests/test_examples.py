"""Every example runs, and is short."""

import re
import runpy
from pathlib import Path

import pytest

from messages import shows

REAL_TIME = {"send_poses"}
"""Examples that go on in real time: each has a test of its own."""

QUICK = {
    "ik_arm",
    "ik_own_inequality",
    "ik_two_arms",
    "live_obstacle",
    "move_one_joint",
    "own_bus",
    "own_hierarchy",
    "own_loop",
    "stand_in_physics",
}
"""Examples that take a second or three; the others are long."""

NEEDS = {"read_into_pandas": ("pandas",)}
"""What an example needs beyond what every test needs."""

WRITES = {"plot_a_run": "tracking.png"}
"""Examples that write into a folder, which need not be there yet, and one of their files."""

EXAMPLES = sorted(
    path for path in (Path(__file__).resolve().parent.parent / "examples").glob("*.py") if path.stem not in REAL_TIME
)


@pytest.mark.parametrize(
    "path",
    [pytest.param(path, id=path.stem, marks=() if path.stem in QUICK else pytest.mark.long) for path in EXAMPLES],
)
def test_example_runs(
    path: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    for library in NEEDS.get(path.stem, ()):
        pytest.importorskip(library, reason=f"{path.name} needs {library} (make test installs it)")
    place = tmp_path / "new" / "folder"
    monkeypatch.setattr("sys.argv", [str(path), *([str(place)] if path.stem in WRITES else [])])
    runpy.run_path(str(path), run_name="__main__")
    distances = re.findall(r"(-?\d[\d.]*) (?:mm|rad) off", capsys.readouterr().out)
    assert distances and min(map(float, distances)) >= 0.0
    assert len(path.read_text(encoding="utf-8").splitlines()) < 40
    assert path.stem not in WRITES or (place / WRITES[path.stem]).is_file()


def test_a_human_avoids_the_ball_that_its_performer_reaches_into(capsys: pytest.CaptureFixture[str]) -> None:
    path = next(path for path in EXAMPLES if path.stem == "live_obstacle")
    runpy.run_path(str(path), run_name="__main__")
    sensed, kept = map(float, re.findall(r"-?\d[\d.]*(?= mm)", capsys.readouterr().out))
    assert sensed > 90.0 and kept > 5.0


@pytest.mark.parametrize("words", [("run.npz",), ("run.npz", "dataset", "more")])
def test_a_dataset_needs_a_run_and_a_folder(
    words: tuple[str, ...], capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    path = next(path for path in EXAMPLES if path.stem == "export_lerobot")
    monkeypatch.setattr("sys.argv", [str(path), *words])
    with pytest.raises(SystemExit) as left:
        runpy.run_path(str(path), run_name="__main__")
    err = capsys.readouterr().err
    assert left.value.code == 2
    shows(err, "export_lerobot.py")
