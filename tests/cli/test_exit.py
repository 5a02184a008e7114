"""How a command ends: detached screens, signals, forced stops, exit codes."""

import json
import os
import signal
import socket
import subprocess
import sys
import threading
from collections.abc import Iterator
from contextlib import nullcontext, suppress
from pathlib import Path
from unittest.mock import Mock

import pytest
import typer
from hypothesis import given, settings
from hypothesis import strategies as st

from hardware.clock import MonotonicClock, VirtualClock
from live_processes import PATIENCE_S, Performer, free_port
from messages import shows
from retarget.cli import exit
from retarget.cli.application import progress_bar
from retarget.cli.exit import (
    MOST,
    REASONS,
    STOPPED,
    ForcedStopKey,
    KeyPress,
    Screen,
    all_as_ctrl_c,
    detached_screens,
    interruptible,
    stop_on_signals,
)

CLOCK = MonotonicClock()


@pytest.fixture
def full_pipe() -> Iterator[tuple[int, int]]:
    """Both ends of a pipe that is full and not read."""
    reading, writing = os.pipe()
    os.set_blocking(writing, False)
    with suppress(BlockingIOError):
        while True:
            os.write(writing, bytes(4096))
    os.set_blocking(writing, True)
    yield reading, writing
    os.close(reading)
    os.close(writing)


