"""`retarget run`: end to end, what is refused before anything happens, and what a person reads."""

import json
import os
import re
import signal
import subprocess
import sys
from contextlib import nullcontext
from pathlib import Path
from unittest.mock import Mock

import numpy as np
import pytest

from command_line import Typed, code_of, said_by
from hardware.guard import Torque
from live_rig import LiveRig, raw_stream
from messages import shows, shows_lines
from retarget.cli.controls import ControlRequest
from retarget.cli.exit import DONE, INTERRUPTED, REFUSED, STOPPED, StopRequest
from retarget.cli.operator import TORQUE_WORDS, RunOperator
from retarget.cli.run import _wait_until_engaged
from retarget.errors import UsageError
from retarget.live.begin import LiveOptions
from retarget.live.performer import LivePerformer
from retarget.report.measure import measure
from retarget.report.report import Report
from retarget.run.options import RunOptions
from retarget.run.run_result import RunResult
from retarget.sources.streams.raw_record import RawReader, RawWriter
from sim.faults.sender import FakeSender


@pytest.fixture
def slimevr(shared: Path) -> str:
    """A performer who stands still, and raises the left arm to the side two seconds later."""
    return f"replay://{shared}/streams/slimevr/full12_vmc_50hz.udprec.gz?kind=vmc"


SHORT = ("run", "--robot", "human", "--countdown", "0", "--end", "0.2")


def test_a_real_left_arm_to_the_side_is_not_enough(slimevr: str, capsys: pytest.CaptureFixture[str]) -> None:
    """The recorded arm goes straight to the side: that shows the sides, but not whether the world is mirrored."""
    code, _, err = said_by(capsys, *SHORT, "--source", slimevr, "--check-sides")
    assert code == REFUSED
    shows(err)


def test_a_stop_that_is_asked_for_before_torque_is_on_ends_the_command(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """A signal that comes while the last of a run is prepared, with signals handled already."""
    asked = Mock(return_value=nullcontext(StopRequest("interrupted by the user")))
    monkeypatch.setattr("retarget.cli.run.stop_on_signals", asked)
    path = tmp_path / "run.json"
    code, _, err = said_by(capsys, "run", "--robot", "op3", "--source", "sample", "--end", "1", "--report", path)
    assert code == INTERRUPTED and "interrupted" in err and "torque" not in err and not path.exists()


@pytest.mark.long
def test_a_real_person_is_kept(
    slimevr: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path))
    for _ in range(2):
        code, _, err = said_by(capsys, *SHORT, "--source", slimevr, "--person", "anna")
        assert code == DONE and (tmp_path / "retarget/people/anna.yaml").is_file()
        shows(err, "1.6")


