"""A run prints at most 12 lines on a terminal, stdout and stderr together, however long it goes on, but for what must
be said: all else is counted, and is printed with --verbose."""

from collections.abc import Callable
from pathlib import Path
from unittest.mock import Mock

import numpy as np
import pytest

from bus_rig import four_servos
from command_line import said_by
from hardware.clock import VirtualClock
from hardware.guard_state import GuardLimits
from hardware.servo_health import ServoWarnings, WatchedRow, watched
from live_rig import LiveRig, raw_stream
from messages import shows
from recordings import mock_bus
from retarget.cli.controls import ControlRequest
from retarget.cli.exit import DONE, STOPPED, StopRequest
from retarget.cli.operator import MOST_LINES, RunLines, RunOperator
from retarget.cli.run import CommandRun, finished
from retarget.human.samples import Playback
from retarget.live.begin import LiveOptions
from retarget.pictures.outputs import Outputs
from retarget.run.options import RunOptions
from retarget.run.prepare import performance_of
from retarget.run.supervisor import OperatorInput
from retarget.sources.open import open_source
from retarget.types import News, RunState
from sim.faults.sender import FakeSender, silent

EACH_S, GAP_S = 2.0, 0.6
"""A drop-out of so long in each so many seconds."""
HOLDS = "the performer is not followed"


def dropping_out(path: Path, count: int, *, each_s: float = EACH_S, gap_s: float = GAP_S) -> str:
    """Address of a stream that drops out so often, after 4 s in which the performer is measured and approached."""
    ends = [4.0 + number * each_s for number in range(1, count + 1)]
    return raw_stream(path, 5.0 + count * each_s, *(silent(end - gap_s, end) for end in ends))


