"""A live run as real processes: `retarget run` on the pseudo-terminal of `retarget emulate`, a performer over UDP."""

import math
import os
import select
import signal
import socket
import subprocess
import sys
import threading
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path
from struct import unpack_from

import numpy as np
import pytest
from serial import Serial

import more_frames
from command_line import copy_of_op3
from hardware.clock import MonotonicClock
from hardware.dynamixel.codec import protocol2
from retarget.types import FloatArray
from sim.faults.sender import encoded

CLOCK = MonotonicClock()
PATIENCE_S = 60.0
RAISE_S = 1.2
"""How long the arms take up, and down; in the first half they go faster and faster."""
BLENDED_S = 1.5
"""After the robot begins to follow, until it follows in full."""
HZ = 100.0
BAUD = 2_000_000
AGAIN_S = 2e-3
MOVING, LATELY = 5.0, 120
"""Ticks per goal; packets."""
PRIORITY = 10
TRIES, ANSWERED_S, MOST_LOAD = 100, 2.2e-3, 2.5
"""The driver asks again after some 2.4 ms."""
WATCHDOG, VELOCITY, POSITION, TORQUE = (98, 1), (128, 4), (132, 4), (64, 1)
"""Address and size of registers of an XM430."""

SYNC_WRITE, GOALS = 0x83, bytes((116, 0, 4, 0))

STILL = {
    "head": (0.0, 0.0, 1.6),
    "l_wrist": (0.0, 0.25, 0.8),
    "r_wrist": (0.0, -0.25, 0.8),
    "l_ankle": (0.0, 0.1, 0.08),
    "r_ankle": (0.0, -0.1, 0.08),
}


class Performer(threading.Thread):
    """Stands, sways a little, and from `raise_at` on, s of the machine's clock, raises both arms in front, again and
    again. Sends until `done` is set."""

    def __init__(self, port: int) -> None:
        super().__init__(daemon=True)
        self.raise_at = math.inf
        self.done = threading.Event()
        self._port = port

    def run(self) -> None:
        _in_front()
        lifted_by = np.array([0.45, 0.0, 0.5])
        due, chance = CLOCK.now(), np.random.default_rng(5)
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as out:
            while not self.done.is_set():
                lifted = 0.5 - 0.5 * math.cos(math.pi * max((due - self.raise_at) / RAISE_S, 0.0))
                poses = {
                    name: np.array(at) + lifted * lifted_by * ("wrist" in name) + chance.normal(0.0, 2e-4, 3)
                    for name, at in STILL.items()
                }
                out.sendto(encoded(due, poses), ("127.0.0.1", self._port))
                due += 1.0 / HZ
                CLOCK.sleep_until(due)


@dataclass
class Live:
    """What runs, and what was said. log: of the emulator."""

    run: subprocess.Popen[bytes]
    emulator: subprocess.Popen[bytes]
    performer: Performer
    link: Path
    log: Path
    said: list[str] = field(default_factory=list)

    def wait_for(self, text: str) -> None:
        """Until the run says so."""
        assert self.run.stderr is not None
        end, heard = CLOCK.now() + PATIENCE_S, b""
        while text not in "\n".join(self.said):
            ready, _, _ = select.select([self.run.stderr], [], [], max(end - CLOCK.now(), 0.0))
            piece = os.read(self.run.stderr.fileno(), 4096) if ready else b""
            assert piece, f"it never says {text!r}: {self.said} {heard.decode()} {self._rest()}"
            heard += piece
            *lines, heard = heard.split(b"\n")
            self.said += [line.decode() for line in lines]

    def _rest(self) -> str:
        """What it said on stdout before it ended, or nothing."""
        return "" if self.run.poll() is None else self.run.communicate()[0].decode()

    def type(self, line: str) -> None:
        """To the emulator."""
        assert self.emulator.stdin is not None
        self.emulator.stdin.write(f"{line}\n".encode())
        self.emulator.stdin.flush()

    def raise_arms(self) -> None:
        """Let the performer begin, and wait until the robot is well on its way, faster and faster."""
        CLOCK.sleep_until(CLOCK.now() + BLENDED_S)
        self.performer.raise_at = CLOCK.now()
        while CLOCK.now() < self.performer.raise_at + PATIENCE_S:
            CLOCK.sleep_until(CLOCK.now() + 0.02)
            speed = np.abs(goal_speeds(self.sent()[-LATELY:])[1]).max(axis=1)
            if len(speed) > 20 and speed[-3:].min() > max(MOVING, 1.2 * speed[-20:-15].max()):
                return
        self.run.kill()
        raise AssertionError(f"the robot does not follow: {self.ended(PATIENCE_S)}")

    def ended(self, within: float) -> tuple[int, str]:
        """Its exit code and all that it said, in one line; it must have ended by then."""
        out, err = self.run.communicate(timeout=within)
        return self.run.returncode, " ".join([*self.said, *out.decode().split(), *err.decode().split()])

    def stick(self) -> None:
        """From now on the pipes of stdout and stderr are full and not read."""
        for stream in (self.run.stdout, self.run.stderr):
            assert stream is not None
            fill = os.open(f"/proc/self/fd/{stream.fileno()}", os.O_WRONLY | os.O_NONBLOCK)
            for size in (4096, 1):
                with suppress(BlockingIOError):
                    while True:
                        os.write(fill, b"x" * size)
            os.close(fill)

    def _wire(self, kind: str) -> list[list[str]]:
        """What follows the kind of a complete line of the emulator's log."""
        rows = [line.split() for line in self.log.read_text(encoding="ascii").splitlines()]
        return [row[1:] for row in rows if row[0] == kind]

    def sent(self) -> list[tuple[float, bytes]]:
        """What the run has put on the wire, and when, s."""
        return [(float(row[0]), bytes.fromhex(row[1])) for row in self._wire("heard") if len(row) == 2]

    def tripped(self) -> list[float]:
        """When bus watchdogs stopped servos, s."""
        return [float(row[0]) for row in self._wire("tripped")]

    def registers(self, where: tuple[int, int]) -> list[int]:
        """Values of a register of servos 1 to 20, read one by one; no other process may have the port."""
        address, size = where
        found = []
        with Serial(str(self.link), BAUD, timeout=2.0) as port:
            for device in range(1, 21):
                port.write(more_frames.read(device, address, size))
                answer = port.read(11 + size)
                assert len(answer) == 11 + size, f"servo {device} says {answer.hex()}"
                found.append(unpack_from("<i", answer[9 : 9 + size].ljust(4, b"\0"))[0])
        return found


