"""`retarget export`: one clear message and exit code 2 for what cannot be; nothing is overwritten, nothing is left."""

import json
from functools import partial
from pathlib import Path

import numpy as np
import pytest

import command_line
from messages import shows
from recordings import SLIDER, moved, saved, slider, with_servos
from retarget.recording.exports.formats import FORMATS


@pytest.fixture
def run(tmp_path: Path) -> Path:
    (tmp_path / "slider.xml").write_text(SLIDER)
    motion = with_servos(moved(slider()))
    phase = np.full(len(motion), "follow", dtype="<U8")
    phase[:10], phase[-3:] = "approach", "brake"
    return saved(motion, tmp_path / "run.npz", tmp_path / "slider.xml", phase=phase)


code_of = partial(command_line.code_of, "export")


ENDINGS = {
    "csv": "run.csv",
    "npz": "run_motion.npz",
    "parquet": "run.parquet",
    "beyondmimic": "run_beyondmimic.npz",
    "holosoma": "run_holosoma.npz",
    "unitree": "run_unitree.csv",
    "gmr": "run_gmr.pkl",
    "gmr-npz": "run_gmr.npz",
    "bones": "run_bones.csv",
    "sonic": "run_sonic",
    "bvh": "run.bvh",
    "lerobot": "run_lerobot",
}


@pytest.mark.long
@pytest.mark.parametrize("to", ENDINGS)
def test_beside_the_run_and_never_twice(to: str, run: Path, capsys: pytest.CaptureFixture[str]) -> None:
    before = {path.name for path in run.parent.iterdir()}
    assert code_of(run, "--to", to) == 0
    assert {path.name for path in run.parent.iterdir()} - before == {ENDINGS[to]}
    out = capsys.readouterr().out
    shows(out, 10, 3)
    assert out.splitlines()[-1] == str(FORMATS[to].conventions)
    place = run.parent / ENDINGS[to]
    stamp, before_it = place.stat().st_mtime_ns, place.stat().st_ino
    assert code_of(run, "--to", to) == 2
    shows(capsys.readouterr().err)
    assert place.stat().st_mtime_ns == stamp
    assert code_of(run, "--to", to, "--overwrite") == 0
    assert place.stat().st_ino != before_it


