"""`retarget emulate`: the servos of a robot on pseudo-terminals. `retarget faults`: every fault in live runs."""

import os
import signal
import socket
import stat
import sys
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import ExitStack, suppress
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import typer
from rich.table import Table

from hardware.bus import BusSpec
from hardware.clock import Clock, MonotonicClock
from retarget.cli.application import console
from retarget.cli.buses import posture_ticks
from retarget.cli.exit import echo, stop_on_signals
from retarget.errors import UsageError, suggest
from retarget.model.robot import RobotBody, load_robot
from sim.emulator.conversation import Conduct
from sim.emulator.fault_state import Buses, FaultPlan, load_fault_plan, obey
from sim.emulator.faults import random_faults
from sim.emulator.line import REAL_TIME_GAP, Line, LineTiming
from sim.emulator.ports import Link, PseudoTerminal, serve
from sim.emulator.robot_lines import connect, robot_lines

if TYPE_CHECKING:
    from sim.faults.cases import Case
    from sim.faults.judge import Verdict

RANDOM_SPAN = 60.0
"""Time, s, over which the faults of a seed are spread."""


def emulate(
    robot: str,
    link: Path,
    faults: Path | None = None,
    seed: int | None = None,
    no_wire_delay: bool = False,
    power_off: bool = False,
    new: bool = False,
    *,
    conduct: Conduct,
    seconds: float | None = None,
) -> None:
    """Answer as a robot's servos would, on a serial port that any program can open, until Ctrl-C.

    Faults can be typed while it runs: 'missing 5', 'flip rate=0.01', 'clear', 'help'. 'connect l_knee' leaves the servo
    of that joint alone on the line, 'connect all' brings all back.

    Options:
        link PATH: Path of the port; with several buses PATH-NAME for each.
        faults FILE.yaml: Faults, and their times.
        seed N: Seed of all chance in the faults; without a file: of the faults too.
        no_wire_delay: Answer at once, whatever the baud rate.
        power_off: Begin with the servos' power off, where the robot has a switch for it.
        new: Servos as the maker delivers them, none connected, to set up one by one.
        gaps: Effect of a missing servo on those behind it in a group read.
        boot_time (--boot) SECONDS: Time of a servo's start.
        fed_by (--watchdog-fed-by): Packets that feed a bus watchdog: all, or only those to the servo and broadcasts.
        seconds (--for) SECONDS: End after so long.
    """
    if seconds is not None and not 0.0 < seconds < float("inf"):
        raise UsageError("no such duration", where="--for", found=f"{seconds:g}", allowed="above 0 s")
    if seed is not None and seed < 0:
        raise UsageError("a seed is not negative", where="--seed", found=seed, allowed="0 and above")
    if not 0.0 <= (boot := conduct.boot_time) < float("inf"):
        raise UsageError("no such start time of a servo", where="--boot", found=f"{boot:g}", allowed="0 s and above")
    body = load_robot(robot)
    buses = body.profile.bus_specs()
    links = {bus.name: Link(link if len(buses) == 1 else link.with_name(f"{link.name}-{bus.name}")) for bus in buses}
    for made in links.values():
        made.check()
    ids = {bus.name: bus.ids for bus in buses}
    plan = _plan(faults, seed, ids)
    clock = MonotonicClock()
    lines = robot_lines(
        body.joint_map.servos,
        buses,
        start=posture_ticks(body),
        now=clock.now(),
        plan=plan,
        seed=plan.seed,
        timing=replace(LineTiming.none() if no_wire_delay else LineTiming(), gap=REAL_TIME_GAP),
        conduct=conduct,
        powered=not power_off,
        as_delivered=new,
    )
    terminals = [PseudoTerminal(lines[bus.name], links[bus.name]) for bus in buses]
    _serve(body, buses, terminals, clock, ids, until=None if seconds is None else clock.now() + seconds)


def _plan(faults: Path | None, seed: int | None, ids: Buses) -> FaultPlan:
    if faults is not None:
        plan = load_fault_plan(faults, ids)
        return plan if seed is None else plan.model_copy(update={"seed": seed})
    if seed is None:
        return FaultPlan(faults=())
    every_id = sorted({device for some in ids.values() for device in some})
    return FaultPlan(faults=random_faults(seed, every_id, RANDOM_SPAN), seed=seed)


def _serve(
    body: RobotBody,
    buses: Sequence[BusSpec],
    terminals: Sequence[PseudoTerminal],
    clock: Clock,
    ids: Buses,
    *,
    until: float | None,
) -> None:
    states = {bus.name: terminal.line.faults for bus, terminal in zip(buses, terminals, strict=True)}
    lines = {bus.name: terminal.line for bus, terminal in zip(buses, terminals, strict=True)}

    def type_line(text: str) -> None:
        word, *joints = text.split() or [""]
        _answer(_connect(body, lines, joints) if word == "connect" else obey(text, states, ids, clock.now))

    typed = TypedLines(type_line)
    with ExitStack() as stack:
        stop = stack.enter_context(stop_on_signals())
        wake, poke = socket.socketpair()  # becomes readable by any signal with a handler
        stack.callback(wake.close)
        stack.callback(poke.close)
        poke.setblocking(False)
        stack.callback(signal.set_wakeup_fd, signal.set_wakeup_fd(poke.fileno(), warn_on_full_buffer=False))
        for bus, terminal in zip(buses, terminals, strict=True):
            stack.callback(terminal.close)
            terminal.open()
            echo(
                f"{body.profile.name}, bus {bus.name}: {len(terminal.line.connected)} devices answer on "
                f"{terminal.link.path} (protocol {bus.protocol}.0, {bus.baud} baud). Ctrl-C ends it."
            )
        listen: dict[int, Callable[[], bool]] = {wake.fileno(): lambda: bool(wake.recv(512))}
        keyboard = TypedLines.descriptor()
        if keyboard is not None:
            listen[keyboard] = typed.read
        serve(
            terminals, clock, until=stop, listen=listen, deadline=float("inf") if until is None else until, warn=_answer
        )