def goal_speeds(sent: Sequence[tuple[float, bytes]]) -> tuple[FloatArray, FloatArray]:
    """Times (T,) s of goals and the speeds (T, n) that they ask of the servos, ticks per goal. A goal that is sent
    again at once, as on a noisy line, is one goal."""
    writes: list[tuple[float, dict[int, int]]] = []
    parser = protocol2.parser()
    for time, frame in ((time, frame) for time, data in sent for frame in parser.feed(data)):
        if frame.code == SYNC_WRITE and frame.params[:4] == GOALS and len(frame.params) > 54:
            items = range(4, len(frame.params) - 4, 5)
            goals = {frame.params[k]: unpack_from("<i", frame.params, k + 1)[0] for k in items}
            if not (writes and goals == writes[-1][1] and time - writes[-1][0] < AGAIN_S):
                writes.append((time, goals))
    ids = sorted(set.intersection(*[set(goals) for _, goals in writes]))
    ticks = np.array([[goals[device] for device in ids] for _, goals in writes], dtype=np.float64)
    return np.array([time for time, _ in writes][1:]), np.diff(ticks, axis=0)


def free_port() -> int:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


def _in_front() -> None:
    """Before other work of the machine, where this user may: what is timed here is real."""
    with suppress(OSError):
        os.sched_setscheduler(0, os.SCHED_RR, os.sched_param(PRIORITY))


def _signals_received() -> None:
    """A shell's background job ignores Ctrl-C, and so would its children."""
    _in_front()
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGQUIT, signal.SIGTSTP):
        signal.signal(number, signal.SIG_DFL)


def _skip_if_busy(link: Path) -> None:
    """Pseudo-terminals pass bytes on by a worker of the kernel; where that is late, no line of servos can be played."""
    took = []
    with Serial(str(link), BAUD, timeout=2.0) as port:
        _in_front()
        for _ in range(TRIES):
            begun = CLOCK.now()
            port.write(protocol2.sync_read(*POSITION, range(1, 21), fast=True))
            port.read(8)
            took.append(CLOCK.now() - begun)
            CLOCK.sleep_until(begun + 0.005)
            port.reset_input_buffer()
        os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))
    late, load = float(np.percentile(took, 90)), os.getloadavg()[0] / (os.cpu_count() or 1)
    if late > ANSWERED_S or load > MOST_LOAD:
        pytest.skip(f"too busy: servos answer after {1e3 * late:.1f} ms, {load:.1f} processes for a core")


@contextmanager
def live_run(folder: Path) -> Iterator[Live]:
    """A robot that follows a performer who stands; all processes end with it."""
    link, log, port = folder / "op3", folder / "wire.txt", free_port()
    tap = Path(__file__).with_name("emulated.py")
    emulate = [sys.executable, str(tap), str(log), "--robot", "op3", "--link", str(link)]
    emulator = subprocess.Popen(
        emulate, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, preexec_fn=_in_front
    )
    performer = Performer(port)
    assert emulator.stdout is not None
    running: subprocess.Popen[bytes] | None = None
    try:
        assert select.select([emulator.stdout], [], [], PATIENCE_S)[0], "the emulator says nothing"
        _skip_if_busy(link)
        performer.start()
        # Emulated servos carry no weight, which looks like contact.
        robot = copy_of_op3(folder / "weightless", ("safety:\n", "safety:\n  holds_when_pressed: false\n"))
        words = ["--robot", str(robot), "--source", f"json://127.0.0.1:{port}", "--bus", str(link)]
        running = subprocess.Popen(
            [sys.executable, "-m", "retarget", "run", *words, "--yes", "--countdown", "0.2"],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            preexec_fn=_signals_received,
        )
        live = Live(running, emulator, performer, link, log)
        live.wait_for("the performer is followed")
        yield live
    finally:
        performer.done.set()
        for process in (running, emulator):
            if process is not None:
                process.kill()
                process.communicate()
