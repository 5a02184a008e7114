"""Whoever writes to a terminal that takes nothing neither waits nor fails, and memory is bounded."""

import errno
import io
import json
import os
import socket
import subprocess
import sys
import threading
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

import pytest
import typer

from hardware.clock import MonotonicClock, VirtualClock
from live_processes import PATIENCE_S, Performer, _free_port
from retarget.cli import detached
from retarget.cli.boundary import STOPPED
from retarget.cli.detached import MOST, Detached, detached_screens
from retarget.cli.progress import progress_bar
from retarget.cli.screen import careful_stdout
from support.messages import refuses

CLOCK = MonotonicClock()


class Full(io.StringIO):
    """A device that is full."""

    def write(self, text: str) -> int:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))


@pytest.fixture
def full_pipe() -> Iterator[tuple[int, int]]:
    """Both ends of a pipe that takes no more, and that nobody reads."""
    reading, writing = os.pipe()
    os.set_blocking(writing, False)
    with suppress(BlockingIOError):
        while True:
            os.write(writing, bytes(4096))
    os.set_blocking(writing, True)
    yield reading, writing
    os.close(reading)
    os.close(writing)


def test_what_is_written_arrives_in_order(capsys: pytest.CaptureFixture[str]) -> None:
    before = sys.stdout, sys.stderr
    with detached_screens():
        for line in range(300):
            sys.stderr.write(f"{line}\n")
        sys.stdout.write("done\n")
    assert (sys.stdout, sys.stderr) == before
    out, err = capsys.readouterr()
    assert out == "done\n" and err.split() == [str(line) for line in range(300)]


@pytest.mark.parametrize("barred", [False, True])
def test_nothing_goes_past_the_thread(barred: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """What is told, also above a progress bar, which has a stream of its own in front of stderr."""
    wrote: list[str] = []

    def write(self: Detached, text: str) -> int:
        if not isinstance(text, str):
            raise TypeError
        wrote.append(text)
        return len(text)

    with (tmp_path / "stderr").open("w", encoding="utf-8") as stream:
        monkeypatch.setattr(sys, "stderr", stream)
        monkeypatch.setattr(Detached, "write", write)
        monkeypatch.setattr(Detached, "isatty", lambda self: barred, raising=False)
        monkeypatch.setenv("TERM", "xterm")
        with detached_screens(), progress_bar("op3", 100) as show:
            show(50)
            typer.echo("held", err=True)
    assert "held" in "".join(wrote) and ("op3" in "".join(wrote)) == barred
    assert (tmp_path / "stderr").read_text(encoding="utf-8") == ""


def test_a_pipe_that_nobody_reads_holds_nobody_up(full_pipe: tuple[int, int]) -> None:
    reading, writing = full_pipe
    begun = CLOCK.now()
    with os.fdopen(writing, "w", closefd=False) as stream:
        screen = Detached(stream)
        screen.write("first")
        while screen._waiting:  # the thread takes it, and hangs
            CLOCK.sleep_until(CLOCK.now() + 1e-3)
        for _ in range(3 * MOST):
            screen.write("text")
        assert screen.lost == 2 * MOST and CLOCK.now() - begun < 1.0
        screen._thread.join(0.05)
        assert screen._thread.is_alive()
        size = 0
        os.set_blocking(reading, False)
        screen._ended = True
        while screen._thread.is_alive() and CLOCK.now() - begun < PATIENCE_S:
            with suppress(BlockingIOError):
                size += os.read(reading, 1 << 20).count(b"text")
        with suppress(BlockingIOError):
            size += os.read(reading, 1 << 20).count(b"text")
    assert size == MOST  # somebody reads again: the latest are there


def test_the_end_waits_for_both_at_once(full_pipe: tuple[int, int], monkeypatch: pytest.MonkeyPatch) -> None:
    clock, waited = VirtualClock(), list[float]()

    def join(self: threading.Thread, timeout: float) -> None:
        waited.append(timeout)
        clock.advance(timeout)

    with os.fdopen(full_pipe[1], "w", closefd=False) as stuck, monkeypatch.context() as patch:
        patch.setattr(detached, "MonotonicClock", lambda: clock)
        patch.setattr(threading.Thread, "join", join)
        patch.setattr(sys, "stdout", stuck)
        patch.setattr(sys, "stderr", stuck)
        with detached_screens():
            sys.stdout.write("text")
            sys.stderr.write("text")
    assert sum(waited) == pytest.approx(detached.PATIENCE_S) and len(waited) == 2
    os.read(full_pipe[0], 1 << 20)
    for thread in threading.enumerate():
        if thread.name == "screen":
            thread.join(PATIENCE_S)


def test_a_reader_that_has_left_is_counted(capsys: pytest.CaptureFixture[str]) -> None:
    reading, writing = os.pipe()
    os.close(reading)
    with os.fdopen(writing, "w") as stream:
        screen = Detached(stream)
        screen.write("text")
        screen.close()
        screen.close()
        assert screen.lost == 1 and isinstance(screen.failure, BrokenPipeError)


def test_a_full_device_is_told_of(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "stdout", Full())
    with careful_stdout() as screen:
        with detached_screens():
            sys.stdout.write("text")
        assert screen is not None and screen.reason == os.strerror(errno.ENOSPC)


def test_it_is_a_text_stream() -> None:
    screen = Detached(io.StringIO())
    with refuses(TypeError):
        screen.write(b"text")  # type: ignore[arg-type]
    assert not screen.isatty() and screen.encoding == "utf-8"
    screen.close()


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
    port, control, report = _free_port(), tmp_path / "control", tmp_path / "report.json"
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
        assert json.loads(report.read_text())["stop"]["state"] == "stopped"
    finally:
        performer.done.set()
        run.kill()
        run.wait()
