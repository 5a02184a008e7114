"""`retarget replay`: what a person reads, the exit codes, and what is refused."""

import json
import re
import shutil
from pathlib import Path

import numpy as np
import pytest

from command_line import Typed, said_by
from messages import shows
from recordings import Recorded, record
from retarget.cli.exit import DONE, STOPPED
from retarget.recording.read_run import read_run
from retarget.run.options import RunOptions
from retarget.schema.catalogue import shipped_folder


@pytest.fixture(scope="module")
def plain(tmp_path_factory: pytest.TempPathFactory) -> Recorded:
    return record(tmp_path_factory.mktemp("command") / "run.mcap")


@pytest.mark.long
def test_the_same_goals(plain: Recorded, done: Typed, tmp_path: Path) -> None:
    first, second, third, *_ = done("replay", plain.path, "--save", tmp_path / "again.npz").splitlines()
    assert first == f"{plain.path}: synthetic on op3, --bus mock"
    assert second.startswith("all ") and second.endswith(" ticks")
    assert third == f"run: {tmp_path / 'again.npz'}"
    with np.load(tmp_path / "again.npz") as arrays:
        assert len(arrays["time"]) == len(plain.result.record)


@pytest.mark.long
def test_other_goals(plain: Recorded, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    other = plain.read()
    other.cycles.goal_ticks[100:, 4] += 3
    monkeypatch.setattr("retarget.recording.reading.read_recording", lambda path: other)
    code, out, _ = said_by(capsys, "replay", plain.path)
    assert code == STOPPED
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
    code, out, err = said_by(capsys, "replay", cut)
    assert code == STOPPED
    seconds, cycle = map(float, re.findall(r"its first ([\d.]+) s are read, up to cycle (\d+)", err)[0])
    assert seconds == pytest.approx(0.008 * (cycle - 1), abs=0.02)
    compared = int(out.split("all ")[1].split()[0])
    assert 0 < compared < len(whole.result.record)
    shows(err, compared, varies=CUT)
    shows(out, compared, varies=CUT)


@pytest.mark.long
def test_a_robot_that_is_gone(tmp_path: Path, capsys: pytest.CaptureFixture[str], refused: Typed) -> None:
    """Its files are in the recording; the body goes beside the run that is saved, where others find it."""
    own, away = tmp_path / "op3", tmp_path / "away"
    shutil.copytree(shipped_folder() / "robots" / "op3", own)
    recorded = record(tmp_path / "run.mcap", options=RunOptions(robot=str(own)), seconds=0.1)
    words = ("replay", recorded.path)
    own.rename(away)
    files = ("--save", tmp_path / "again.npz", "--report", tmp_path / "again.json")
    for right in (files, ("--robot", away), ("--goals", "--bus", "mock")):
        code, _, err = said_by(capsys, *words, *right)
        assert (code, err) == (DONE, "")
    assert (tmp_path / "again_body.xml").read_bytes() == (away / "body.xml").read_bytes()
    assert read_run(tmp_path / "again.npz").joint_names == read_run(recorded.path).joint_names
    for wrong in (("--robot", "toddlerbot"), ("--goals", "--bus", tmp_path / "tty")):
        shows(refused(*words, *wrong))


@pytest.mark.long
def test_goals_go_to_a_bus(plain: Recorded, done: Typed) -> None:
    out = done("replay", plain.path, "--goals", "--bus", "emulator")
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
    code, _, shown = said_by(capsys, "replay", recorded.path, "--goals", "--bus", "mock")
    assert code == DONE and shown.count("note: ") == 1 and shown.startswith(f"note: {recorded.result.notes[0]}\n")
    shows(shown, "fixed_base", "op3")
    assert said_by(capsys, "replay", recorded.path, "--report", tmp_path / "again.json")[0] == DONE
    assert json.loads((tmp_path / "again.json").read_text(encoding="utf-8"))["notes"] == [*recorded.result.notes]
