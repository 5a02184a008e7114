"""`retarget replay`: what a person reads, the exit codes, and what is refused."""

import json
import re
import shutil
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from command_line import code_of
from messages import shows
from recordings import Recorded, record
from retarget.cli.exit import DONE, REFUSED, STOPPED
from retarget.recording.read_run import read_run
from retarget.recording.reading import Recording
from retarget.run.options import RunOptions
from retarget.schema.catalogue import shipped_folder

run = partial(code_of, "replay")


@pytest.fixture(scope="module")
def plain(tmp_path_factory: pytest.TempPathFactory) -> Recorded:
    return record(tmp_path_factory.mktemp("command") / "run.mcap")


@pytest.mark.long
def test_the_same_goals(plain: Recorded, capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    assert run(plain.path, "--save", tmp_path / "again.npz") == DONE
    shown = capsys.readouterr()
    lines = shown.out.splitlines()
    assert lines[0] == f"{plain.path}: synthetic on op3, --bus mock"
    assert lines[1].startswith("all ") and lines[1].endswith(" ticks")
    assert lines[2] == f"run: {tmp_path / 'again.npz'}" and shown.err == ""
    with np.load(tmp_path / "again.npz") as arrays:
        assert len(arrays["time"]) == len(plain.result.record)


@pytest.mark.long
def test_other_goals(plain: Recorded, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    def moved(path: Path) -> Recording:
        found = plain.read()
        found.cycles.goal_ticks[100:, 4] += 3
        return found

    monkeypatch.setattr("retarget.recording.reading.read_recording", moved)
    assert run(plain.path) == STOPPED
    out = capsys.readouterr().out
    shows(out, 100, "0.800", "0.264", 3)


CUT = re.compile(r"(?<=early)[:,][^;]*|\d+")
"""Where a file is cut, and what is left, is the compressor's."""


@pytest.mark.long
@pytest.mark.parametrize("share", [0.5, pytest.param(0.75, marks=pytest.mark.long)])
def test_a_recording_that_was_cut_off(
    share: float, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """What is there is compared, and said to be not all."""
    monkeypatch.setattr("retarget.recording.mcap_writer.FLUSH_S", 0.0)  # many chunks of a short run
    cut, whole = tmp_path / "cut.mcap", record(tmp_path / "run.mcap")
    content = whole.path.read_bytes()
    cut.write_bytes(content[: round(share * len(content))])
    assert run(cut) == STOPPED
    shown = capsys.readouterr()
    shows(shown.err, varies=CUT)
    seconds, cycle = map(float, re.findall(r"its first ([\d.]+) s are read, up to cycle (\d+)", shown.err)[0])
    assert seconds == pytest.approx(0.008 * (cycle - 1), abs=0.02)
    compared = int(shown.out.split("all ")[1].split()[0])
    assert 0 < compared < len(whole.result.record)
    shows(shown.err, compared, varies=CUT)
    shows(shown.out, compared, varies=CUT)


@pytest.mark.long
def test_a_robot_that_is_gone(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Its files are in the recording; the body goes beside the run that is saved, where others find it."""
    own = tmp_path / "op3"
    shutil.copytree(shipped_folder() / "robots" / "op3", own)
    recorded = record(tmp_path / "run.mcap", options=RunOptions(robot=str(own)), seconds=0.1)
    own.rename(tmp_path / "away")
    assert run(recorded.path, "--save", tmp_path / "again.npz", "--report", tmp_path / "again.json") == DONE
    shown = capsys.readouterr()
    assert shown.err == ""
    assert (tmp_path / "again_body.xml").read_bytes() == (tmp_path / "away" / "body.xml").read_bytes()
    assert read_run(tmp_path / "again.npz").joint_names == read_run(recorded.path).joint_names
    assert run(recorded.path, "--robot", tmp_path / "away") == DONE
    assert capsys.readouterr().err == ""
    assert run(recorded.path, "--robot", "toddlerbot") == REFUSED
    shows(capsys.readouterr().err)
    assert run(recorded.path, "--goals", "--bus", "mock") == DONE
    assert run(recorded.path, "--goals", "--bus", tmp_path / "tty") == REFUSED
    shows(capsys.readouterr().err)


@pytest.mark.long
def test_goals_go_to_a_bus(plain: Recorded, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(plain.path, "--goals", "--bus", "emulator") == DONE
    out = capsys.readouterr().out
    counts = re.search(
        r"(\d+) goals sent along .* emulator, (\d+) during .* and (\d+) while .*\n.* 0 of these (\d+)\n", out
    )
    assert counts is not None
    shows(out)
    followed, there, rest, of = map(int, counts.groups())
    assert followed + there + rest == of and followed >= plain.result.ticks_followed and min(there, rest) > 0


def test_a_note_is_said_once(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    options = RunOptions(robot="op3", priorities="fixed_base")
    recorded = record(tmp_path / "run.mcap", options=options, seconds=0.1)
    assert run(recorded.path, "--goals", "--bus", "mock") == DONE
    shown = capsys.readouterr().err
    assert shown.count("note: ") == 1 and shown.splitlines()[0] == f"note: {recorded.result.notes[0]}"
    shows(shown, "fixed_base", "op3")
    assert run(recorded.path, "--report", tmp_path / "again.json") == DONE
    assert json.loads((tmp_path / "again.json").read_text(encoding="utf-8"))["notes"] == [*recorded.result.notes]
