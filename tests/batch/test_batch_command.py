"""`retarget batch`: what is refused before anything runs, what is printed, exit codes, and Ctrl-C."""

import json
import os
import signal
import subprocess
import sys
from collections import Counter
from functools import partial
from pathlib import Path
from types import SimpleNamespace
from unittest.mock import Mock

import pytest

import command_line
from hardware.clock import MonotonicClock
from messages import shows
from retarget.batch.batch import BatchTally
from retarget.batch.clip import ClipStatus
from retarget.cli.batch import progress_of
from retarget.errors import UsageError

ROOT = Path(__file__).resolve().parent.parent.parent
SAMPLE = ROOT / "retarget/sources/sample_recording.bvh"
code_of = partial(command_line.code_of, "batch", "--robot", "op3", "--unit", "cm", "--end", "0.1")

REFUSED = {
    "format": ["--format", "cvs"],
    "several formats": ["--format", "csv", "--format=npz"],
    "engine": ["--engine", "rya"],
    "address without ray": ["--address", "auto"],
    "rate of a whole run": ["--fps", "30"],
    "real servos": ["--bus", "profile"],
    "endless": ["--loop"],
    "shard": ["--shard", "3/2"],
    "no time": ["--time-limit", "0"],
    "endless time": ["--time-limit", "inf"],
    "time beyond timers": ["--time-limit", "1e11"],
    "no memory": ["--memory", "0.1"],
    "memory beyond limits": ["--memory", "1e12"],
    "memory that is no number": ["--memory", "nan"],
    "no jobs": ["--jobs", "0"],
    "scene": ["--scene", "tabel"],
    "a folder without motion": ["data/empty"],
}


@pytest.fixture
def data(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "data/empty").mkdir(parents=True)
    (tmp_path / "data/good.bvh").write_bytes(SAMPLE.read_bytes())
    (tmp_path / "data/bad.bvh").write_text("no motion\n")
    return tmp_path / "data"


@pytest.mark.parametrize("case", REFUSED)
def test_what_cannot_be_is_refused_before_anything_runs(
    case: str, data: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert code_of("--out", "out", *REFUSED[case], "data") == 2
    shows(capsys.readouterr().err)
    assert not Path("out").exists()


@pytest.mark.long
def test_a_bad_file_costs_itself_and_the_same_command_goes_on(data: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert code_of("--out", "out", "data", "--jobs", "1") == 1
    said = capsys.readouterr()
    assert "bad.bvh:1" in said.err
    assert sorted(path.name for path in Path("out").iterdir()) == ["good.npz", "index.jsonl", "index.parquet"]
    rows = [json.loads(line) for line in Path("out/index.jsonl").read_text().splitlines()]
    assert {row["source"] for row in rows} == {str(data / "good.bvh"), str(data / "bad.bvh")}
    assert code_of("--out", "out", "data") == 1
    assert len(Path("out/index.jsonl").read_text().splitlines()) == 2
    (data / "bad.bvh").write_bytes(SAMPLE.read_bytes())
    assert code_of("--out", "out", "data", "--jobs", "1") == 0
    assert Path("out/bad.npz").read_bytes() == Path("out/good.npz").read_bytes()


def test_without_pyarrow_the_lines_stay_and_a_note_says_so(
    data: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    nothing = SimpleNamespace(clips=(), done=2, failed=0)
    monkeypatch.setattr("retarget.batch.index.arrow", Mock(side_effect=UsageError("pyarrow is missing")))
    monkeypatch.setattr("retarget.batch.batch.still_to_do", lambda clips, *_, **__: nothing)
    assert code_of("--out", "out", "data") == 0
    assert "pyarrow" in capsys.readouterr().err and Path("out/index.jsonl").is_file()


@pytest.mark.parametrize(
    ("options", "where"),
    [
        (["--unit", "km"], "km"),
        (["--up", "q"], "--up"),
        (["--rate", "-1"], "--rate"),
        (["--stature", "17"], "--stature"),
        (["--skeleton", "no.asf"], "--skeleton"),
    ],
)
def test_a_value_that_no_file_can_take_is_refused_before_any_clip(
    data: Path, options: list[str], where: str, capsys: pytest.CaptureFixture[str]
) -> None:
    (data / "one.bvh").write_bytes(SAMPLE.read_bytes())
    assert command_line.code_of("batch", "--robot", "op3", *options, "--out", "out", "data") == 2
    assert where in capsys.readouterr().err and not Path("out").exists()


def test_a_file_of_the_same_name_that_comes_later_remakes_nothing(data: Path) -> None:
    (data / "bad.bvh").unlink()
    assert code_of("--out", "out", "data", "--jobs", "1") == 0
    made = Path("out/good.npz").stat()
    (data / "good.trc").write_text("no motion\n")
    assert code_of("--out", "out", "data", "--jobs", "1") == 1
    assert Path("out/good.npz").stat().st_mtime_ns == made.st_mtime_ns
    assert [path.name for path in Path("out").glob("*.npz")] == ["good.npz"]
    rows = [json.loads(line) for line in Path("out/index.jsonl").read_text().splitlines()]
    assert [Path(row["source"]).name for row in rows] == ["good.bvh", "good.trc"]


@pytest.mark.long
def test_ctrl_c_ends_it_with_its_exit_code_and_it_goes_on(data: Path) -> None:
    for number in range(40):
        (data / f"{number}.bvh").write_bytes(SAMPLE.read_bytes())
    words = ["batch", "--robot", "op3", "--unit", "cm", "--end", "0.1", "--out", "out", "data", "--jobs", "2"]
    environment, command = os.environ | {"PYTHONPATH": str(ROOT)}, [sys.executable, "-P", "-m", "retarget", *words]
    batch = subprocess.Popen(command, env=environment, stderr=subprocess.PIPE, text=True, process_group=0)
    index, clock = Path("out/index.jsonl"), MonotonicClock()
    while not (index.is_file() and index.read_bytes().count(b"\n") >= 4):
        assert batch.poll() is None
        clock.sleep_until(clock.now() + 0.02)
    os.killpg(batch.pid, signal.SIGINT)  # as a terminal does: the driver and all its processes
    _, said = batch.communicate(timeout=60)
    assert batch.returncode == 130 and "index.jsonl" in said and "Traceback" not in said
    done = index.read_bytes().count(b"\n")
    assert 4 <= done < 42 and index.read_bytes().endswith(b"\n")
    assert command_line.code_of(*words, "--shard", "2/40") == 0
    assert not [*Path("out").rglob("*.part")]


def test_progress_has_rate_failures_and_time_left() -> None:
    tally = BatchTally(todo=1000, done_before=5, failed_before=0)
    assert progress_of(tally) == "1000 clips to do, 5 done before"
    tally.counts, tally.seconds = Counter({ClipStatus.DONE: 95, ClipStatus.TIMED_OUT: 3, ClipStatus.REFUSED: 2}), 50.0
    assert progress_of(tally) == "100 of 1000 clips, 2 a second, 5 failed, 8 min left"
    tally.counts[ClipStatus.DONE] = 995
    assert progress_of(tally) == "1000 of 1000 clips, 20 a second, 5 failed"