@pytest.mark.long
def test_a_run_in_which_nobody_was_followed_is_no_success(
    shared: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The stream ends while the robot is on its approach."""
    short = tmp_path / "short.udprec"
    whole = RawReader(shared / "streams/slimevr/full12_vmc_50hz.udprec.gz")
    writer = RawWriter(short, url="vmc://:39539")
    for number, datagram in zip(range(100), whole, strict=False):
        writer.append(datagram.payload, time_ns=number * 20_000_000, address="127.0.0.1", port=39539)
    writer.close()
    words = ("--robot", "op3", "--source", f"replay://{short}?kind=vmc", "--countdown", "0")
    code, _, err = said_by(capsys, "run", *words)
    assert code == STOPPED
    shows(next(line for line in err.splitlines() if "followed" in line))


@pytest.mark.long
def test_a_real_person_who_is_followed_at_once_keeps_the_robots_soles_to_the_end(slimevr: str, tmp_path: Path) -> None:
    """With an approach that was too short, the mass was outside the support for 138 ticks, and a sole was lifted by 11
    mm on the way to rest."""
    report = tmp_path / "report.json"
    assert code_of("run", "--robot", "op3", "--source", slimevr, "--countdown", "0", "--report", report) == DONE
    found = json.loads(report.read_text(encoding="utf-8"))
    assert found["stop"] == {"state": "off", "reason": None}
    assert found["com_outside_support_frames"] == 0
    assert found["soles"]["height_mm"] < 0.5 and found["soles"]["tilt_deg"] < 0.1


def test_what_was_asked_before_it_begins_is_obeyed_before_anything_has_torque() -> None:
    rig = LiveRig(FakeSender(), options=LiveOptions(countdown=0.5, duration=1.0))
    with rig.prepared() as prepared:
        stop, performer, begun = StopRequest(), prepared.samples, rig.clock.now()
        assert isinstance(performer, LivePerformer)
        grip = Mock(poll=lambda now: [(ControlRequest.GRIP, "held")] * (now - begun > 1.0))
        operator = RunOperator(prepared, stop, controls=[grip], notify=rig.said.append, dead_man=True)
        _wait_until_engaged(operator, performer, rig.clock)
        assert 1.0 < rig.clock.now() - begun < 1.1
        stop.request("the operator asked")
        with pytest.raises(KeyboardInterrupt):
            _wait_until_engaged(operator, performer, rig.clock)
        assert not rig.bus.torque_on


def test_what_is_to_be_known_of_the_robot_is_said_before_the_performer_gets_into_the_pose() -> None:
    rig = LiveRig(FakeSender())
    rig.run_options = RunOptions(robot="op3", priorities="fixed_base")
    with rig.prepared() as prepared:
        [note] = [note for note in prepared.notes if "fixed_base" in note]
        assert rig.said[0].endswith(note) and len(rig.said) > 1


@pytest.mark.long
def test_the_end_of_a_recorded_stream_is_the_end_of_the_run(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Done, and not stopped for want of data: even of a robot, and with time to spare."""
    source, report = raw_stream(tmp_path / "six.raw", 6.0), tmp_path / "report.json"
    words = ("--robot", "op3", "--countdown", "0", "--source", source, "--report", report)
    code, _, err = said_by(capsys, "run", *words)
    written = json.loads(report.read_text())
    assert code == DONE and written["stop"]["reason"] is None
    assert 3.0 < written["duration_s"] < 6.0
    shows(err)


@pytest.fixture
def amc(shared: Path) -> Path:
    return shared / "mocap" / "cmu_asfamc" / "02_06.amc"


def test_a_robot_follows_a_recording(amc: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    report, saved = tmp_path / "r.json", tmp_path / "r.npz"
    words = ("--source", amc, "--end", "3", "--speed", "0.5", "--report", report, "--save", saved)
    code, out, err = said_by(capsys, "run", "--robot", "op3", *words)
    assert code == DONE
    data = json.loads(report.read_text())
    assert data["frames"] == 361 and data["ticks"] > 751 and data["rate_hz"] == 125.0
    assert data["stop"] == {"state": "off", "reason": None}
    assert data["bus"]["hottest"] is data["bus"]["lowest_voltage"] is None, "mock servos measure neither"
    assert data["limit_violations"] == {"position": 0, "velocity": 0, "acceleration": 0}
    assert data["hand_path_ratio"] > 0.5 and data["pelvis_excursion_ratio"] > 0.3
    with np.load(saved) as arrays:
        phase, time = arrays["phase"], arrays["time"]
        assert len(time) == data["ticks"] and set(phase) == {"approach", "follow", "brake"}
        assert time[phase == "follow"] == pytest.approx(np.arange(751) / 125.0)
        assert np.isfinite(arrays["joint_positions"]).all()
    heading, files, sentence = out.splitlines()
    assert heading.startswith(str(amc)) and files == f"written: 2 files in {tmp_path}"
    assert sentence.startswith("op3 ") and sentence.endswith(f". Look at {report}")
    assert "%" not in err  # no progress bar in a pipe


@pytest.mark.long
@pytest.mark.parametrize(
    "options",
    [
        ("--bus", "none"),
        ("--no-gate",),
        ("--mirror",),
        ("--parts", "upper"),
        ("--performer", "ten"),
        ("--n-ik", "1"),
        ("--rate", "60"),
    ],
)
def test_options_run(amc: Path, tmp_path: Path, options: tuple[str, ...]) -> None:
    words = ("--robot", "op3", "--source", amc, "--end", "0.3", "--report", tmp_path / "r.json")
    assert code_of("run", *words, *options) == DONE
    data = json.loads((tmp_path / "r.json").read_text())
    assert (data["bus"] is None) == ("none" in options)
    if "upper" in options:
        assert data["foot_slide_mm"] < 1e-6


def short(amc: Path, *words: str | Path) -> tuple[str | Path, ...]:
    return ("run", "--robot", "human", "--source", amc, "--end", "0.1", *words)


def test_files_are_there_before_anything_is_said_and_ctrl_c_after_the_motion_costs_none(
    amc: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def measured(result: RunResult) -> Report:
        for _ in range(2):
            signal.raise_signal(signal.SIGINT)
        return measure(result)

    seen, report = list[bool](), tmp_path / "r.json"
    monkeypatch.setattr("retarget.cli.run.measure", measured)
    monkeypatch.setattr("retarget.cli.run.show_summary", lambda *_, **__: seen.append(report.exists()))
    assert code_of(*short(amc, "--report", report)) == DONE
    assert seen == [True]


@pytest.mark.long
def test_a_file_that_cannot_be_written_costs_no_other(
    amc: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    fail = UsageError("cannot write here", where="--report", found="No space left on device")
    for function in ("outputs.write_report", "plots.write_plots"):
        monkeypatch.setattr(f"retarget.pictures.{function}", Mock(side_effect=fail))
    saved, pictures = tmp_path / "r.npz", tmp_path / "new" / "pictures"
    words = short(amc, "--report", tmp_path / "r.json", "--save", saved, "--plots", pictures)
    code, out, err = said_by(capsys, *words)
    assert code == STOPPED
    shows_lines(out, re.compile("^(written)"))
    assert {path.name for path in tmp_path.iterdir()} == {"r.npz", "r_human.xml"}
    note, *errors = err.splitlines()
    assert note.startswith("note: frame rate")
    assert [line[:20] for line in errors] == ["error: report not wr", "error: picture not w"]
    shows("\n".join(errors))


@pytest.mark.long
def test_a_reader_that_leaves_costs_no_file(amc: Path, tmp_path: Path) -> None:
    words = [sys.executable, "-m", "retarget", *map(str, short(amc, "--report", tmp_path / "r.json"))]
    reader, writer = os.pipe()
    os.close(reader)
    with os.fdopen(writer, "w") as pipe:
        result = subprocess.run(words, stdout=pipe, stderr=subprocess.PIPE, text=True, timeout=60)
    assert result.returncode == DONE
    assert [line[:16] for line in result.stderr.splitlines()] == ["note: frame rate"]
    assert (tmp_path / "r.json").exists()


@pytest.mark.long
@pytest.mark.parametrize(("until", "torque"), [(4.0, Torque.OFF), (30.0, Torque.UNCONFIRMED)])
def test_the_end_of_torque_is_said_where_no_servo_confirms_it(
    until: float, torque: Torque, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    faults = tmp_path / "faults.yaml"
    faults.write_text(f"faults: [{{fault: missing, ids: [5], start: 3.9, end: {until}}}]\n")
    words = ("--robot", "op3", "--source", "sample", "--end", "0.5", "--bus", "emulator", "--faults", faults)
    code, _, err = said_by(capsys, "run", *words)
    said = any(line.startswith(TORQUE_WORDS[torque]) for line in err.splitlines())
    assert code == STOPPED
    assert said is (torque is Torque.UNCONFIRMED), "simulated servos without torque are no news"


def test_a_recording_is_played_on_one_core_and_has_no_dead_man(refused: Typed) -> None:
    words = ("run", "--robot", "human", "--source", "sample", "--end", "0.1", "--core")
    assert code_of(*words, min(os.sched_getaffinity(0))) == DONE
    assert "--dead-man" in refused(*words, "0", "--dead-man", "d")


def test_what_is_to_be_known_of_a_run_is_said_once_and_before_it(capsys: pytest.CaptureFixture[str]) -> None:
    words = ("--robot", "op3", "--source", "sample", "--end", "0.1", "--priorities", "fixed_base")
    code, out, err = said_by(capsys, "run", *words)
    [note] = [line for line in err.splitlines() if "fixed_base" in line]
    shows(note, "balance", "op3")
    assert code == DONE and note not in out