def test_the_same_line_twice_names_the_option_that_replaces(run: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert code_of(run, "--to", "csv") == 0
    first = (run.parent / "run.csv").read_bytes()
    capsys.readouterr()
    assert code_of(run, "--to", "csv") == 2
    refused = capsys.readouterr()
    assert (refused.err.count("\n"), refused.out) == (1, "")
    shows(refused.err, "--out", "--overwrite")
    (run.parent / "run.csv").write_text("another")
    assert code_of(run, "--to", "csv", "--overwrite") == 0
    assert (run.parent / "run.csv").read_bytes() == first


def test_a_folder_is_replaced_only_by_one_of_its_layout(run: Path, capsys: pytest.CaptureFixture[str]) -> None:
    words = (run, "--to", "lerobot", "--overwrite")
    assert code_of(*words) == 0
    assert code_of(*words) == 0
    (run.parent / "run_lerobot" / "notes.txt").write_text("mine")
    capsys.readouterr()
    assert code_of(*words) == 2
    shows(capsys.readouterr().err, "notes.txt")
    assert (run.parent / "run_lerobot" / "notes.txt").read_text() == "mine"


def test_no_foreign_file_is_lost_by_overwriting(run: Path, capsys: pytest.CaptureFixture[str]) -> None:
    project = run.parent / "project"
    words = (run, "--to", "lerobot", "--out", project, "--overwrite")
    (project / "data").mkdir(parents=True)
    (project / "data" / "raw.csv").write_text("mine")
    assert code_of(*words) == 2
    shows(capsys.readouterr().err, "project with data/raw.csv")
    (project / "data" / "raw.csv").rename(project / "README.md")
    (project / "data").rmdir()
    assert code_of(*words) == 2
    shows(capsys.readouterr().err, "README.md", "without meta/info.json")
    assert (project / "README.md").read_text() == "mine"
    (project / "README.md").unlink()
    (project / "elsewhere").symlink_to(run.parent)
    assert code_of(*words) == 2
    shows(capsys.readouterr().err, "elsewhere")
    (project / "elsewhere").unlink()
    assert code_of(*words) == 0
    assert (project / "meta" / "info.json").is_file()


@pytest.mark.parametrize("to", ["npz", "gmr-npz"])
def test_the_run_itself_is_not_replaced(to: str, run: Path, capsys: pytest.CaptureFixture[str]) -> None:
    before = run.read_bytes()
    (run.parent / "link.npz").symlink_to(run)
    (run.parent / "second.npz").hardlink_to(run)
    for out in (run, run.parent / "link.npz", run.parent / "second.npz"):
        assert code_of(run, "--to", to, "--out", out, "--overwrite") == 2
        shows(capsys.readouterr().err, "--out", "a file that is read")
    assert run.read_bytes() == before and (run.parent / "link.npz").is_symlink()


def test_no_other_file_that_is_read_is_replaced(run: Path, capsys: pytest.CaptureFixture[str]) -> None:
    body = run.parent / "slider.xml"
    before = body.read_bytes()
    assert code_of(run, "--to", "sonic", "--out", run.parent, "--overwrite") == 2
    shows(capsys.readouterr().err, "the folder of run.npz")
    assert code_of(run, "--to", "csv", "--body", body, "--out", body, "--overwrite") == 2
    shows(capsys.readouterr().err, "a file that is read")
    again = run.parent / "run_lerobot" / "again.npz"
    again.parent.mkdir()
    again.write_bytes(run.read_bytes())
    assert code_of(run, again, "--to", "lerobot", "--overwrite") == 2
    shows(capsys.readouterr().err, "the folder of again.npz")
    assert run.is_file() and again.is_file() and body.read_bytes() == before


def test_several_runs_are_one_data_set_and_no_table(run: Path, capsys: pytest.CaptureFixture[str]) -> None:
    again = run.with_name("again.npz")
    again.write_bytes(run.read_bytes())
    assert code_of(run, again, "--to", "csv") == 2
    shows(capsys.readouterr().err, "--to", 2)
    assert code_of(run, again, "--to", "lerobot") == 0
    assert capsys.readouterr().out.count("27 rows") == 2
    info = json.loads((run.parent / "run_lerobot/meta/info.json").read_text())
    assert info["total_episodes"] == 2 and info["total_frames"] == 54


REFUSED = {
    "unknown format": (["--to", "cvs"], "Did you mean csv"),
    "several formats": (["--to", "csv", "--to", "npz"], "--to: several formats"),
    "unknown phase": (["--to", "csv", "--phase", "brake"], "--phase"),
    "unknown body": (["--to", "csv", "--of", "dog"], "--of"),
    "impossible rate": (["--to", "csv", "--fps", "0"], "--fps"),
    "nowhere": (["--to", "csv", "--out", "nowhere/run.csv"], "no such folder"),
    "a suffix of another format": (["--to", "bvh", "--out", "a.csv"], "found a.csv. Give a.bvh, or --to csv"),
    "a suffix of another format in capitals": (["--to", "csv", "--out", "a.NPZ"], "Give a.csv, or --to npz"),
    "a folder with the suffix of a file": (["--to", "lerobot", "--out", "a.bvh"], "Give a_lerobot, or --to bvh"),
    "a human that is not there": (["--to", "csv", "--of", "human"], "human_mjcf, human_q"),
}


@pytest.mark.parametrize("case", REFUSED)
def test_refused_in_one_line(
    case: str, run: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(run.parent)
    before = sorted(path.name for path in run.parent.iterdir())
    words, message = REFUSED[case]
    assert code_of(run, *words) == 2
    printed = capsys.readouterr()
    assert message in printed.err and printed.err.count("\n") == 1 and printed.out == ""
    assert sorted(path.name for path in run.parent.iterdir()) == before


@pytest.mark.parametrize("to", ["parquet", "lerobot"])
def test_without_pyarrow(
    to: str, run: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(__import__("sys").modules, "pyarrow", None)
    before = sorted(path.name for path in run.parent.iterdir())
    assert code_of(run, "--to", to) == 2
    assert "pyarrow" in capsys.readouterr().err
    assert sorted(path.name for path in run.parent.iterdir()) == before


@pytest.mark.parametrize("file", [".", "/", "", "nothing.npz", "x" * 5000 + ".npz", "run.txt"])
def test_what_is_no_run(file: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert code_of(file, "--to", "csv", "--out", tmp_path / "out.csv") == 2
    assert capsys.readouterr().err.startswith("error: ") and not (tmp_path / "out.csv").exists()
    assert code_of(file, "--to", "csv") == 2


def test_what_fails_halfway_leaves_nothing(run: Path, capsys: pytest.CaptureFixture[str]) -> None:
    before = sorted(path.name for path in run.parent.iterdir())
    assert code_of(run, "--to", "lerobot", "--fps", "31.25") == 2
    shows(capsys.readouterr().err)
    assert sorted(path.name for path in run.parent.iterdir()) == before