@pytest.fixture
def printed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> Callable[..., list[str]]:
    """The lines of a command on a terminal: those of stderr, then those of stdout."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("retarget.cli.run.has_terminal", lambda: True)

    def of(*words: object) -> list[str]:
        code, out, err = said_by(capsys, *words)
        assert code in (DONE, STOPPED), err
        return [*err.splitlines(), *out.splitlines()]

    return of


FILE = ("run", "--robot", "op3", "--source", "sample", "--end", "2")
RUNS = {
    "file": FILE,
    "file with results": (*FILE, "--report", "report", "--save", "run.npz", "--plots", "plots"),
    "physics": (*FILE, "--bus", "physics"),
    "physics with perturbations": (*FILE, "--bus", "physics", "--perturb", "push", "--perturb", "latency"),
    "emulator": (*FILE, "--bus", "emulator"),
    "scene": ("run", "--robot", "poppy", "--source", "sample", "--scene", "table", "--end", "2"),
    "human": ("run", "--robot", "human", "--source", "sample", "--end", "2"),
    "demo": ("demo", "--out", "out"),
}


@pytest.mark.long
@pytest.mark.parametrize("run", RUNS)
def test_every_kind_of_run(run: str, printed: Callable[..., list[str]]) -> None:
    lines = printed(*RUNS[run])
    assert len(lines) <= MOST_LINES, "\n".join(lines)


def test_a_replay(printed: Callable[..., list[str]]) -> None:
    pytest.importorskip("mcap", reason="the extra 'record' is not installed (make test installs it)")
    recorded = ("run", "--robot", "op3", "--source", "sample", "--end", "0.5", "--record", "r.mcap")
    for words in (recorded, ("replay", "r.mcap"), ("replay", "r.mcap", "--goals", "--bus", "mock")):
        assert len(printed(*words)) <= MOST_LINES


@pytest.mark.parametrize("count", [12, pytest.param(100, marks=pytest.mark.long)])
def test_a_stream_that_drops_out_again_and_again(count: int, tmp_path: Path, printed: Callable[..., list[str]]) -> None:
    source = dropping_out(tmp_path / "gaps.raw", count)
    robot = "op3" if count < 100 else "human"  # whose run takes a third of the time
    lines = printed("run", "--robot", robot, "--source", source, "--countdown", "1")
    assert len(lines) <= MOST_LINES, "\n".join(lines)
    assert sum(line.startswith(HOLDS) for line in lines) == 1
    shows(next(line for line in lines if line.startswith("held ")), f"{count} times", "--verbose")


def test_with_verbose_a_hold_is_said_again(tmp_path: Path, printed: Callable[..., list[str]]) -> None:
    source = dropping_out(tmp_path / "gaps.raw", 12)
    lines = printed("run", "--robot", "human", "--source", source, "--countdown", "1", "--verbose")
    assert sum(line.startswith(HOLDS) for line in lines) > 1


def test_a_stream_that_is_silent_again_and_again_is_said_why_once(
    tmp_path: Path, printed: Callable[..., list[str]]
) -> None:
    source = dropping_out(tmp_path / "silent.raw", 3, each_s=4.0, gap_s=1.6)
    lines = printed("run", "--robot", "human", "--source", source, "--countdown", "1")
    assert len(lines) <= MOST_LINES, "\n".join(lines)
    assert sum(line.startswith("nothing has arrived for ") for line in lines) == 1
    shows(next(line for line in lines if line.startswith("held ")), "3 times", "--verbose")


Printed = Callable[[], list[str]]
NOTES = ("one", "two", "three")


@pytest.fixture
def lines() -> RunLines:
    return RunLines()


@pytest.fixture
def said(capsys: pytest.CaptureFixture[str]) -> Printed:
    """What was printed since the last call."""
    return lambda: capsys.readouterr().err.splitlines()


def test_an_hour_of_notices_is_a_few_lines_and_a_count(lines: RunLines, said: Printed) -> None:
    for text in ("stand still", *map(News, NOTES), "measured: 1.75 m tall"):
        lines.notify(text)
    assert len(said()) == 4 and lines.later == [NOTES[2]]
    lines.moving = True
    for count in range(3600):
        lines.notify(News(f"l_wrist: nothing that can be used for 0.{count % 10} s", "l_wrist lost"))
        lines.notify(News(f"sender {count}"))
        if count >= 5:
            lines.notify(News(f"{HOLDS}: the robot holds", "hold", is_due=True))
    lines.log("stopping")
    err = said()
    assert len(err) == MOST_LINES - 5 - 4 + 2 and sum(line.startswith(HOLDS) for line in err) == 1, "one was due"
    assert lines.kept_back == 3 * 3600 - 5 - (len(err) - 1)


def no_room(lines: RunLines) -> None:
    """Begin to move with as many lines as a run may have."""
    for count in range(MOST_LINES):
        lines.log(str(count))
    lines.moving = True


def test_every_warning_about_a_servo_has_its_line(lines: RunLines, said: Printed) -> None:
    no_room(lines)
    said()
    servos, rows = four_servos(), watched(GuardLimits(max_temperature=65.0, warn_temperature=60.0))
    warnings, seen = ServoWarnings(servos, rows, 0.5), np.zeros((len(rows), len(servos)))
    for servo in range(2):
        seen[WatchedRow.TEMPERATURE, servo] = 61.0
        warnings.look(seen, float(servo))
        for text in warnings.take_news():
            lines.notify(text)
    err = said()
    assert len(err) == 2 and lines.kept_back == 0
    for line, hot in zip(err, servos[:2], strict=True):
        shows(line, "warning", hot.label)


def test_every_key_has_its_answer(lines: RunLines, said: Printed) -> None:
    rig = LiveRig(FakeSender(), options=LiveOptions(countdown=0.5, duration=1.0))
    with rig.prepared() as prepared:
        keys = Mock(poll=lambda now: [(ControlRequest.PAUSE, "paused")])
        operator = RunOperator(prepared, StopRequest(), controls=[keys], notify=lines.notify)
        no_room(lines)
        said()
        for _ in range(4):
            operator.poll(None)
    assert said() == ["paused", "going on"] * 2


@pytest.mark.parametrize("stand_at_end", [True, False])
def test_that_it_ends_standing_is_said_once_in_the_last_line(
    stand_at_end: bool, said: Printed, capsys: pytest.CaptureFixture[str]
) -> None:
    options = RunOptions(robot="op3", bus="emulator", stand_at_end=stand_at_end, playback=Playback(end=0.1))
    command = CommandRun(options, Outputs(), recorded=True)
    for note in NOTES:
        command.lines.notify(News(f"note: {note}"))
    said()
    with command.prepared(performance_of(lambda: open_source("sample"), options.playback)) as prepared:
        result = command.play(prepared, command.operator(prepared, StopRequest()))
    assert not said(), "no servo of a simulation needs to be known without torque"
    finished(result, Outputs(), command.lines)
    _, note, last = capsys.readouterr().out.splitlines()
    assert note == f"note: {NOTES[2]}", "what was not said before"
    assert ("--stand-at-end" in last) is stand_at_end


def test_on_real_servos_it_is_said_before_that_it_will_stand_and_at_the_end_that_torque_is_off(said: Printed) -> None:
    options = RunOptions(robot="op3", bus="profile", stand_at_end=True, playback=Playback(end=0.1))
    command = CommandRun(options, Outputs(), recorded=True)
    command.clock, command.bench = VirtualClock(), Mock(make_bus=mock_bus, may_topple=False)
    with command.prepared(performance_of(lambda: open_source("sample"), options.playback)) as prepared:
        shows("\n".join(said()), "at the end it stands, with torque")
        stop, machine = StopRequest(), prepared.machine
        assert machine is not None

        def poll(state: RunState | None) -> OperatorInput:
            if state is RunState.STANDING:
                stop.force("held")
            return OperatorInput(stop.why or None, stop.torque_off)

        command.play(prepared, Mock(poll=poll, stop=stop))
    *warnings, reminder, last = said()  # the currents of this bus never change
    assert len(warnings) <= 1
    shows(reminder, "torque is on: hold the robot")
    assert last.startswith("torque is off")


def test_a_second_attempt_counts_its_lines_anew_and_repeats_no_note(lines: RunLines, said: Printed) -> None:
    for _ in range(3):
        for text in (News(NOTES[0]), "stand still", "not yet"):
            lines.notify(text)
        lines.try_again()
    assert said() == [NOTES[0], *["stand still", "not yet"] * 3]
    assert lines.room == RunLines().room and not lines.later