def _connect(body: RobotBody, lines: Mapping[str, Line], joints: Sequence[str]) -> str:
    """Connect the servos of these joints, or all, and no others. Returns the reply."""
    known = body.joint_map.joints
    unknown = [joint for joint in joints if joint not in known and joint != "all"]
    if unknown:
        return f"no such joint: {unknown[0]}. {suggest(unknown[0], known) or 'Joints: ' + ', '.join(known)}"
    connect(lines, body.joint_map.servos, known if "all" in joints else joints)
    return f"connected: {', '.join(joints) or 'no servo'}"


def _answer(text: str) -> None:
    """Answer a typed line on stderr. A lost terminal stops nothing."""
    if text:
        with suppress(OSError):
            echo(text, err=True)


MAX_LINE = 4096
"""Most bytes of a line; a longer one is cut."""


class TypedLines:
    """Passes lines of the standard input to `obey`. It reads only a pipe or a terminal in the foreground, because
    reading would stop a background process."""

    def __init__(self, obey: Callable[[str], None]) -> None:
        self._obey = obey
        self._pending = b""

    @staticmethod
    def descriptor() -> int | None:
        """The descriptor to wait on; None without input."""
        try:
            fd = sys.stdin.fileno()
            is_pipe = stat.S_ISFIFO(os.fstat(fd).st_mode)
            in_front = os.isatty(fd) and os.tcgetpgrp(fd) == os.getpgrp()
        except (AttributeError, OSError, ValueError):
            return None
        return fd if is_pipe or in_front else None

    def read(self) -> bool:
        """Take the present input. False at its end."""
        fd = self.descriptor()
        try:
            data = b"" if fd is None else os.read(fd, MAX_LINE)
        except OSError:
            return False
        *lines, rest = (self._pending + data).split(b"\n")
        self._pending = rest[:MAX_LINE]
        if not data and rest:
            lines, self._pending = [rest], b""
        for line in lines:
            self._obey(line.decode(errors="replace"))
        return bool(data)


# Every fault of the fault table, in live runs of OP3.

MOST_LINES = 5
"""Lines printed of one run."""


def faults(
    listed: bool = False,
    row: str | None = None,
    seeds: int = 0,
    first_seed: int = 0,
    seconds: float = 60.0,
    pairs: bool = False,
    rows: bool = True,
    jobs: int = 1,
) -> None:
    """Inject every fault of the table into a live run of OP3 on emulated servos: idle, approaching, moving, stopping.

    Pipeline, gate, guard and driver are the real ones, on virtual time; goals are judged from the bytes on the wire.
    Exit code 1 when anything was not as it has to be.

    Options:
        listed (--list): Only show the table.
        row NAME: Only this row.
        seeds N 0..: Also so many long runs with random faults.
        first_seed S 0..: First seed of the random runs.
        seconds S 1.0..: Virtual, of each random run.
        pairs: Every two rows together, too.
        rows: Every row alone.
        jobs N 1..256: Processes that share the work.
    """
    from sim.faults.cases import pair_cases, row_cases, seed_cases
    from sim.faults.rows import ROWS

    names = [one.name for one in ROWS]
    if row is not None and row not in names:
        raise UsageError(
            "no such row", where="--row", found=repr(row), allowed=", ".join(names), next_step=suggest(row, names)
        )
    if listed:
        table = Table(box=None, pad_edge=False)
        for heading in ("fault", "a robot that moves", "within", "a run that is to begin"):
            table.add_column(heading)
        for one in ROWS:
            if row in (None, one.name):
                table.add_row(one.name, one.reaction.value, f"{one.limit:g} s" if one.limit else "-", one.idle.value)
        console().print(table)
        return
    work: list[Case] = []
    if rows or row is not None:
        work += [case for case in row_cases() if row is None or case.name == row]
    work += pair_cases() if pairs else []
    work += seed_cases(range(first_seed, first_seed + seeds), seconds=seconds)
    raise typer.Exit(_run(work, jobs))


def _run(work: "list[Case]", jobs: int) -> int:
    from multiprocessing import get_context

    from sim.faults.cases import judged_case

    bad = 0
    with ExitStack() as stack:
        results: Iterable[Verdict] = map(judged_case, work)
        if jobs > 1:
            pool = get_context("spawn").Pool(min(jobs, len(work) or 1), maxtasksperchild=200)
            results = stack.enter_context(pool).imap(judged_case, work)
        for result in results:
            took = "" if result.took is None else f", after {result.took:.3f} s"
            echo(f"{'BAD' if result.wrong else 'ok '} {result.name}{took}")
            for line in result.wrong[:MOST_LINES]:
                echo(f"    {line}")
            bad += bool(result.wrong)
    echo(f"{bad} of {len(work)} bad" if bad else f"all {len(work)} as it has to be")
    return 1 if bad else 0
