"""`retarget export`: one clear message for what cannot be; nothing is overwritten, nothing is left."""

import json
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from command_line import Typed
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


@pytest.fixture
def left(run: Path) -> Iterator[None]:
    """Whatever happens, the files beside the run stay the same."""
    before = {path: path.read_bytes() for path in run.parent.iterdir()}
    yield
    assert {path: path.read_bytes() for path in run.parent.iterdir()} == before


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
def test_beside_the_run_and_never_twice(to: str, run: Path, done: Typed, refused: Typed) -> None:
    words, before = ("export", run, "--to", to), {path.name for path in run.parent.iterdir()}
    out = done(*words)
    assert {path.name for path in run.parent.iterdir()} - before == {ENDINGS[to]}
    shows(out, 10, 3)
    assert out.splitlines()[-1] == str(FORMATS[to].conventions)
    place = run.parent / ENDINGS[to]
    stamp, before_it = place.stat().st_mtime_ns, place.stat().st_ino
    shows(refused(*words))
    assert place.stat().st_mtime_ns == stamp
    done(*words, "--overwrite")
    assert place.stat().st_ino != before_it


def test_the_same_line_twice_names_the_option_that_replaces(run: Path, done: Typed, refused: Typed) -> None:
    words, table = ("export", run, "--to", "csv"), run.parent / "run.csv"
    done(*words)
    first = table.read_bytes()
    said = refused(*words)
    assert said.count("\n") == 1
    shows(said, "--out", "--overwrite")
    table.write_text("another")
    done(*words, "--overwrite")
    assert table.read_bytes() == first


def test_no_foreign_file_is_lost_by_overwriting(run: Path, done: Typed, refused: Typed) -> None:
    project, ours = run.parent / "project", run.parent / "run_lerobot"
    words: tuple[object, ...] = ("export", run, "--to", "lerobot", "--overwrite")
    done(*words)
    done(*words)
    (ours / "notes.txt").write_text("mine")
    shows(refused(*words), "notes.txt")
    assert (ours / "notes.txt").read_text() == "mine"
    words += ("--out", project)
    (project / "data").mkdir(parents=True)
    (project / "data" / "raw.csv").write_text("mine")
    shows(refused(*words), "project with data/raw.csv")
    (project / "data" / "raw.csv").rename(project / "README.md")
    (project / "data").rmdir()
    shows(refused(*words), "README.md", "without meta/info.json")
    assert (project / "README.md").read_text() == "mine"
    (project / "README.md").unlink()
    (project / "elsewhere").symlink_to(run.parent)
    shows(refused(*words), "elsewhere")
    (project / "elsewhere").unlink()
    done(*words)
    assert (project / "meta" / "info.json").is_file()


def test_no_file_that_is_read_is_replaced(run: Path, refused: Typed) -> None:
    body, before = run.parent / "slider.xml", run.read_bytes()
    shape = body.read_bytes()
    (run.parent / "link.npz").symlink_to(run)
    (run.parent / "second.npz").hardlink_to(run)
    for to in ("npz", "gmr-npz"):
        for out in (run, run.parent / "link.npz", run.parent / "second.npz"):
            shows(refused("export", run, "--to", to, "--out", out, "--overwrite"), "--out", "a file that is read")
    assert (run.parent / "link.npz").is_symlink()
    shows(refused("export", run, "--to", "sonic", "--out", run.parent, "--overwrite"), "the folder of run.npz")
    words = ("--to", "csv", "--body", body, "--out", body, "--overwrite")
    shows(refused("export", run, *words), "a file that is read")
    again = run.parent / "run_lerobot" / "again.npz"
    again.parent.mkdir()
    again.write_bytes(before)
    shows(refused("export", run, again, "--to", "lerobot", "--overwrite"), "the folder of again.npz")
    assert run.read_bytes() == again.read_bytes() == before and body.read_bytes() == shape


def test_several_runs_are_one_data_set_and_no_table(run: Path, done: Typed, refused: Typed) -> None:
    again = run.with_name("again.npz")
    again.write_bytes(run.read_bytes())
    shows(refused("export", run, again, "--to", "csv"), "--to", 2)
    assert done("export", run, again, "--to", "lerobot").count("27 rows") == 2
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
def test_refused_in_one_line(case: str, run: Path, left: None, refused: Typed, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(run.parent)
    words, message = REFUSED[case]
    said = refused("export", run, *words)
    assert message in said and said.count("\n") == 1


@pytest.mark.parametrize("to", ["parquet", "lerobot"])
def test_without_pyarrow(to: str, run: Path, left: None, refused: Typed, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    assert "pyarrow" in refused("export", run, "--to", to)


@pytest.mark.parametrize("file", [".", "/", "", "nothing.npz", "x" * 5000 + ".npz", "run.txt"])
def test_what_is_no_run(file: str, tmp_path: Path, refused: Typed) -> None:
    refused("export", file, "--to", "csv", "--out", tmp_path / "out.csv")
    refused("export", file, "--to", "csv")
    assert not (tmp_path / "out.csv").exists()


def test_what_fails_halfway_leaves_nothing(run: Path, left: None, refused: Typed) -> None:
    shows(refused("export", run, "--to", "lerobot", "--fps", "31.25"))