@pytest.mark.parametrize("barred", [False, True])
def test_nothing_goes_past_the_thread(barred: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """What is printed, also above a progress bar, which has a stream of its own in front of stderr."""
    wrote = list[str]()

    def write(self: Screen, text: str) -> int:
        if not isinstance(text, str):
            raise TypeError
        wrote.append(text)
        return len(text)

    with (tmp_path / "stderr").open("w", encoding="utf-8") as stream:
        monkeypatch.setattr(sys, "stderr", stream)
        monkeypatch.setattr(Screen, "write", write)
        monkeypatch.setattr(Screen, "isatty", lambda self: barred)
        monkeypatch.setenv("TERM", "xterm")
        with detached_screens(), progress_bar("op3", 100) as show:
            show(50)
            typer.echo("held", err=True)
    assert "held" in "".join(wrote) and ("op3" in "".join(wrote)) == barred
    assert (tmp_path / "stderr").read_text(encoding="utf-8") == ""


def test_an_unread_pipe_holds_nothing_up(full_pipe: tuple[int, int]) -> None:
    reading, writing = full_pipe
    begun, read = CLOCK.now(), b""
    os.set_blocking(reading, False)
    with os.fdopen(writing, "w", closefd=False) as stream:
        screen = Screen(stream)
        screen.waits = False
        for count in range(3 * MOST):
            screen.write(f"{count} ")
        assert not screen.drain(0.05) and CLOCK.now() - begun < 1.0
        drained = False
        while not drained and CLOCK.now() - begun < PATIENCE_S:
            drained = screen.drain(0.01)
            with suppress(BlockingIOError):
                read += os.read(reading, 1 << 20)
        screen.end(None)
    latest = [int(text) for text in read.lstrip(b"\0").split()][-MOST:]
    assert latest == [*range(2 * MOST, 3 * MOST)], "read again: the latest are there"


def test_the_end_of_a_run_waits_for_both_at_once(full_pipe: tuple[int, int], monkeypatch: pytest.MonkeyPatch) -> None:
    begun = CLOCK.now()
    with os.fdopen(full_pipe[1], "w", closefd=False) as stuck, monkeypatch.context() as patch:
        patch.setattr(sys, "stdout", stuck)
        patch.setattr(sys, "stderr", stuck)
        with detached_screens():
            sys.stdout.write("text")
            sys.stderr.write("text")
    assert exit.PATIENCE_S <= CLOCK.now() - begun < 2.0 * exit.PATIENCE_S
    os.read(full_pipe[0], 1 << 20)


def asked(path: Path, word: str) -> dict[str, object] | str:
    """What the run answers, or "" while it does not listen."""
    with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as client, suppress(OSError):
        client.settimeout(1.0)
        client.connect(str(path))
        client.sendall(f"{word}\n".encode())
        answer = client.recv(500).decode()
        return json.loads(answer) if answer.startswith("{") else answer
    return ""


@pytest.mark.long
def test_a_live_run_whose_terminal_takes_nothing_is_stopped_and_leaves_its_report(
    full_pipe: tuple[int, int], tmp_path: Path
) -> None:
    port, control, report = free_port(), tmp_path / "control", tmp_path / "report.json"
    performer = Performer(port)
    performer.start()
    words = ["--robot", "op3", "--source", f"json://127.0.0.1:{port}", "--bus", "mock", "--yes", "--countdown", "0.2"]
    words += ["--control-socket", str(control), "--report", str(report)]
    run = subprocess.Popen(
        [sys.executable, "-m", "retarget", "run", *words],
        stdin=subprocess.DEVNULL,
        stdout=full_pipe[1],
        stderr=full_pipe[1],
    )
    try:
        end = CLOCK.now() + PATIENCE_S
        while CLOCK.now() < end and run.poll() is None:
            status = asked(control, "status")
            if isinstance(status, dict) and status["followed"]:
                break
            CLOCK.sleep_until(CLOCK.now() + 0.1)
        assert asked(control, "stop") == "ok stopping\n"
        assert run.wait(8.0) == STOPPED
        assert json.loads(report.read_text())["stop"]["state"] == "off"
    finally:
        performer.done.set()
        run.kill()
        run.wait()


INT, TERM, HUP = signal.SIGINT, signal.SIGTERM, signal.SIGHUP


@pytest.mark.parametrize("number", REASONS)
def test_a_signal_asks_to_stop_and_where_nothing_moves_any_more_it_interrupts(number: signal.Signals) -> None:
    before = signal.getsignal(number)
    with stop_on_signals(moves=True) as asked:
        with pytest.raises(KeyboardInterrupt), interruptible():
            signal.raise_signal(number)
        assert not asked()
        signal.raise_signal(number)
        assert asked() and not asked.torque_off
        assert asked.why == REASONS[number] and number.name in asked.why.replace("Ctrl-C", "SIGINT")
        signal.raise_signal(INT)
        assert asked.why == REASONS[number], "the first one stays"
    assert signal.getsignal(number) is before


@pytest.mark.parametrize(
    ("numbers", "torque_off"),
    [
        *(([first, *[INT] * count], True) for first in REASONS if first != INT for count in (1, 3)),
        ([TERM, HUP, TERM], False),
    ],
)
def test_only_ctrl_c_after_another_signal_forces_torque_off(numbers: list[signal.Signals], torque_off: bool) -> None:
    with stop_on_signals() as asked:
        for number in numbers:
            signal.raise_signal(number)
        assert asked() and asked.torque_off is torque_off


def test_one_ctrl_c_after_another_kind_of_stop_still_brakes() -> None:
    """After the space bar, a stop file or a button, it is the first signal."""
    with stop_on_signals() as asked:
        asked.request("the stop file is there")
        signal.raise_signal(INT)
        assert asked() and not asked.torque_off


def test_a_held_ctrl_c_asks_and_pressed_again_it_forces_torque_off() -> None:
    clock = VirtualClock()
    with stop_on_signals(clock) as asked:
        for _ in range(60):  # as a keyboard repeats it
            signal.raise_signal(INT)
            clock.advance(0.03)
            assert asked() and not asked.torque_off
        assert asked.too_soon == 59
        clock.advance(0.3)
        signal.raise_signal(INT)
        assert asked.torque_off


def test_ctrl_z_suspends_no_robot_that_moves() -> None:
    """Else it would stand there with torque, without a process that controls it."""
    before = signal.getsignal(signal.SIGTSTP)
    with stop_on_signals():
        assert signal.getsignal(signal.SIGTSTP) is before, "where nothing moves, it suspends"
    with stop_on_signals(moves=True) as asked:
        signal.raise_signal(signal.SIGTSTP)
        assert asked() and not asked.torque_off
        shows(asked.why)
    assert signal.getsignal(signal.SIGTSTP) is before


@pytest.mark.parametrize(("number", "stays"), [(n, n in (HUP, TERM)) for n in REASONS])
def test_what_is_ignored_stays_ignored_but_for_what_a_script_ignores_in_the_background(
    number: signal.Signals, stays: bool
) -> None:
    before = signal.signal(number, signal.SIG_IGN)
    try:
        with nullcontext() if stays else pytest.raises(KeyboardInterrupt), all_as_ctrl_c():
            with stop_on_signals() as asked:
                signal.raise_signal(number)
                assert asked() is not stays
            signal.raise_signal(number)
        assert signal.getsignal(number) is signal.SIG_IGN
    finally:
        signal.signal(number, before)


@pytest.mark.parametrize("number", [*REASONS])
def test_outside_of_a_motion_each_of_them_is_as_ctrl_c(number: signal.Signals) -> None:
    before = {each: signal.getsignal(each) for each in REASONS}
    with pytest.raises(KeyboardInterrupt), all_as_ctrl_c():
        with stop_on_signals() as asked:
            signal.raise_signal(number)
            assert asked()
        signal.raise_signal(number)
    assert {each: signal.getsignal(each) for each in REASONS} == before


def test_signals_that_are_handled_already_are_left_alone() -> None:
    handler = Mock()
    before = signal.signal(TERM, handler)
    try:
        with all_as_ctrl_c():
            signal.raise_signal(TERM)
        assert signal.getsignal(TERM) is handler and handler.call_count == 1
    finally:
        signal.signal(TERM, before)


def test_another_thread_sets_no_handlers() -> None:
    seen: list[object] = []

    def command() -> None:
        with all_as_ctrl_c():
            seen.append(signal.getsignal(TERM))

    thread = threading.Thread(target=command)
    thread.start()
    thread.join()
    assert seen == [signal.getsignal(TERM)]


@pytest.mark.long
@pytest.mark.parametrize("words", ["--help", "check op3"])
def test_any_command_whose_output_cannot_be_printed_is_one_line_and_whose_reader_has_left_is_quiet(words: str) -> None:
    command = [sys.executable, "-m", "retarget", *words.split()]
    if not Path("/dev/full").exists():
        pytest.skip("no /dev/full here")
    with Path("/dev/full").open("w") as full:
        result = subprocess.run(command, stdout=full, stderr=subprocess.PIPE, text=True)
    assert result.returncode == 2
    assert result.stderr.startswith("error: stdout: cannot print") and len(result.stderr.splitlines()) == 1
    reader, writer = os.pipe()
    os.close(reader)
    with os.fdopen(writer, "w") as pipe:
        result = subprocess.run(command, stdout=pipe, stderr=subprocess.PIPE, text=True)
    assert (result.returncode, result.stderr) == (0, "")


@settings(max_examples=60)
@given(st.floats(0.15, 1.0), st.floats(0.01, 0.12), st.floats(0.004, 0.02), st.floats(0.0, 1.0))
def test_held_it_is_not(delay: float, period: float, tick: float, phase: float) -> None:
    """For 4 s, looked at in every tick."""
    repeats = [phase, *(phase + delay + period * count for count in range(int(3.0 / period)))]
    key, seen = ForcedStopKey(), 0
    for look in range(int(5.0 / tick)):
        now = look * tick
        come = sum(time <= now for time in repeats)
        assert come == seen or key.pressed(come - seen, now) is not KeyPress.SECOND
        seen = come


@pytest.mark.parametrize("stall", [0.25, 1.0])
def test_held_and_read_late_it_is_not(stall: float) -> None:
    key = ForcedStopKey()
    key.pressed(1, 0.0)
    now = 0.5
    while now < 3.0:
        assert key.pressed(1, now) is not KeyPress.SECOND
        now += 0.033
    for count, later in ((int(stall / 0.033), 0.0), (0, 0.01), (1, 0.02)):
        assert key.pressed(count, now + stall + later) is not KeyPress.SECOND
