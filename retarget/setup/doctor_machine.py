"""The doctor's findings, and those on this machine: cores, scheduler, clock, disk, serial ports, solver, firewall."""

import errno
import grp
import importlib
import os
import platform
import shutil
import stat
import sys
from collections.abc import Callable, Iterable
from contextlib import suppress
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path
from typing import Literal

import numpy as np
from serial.tools.list_ports import comports

import retarget
from hardware.clock import Clock, thread_cpu
from hardware.dynamixel import serial_port
from hardware.errors import HardwareError
from hardware.realtime import HOW_TO_PERMIT, PROCESSES, USUAL_PRIORITY, Scheduling, refuse_scheduling
from retarget.errors import Problem
from retarget.live.udp import RECEIVE_BUFFER

# Findings: one thing that was checked, its level, and a line of text for it.


class Level(StrEnum):
    """Level of a finding. Only FIX counts as wrong."""

    OK = "ok"
    NOTE = "note"
    FIX = "fix"


@dataclass(frozen=True, slots=True)
class Finding:
    """subject: what was checked, a word or two. what: how it is. then: what to do, "" for nothing."""

    level: Level
    subject: str
    what: str
    then: str = ""

    def render(self) -> str:
        """One line, printable whatever a sender's names are made of."""
        step = self.then + "." if self.then and self.then[-1] not in ".?" else self.then
        line = f"{self.level:<4} {self.subject}: {self.what}" + (f". {step}" if step else "")
        return "".join(letter if letter.isprintable() else "?" for letter in line)


def ok(subject: str, what: str) -> Finding:
    """A finding with nothing to do."""
    return Finding(Level.OK, subject, what)


def note(subject: str, what: str, then: str = "") -> Finding:
    """A finding that is worth knowing; a run may go well all the same."""
    return Finding(Level.NOTE, subject, what, then)


def fix(subject: str, what: str, then: str) -> Finding:
    """A finding that is wrong, and what to do."""
    return Finding(Level.FIX, subject, what, then)


def fix_all(subject: str, problems: Iterable[Problem]) -> list[Finding]:
    """Each problem of a refusal as a finding that is wrong."""
    return [Finding(Level.FIX, subject, problem.render()) for problem in problems]


ROOT = Path("/")
GOOD_CLOCKS = ("tsc", "arch_sys_counter", "kvm-clock", "hyperv_clocksource_tsc_page", "hyperv_clocksource")
USUAL_BUFFER = 212_992
"""Bytes of rmem_max that Linux has from the start: a quarter of a second of SlimeVR's VMC, with the kernel's share."""
PER_HOUR = 2.3e9
"""Bytes of an hour of SlimeVR's VMC (2.6 kB, 232 a second, and the header of each)."""
TICKS, TICK_S = 100, 0.01
LATE_S = 0.003


def machine_findings(folder: Path, *, root: Path = ROOT) -> list[Finding]:
    """Findings on the operating system. folder: where recordings would go. root: of the kernel's files."""
    return [
        _cores(root),
        *_governor(root),
        _scheduler(root),
        _realtime(),
        _clock_source(root),
        _receive_buffer(root),
        _disk(folder),
    ]


def lateness_finding(clock: Clock) -> Finding:
    """How late this process wakes up, in a second of idle ticks at 100 Hz."""
    start, late = clock.now(), []
    for tick in range(1, TICKS + 1):
        clock.sleep_until(start + tick * TICK_S)
        late.append(clock.now() - start - tick * TICK_S)
    p50, p99 = np.percentile(late, (50, 99))
    what = f"wakes up {1e3 * p50:.2f} ms late (p99 {1e3 * p99:.2f} ms) at 100 Hz"
    if p99 > LATE_S:
        step = "End other programs, set the governor to performance, use --realtime and --core"
        return fix("ticks", what, step)
    return ok("ticks", what)


def _cores(root: Path) -> Finding:
    usable, there = len(os.sched_getaffinity(0)), os.cpu_count() or 1
    what = f"{usable} of {there}"
    quota = _text(root / "sys/fs/cgroup/cpu.max").split()
    if len(quota) == 2 and quota[0].isdigit() and int(quota[1]) > 0:
        what += f", limited to {int(quota[0]) / int(quota[1]):.1f} by a cgroup"
        usable = min(usable, int(int(quota[0]) / int(quota[1])))
    load = float((_text(root / "proc/loadavg").split() or ["0"])[0])
    what += f"; load {load:.1f}"
    if usable < 2:
        return fix("cores", what, "Give it two cores: one for the run, one for everything else")
    if load > usable:
        return note("cores", what, "The load exceeds the cores: end other programs")
    return ok("cores", what)


def _governor(root: Path) -> list[Finding]:
    paths = (root / "sys/devices/system/cpu").glob("cpu[0-9]*/cpufreq/scaling_governor")
    names = sorted({_text(path) for path in paths} - {""})
    if not names:
        return [ok("governor", "none: this system does not let the clock of the cores be set")]
    what = ", ".join(names)
    if set(names) <= {"performance", "schedutil"}:
        return [ok("governor", what)]
    return [note("governor", f"{what}: cores slow down between ticks", "sudo cpupower frequency-set -g performance")]


def _scheduler(root: Path) -> Finding:
    version = _text(root / "proc/version")
    kind = next((word for word in ("PREEMPT_RT", "PREEMPT_DYNAMIC", "PREEMPT") if word in version), "not preemptible")
    if _text(root / "sys/kernel/realtime") == "1":
        kind = "PREEMPT_RT"
    return ok("scheduler", f"Linux {platform.release()}, {kind}")


def _realtime() -> Finding:
    try:
        refuse_scheduling(Scheduling(priority=USUAL_PRIORITY))
    except HardwareError:
        return note("real time", f"priority {USUAL_PRIORITY} not permitted", f"For --realtime: {HOW_TO_PERMIT}")
    return ok("real time", f"priority {USUAL_PRIORITY} permitted (--realtime)")


def _clock_source(root: Path) -> Finding:
    name = _text(root / "sys/devices/system/clocksource/clocksource0/current_clocksource")
    if not name or name in GOOD_CLOCKS:
        return ok("clock", f"source {name or 'unknown'}")
    return note("clock", f"source {name}, slow to read or coarse", "See in dmesg why tsc was given up")


def _receive_buffer(root: Path) -> Finding:
    text = _text(root / "proc/sys/net/core/rmem_max")
    if not text.isdigit():
        return ok("UDP buffer", "limit unknown")
    most, step = int(text), f"sudo sysctl -w net.core.rmem_max={RECEIVE_BUFFER}"
    what = f"net.core.rmem_max {most} bytes"
    if most < USUAL_BUFFER:
        return fix("UDP buffer", f"{what}: bursts are lost", step)
    if most < RECEIVE_BUFFER:
        return note("UDP buffer", f"{what}, and {RECEIVE_BUFFER} are asked for", f"To have them: {step}")
    return ok("UDP buffer", what)


def _disk(folder: Path) -> Finding:
    try:
        free = shutil.disk_usage(folder).free
    except OSError as error:
        return note("disk", f"{folder}: {error.strerror or error}", "Record to another folder")
    hours = free / PER_HOUR
    what = f"{free / 1e9:.0f} GB free here, {hours:.0f} h of --record-raw of SlimeVR's VMC"
    return ok("disk", what) if hours > 1.0 else fix("disk", what, "Make room, or record to another disk")


def _text(path: Path) -> str:
    with suppress(OSError):
        return path.read_text(encoding="utf-8", errors="replace")[:4096].strip()
    return ""


# Serial ports: whether this user may open them; their group is mostly dialout.

GROUP = "dialout"
"""Group of serial ports, assumed where no port is plugged in."""


def serial_findings(ports: Iterable[str] | None = None) -> list[Finding]:
    """Whether this user may open serial ports. ports: paths; None: all of this machine."""
    paths = sorted(port.device for port in comports()) if ports is None else list(ports)
    refused = [path for path in paths if not os.access(path, os.R_OK | os.W_OK)]
    found = []
    if refused:
        groups = sorted({group for path in refused if (group := _group(path))})
        what = f"{', '.join(refused)} not for this user (group {', '.join(groups) or 'none'})"
        step = f'Run "sudo usermod -aG {groups[0] if groups else GROUP} $USER", then log out and in again'
        found.append(fix("serial", what, step))
    usable = [path for path in paths if path not in refused]
    if usable:
        found.append(ok("serial", f"{', '.join(usable)} for this user"))
    if not paths:
        found.append(_no_port())
    return found


def _group(path: str) -> str:
    """The group that may open a port; "" where its mode gives groups no right, or its name is not known."""
    try:
        mode = Path(path).stat().st_mode
        return Path(path).group() if mode & stat.S_IRGRP and mode & stat.S_IWGRP else ""
    except (OSError, KeyError):
        return ""


def _no_port() -> Finding:
    """Without a port to check: whether this user is in the group."""
    if os.geteuid() == 0:
        return ok("serial", "no serial port here; root may open any")
    try:
        number = grp.getgrnam(GROUP).gr_gid
    except KeyError:
        return ok("serial", "no serial port here")
    if number in {*os.getgroups(), os.getegid()}:
        return ok("serial", f"no serial port here; this user is in {GROUP}")
    step = f'For servos: "sudo usermod -aG {GROUP} $USER", then log out and in again'
    return note("serial", f"no serial port here, and this user is not in {GROUP}", step)


# Python and the compiled solver: whether they can be used, and what a frame costs on this machine.

OLDEST = (3, 11)
FRAMES = 100
SLOW_S, TOO_SLOW_S = 0.003, 0.008
"""CPU time of both stages for a frame from which on a tick of 10 ms is tight, and too short."""
AMPLITUDE_M = 0.05


def python_findings(version: tuple[int, ...] = sys.version_info[:3]) -> list[Finding]:
    """Version of Python, and whether the compiled solver can be imported."""
    what = f"{'.'.join(map(str, version))} ({platform.python_implementation()}, {platform.machine()})"
    found = []
    if version < OLDEST:
        found.append(fix("Python", what, "Install Python 3.11 or newer, and retarget into it"))
    else:
        found.append(ok("Python", what))
    try:
        importlib.import_module("retarget._solver")
    except ImportError as error:
        step = "Install the wheel for this machine, or build it: make install (needs cargo)"
        return [*found, fix("wheel", f"the compiled solver cannot be imported ({error})", step)]
    return [*found, ok("wheel", f"retarget {retarget.__version__}, compiled solver there")]


def frame_findings(measure: "Callable[[], float] | None" = None) -> list[Finding]:
    """What a frame costs. measure: returns s; None: `seconds_per_frame`."""
    try:
        cost = (measure or seconds_per_frame)()
    except ImportError:
        return []
    what = f"{1e3 * cost:.2f} ms of CPU per frame, performer to OP3"
    if cost > TOO_SLOW_S:
        return [
            fix("solver", f"{what}, of a tick of 10 ms", "Use a faster computer, or a lower rate_hz in the profile")
        ]
    if cost > SLOW_S:
        return [note("solver", what, "Little room is left in a tick of 10 ms: end other programs")]
    return [ok("solver", what)]


def seconds_per_frame(frames: int = FRAMES) -> float:
    """Median CPU time, s, of both stages for a performer who waves while OP3 follows. Takes about a second."""
    from retarget.frames import SensorSample
    from retarget.human.reconstruction import Reconstructor
    from retarget.model.human import build_human
    from retarget.model.human_dimensions import proportional_dimensions
    from retarget.model.robot import load_robot
    from retarget.robot.follower import Follower
    from retarget.schema.performer import load_performer
    from retarget.schema.priorities import load_priorities

    size = proportional_dimensions(1.75)
    human, performer = build_human(size), load_performer("five")
    names = tuple(performer.sensors)
    kinematics, q = human.body.solver_body(), human.posture("attractor")
    joints = [human.body.frame(name) for name in names]
    rest = kinematics.points(q[None], [one.body for one in joints], np.array([one.position for one in joints]))[0]
    wrists = [names.index("l_wrist"), names.index("r_wrist")]
    blank, valid = np.full((len(names), 4), np.nan), np.ones(len(names), dtype=bool)

    def sample(tick: int) -> SensorSample:
        place = np.array(rest)
        place[wrists, 2] += AMPLITUDE_M * np.sin(0.05 * tick)
        return SensorSample(names, place, blank, valid)

    reconstructor = Reconstructor(human, load_priorities("human"), performer)
    robot = load_robot("op3")
    follower = Follower(robot, load_priorities(robot.profile.retarget), size)
    follower.start(reconstructor.start(sample(0)))
    costs = []
    for tick in range(1, frames + 1):
        before = thread_cpu()
        follower.step(reconstructor.step(sample(tick), 0.01), 0.01)
        costs.append(thread_cpu() - before)
    return float(np.median(costs))


# A servo port: whether it exists, may be opened and is free, and the latency timer of its adapter.
#
# The port is not opened: that moves the lines of some adapters, and a byte might reach the servos.

SUBJECT = "port"
UNKNOWN_HOLDER = "another process"
"""Holder of a port where no process can be seen."""


def port_findings(
    path: str, *, baud: int | None = None, devices: Path = serial_port.DEVICES, processes: Path = PROCESSES
) -> list[Finding]:
    """Findings on one servo port. baud: of the profile's bus, None: not known."""
    refusal = _open_refusal(path, baud or 57_600)
    if refusal is not None:
        return [refusal]
    target = Path(path).resolve()
    found = [ok(path, f"there ({target}), and this user may open it")]
    found += _holders(path, processes)
    timer = serial_port.latency_timer_ms(path, devices)
    if timer is None:
        found.append(ok(path, "no latency timer (the adapter is no FTDI)"))
    elif timer > serial_port.WANTED_MS:
        what = f"the adapter keeps bytes for up to {timer} ms, and {serial_port.WANTED_MS} ms is needed"
        step = f"Type: {serial_port.timer_command(path, devices)}"
        found.append(fix(path, what, step + " (docs/wiring.md has a rule that makes it stay)"))
    else:
        found.append(ok(path, f"latency timer {timer} ms"))
    if baud is not None:
        found.append(ok(path, f"{baud} baud in the profile; retarget servo scan lists the servos that answer"))
    return found


def _open_refusal(path: str, baud: int) -> Finding | None:
    """Why opening the port would fail, in the same words; None: it would not."""
    try:
        there = Path(path).exists()
        is_device = there and Path(path).is_char_device()
    except (OSError, ValueError):
        there = is_device = False
    if not there:
        return Finding(Level.FIX, SUBJECT, str(serial_port.no_such_port(path)))
    if not is_device:
        cause = OSError(errno.ENOTTY, os.strerror(errno.ENOTTY))
    elif not os.access(path, os.R_OK | os.W_OK):
        cause = OSError(errno.EACCES, os.strerror(errno.EACCES))
    else:
        return None
    return Finding(Level.FIX, SUBJECT, str(serial_port.why_not_open(path, baud, cause)))


def _holders(path: str, processes: Path) -> list[Finding]:
    """Processes that have the port open; one at the other end of a pseudo-terminal is a note only."""
    holder, _, behind = serial_port.holders(path, processes).partition("; ")
    found = [note(path, behind)] if behind else []
    if holder != UNKNOWN_HOLDER:
        return [fix(path, f"in use by {holder}", "Stop it, or wait"), *found]
    return [*found, ok(path, "no process that can be seen has it open")]


# What may block a sender from a port of this machine: a firewall, a container, a virtual machine.

FIREWALL = "firewall"


def firewall_findings(port: int, *, protocol: Literal["udp", "tcp"] = "udp", root: Path = ROOT) -> list[Finding]:
    """Firewalls that files readable by every user show, and the command that opens the port."""
    found = []
    if "ENABLED=yes" in _config_text(root / "etc/ufw/ufw.conf"):
        found.append(note(FIREWALL, "ufw is on", f"Open the port: sudo ufw allow {port}/{protocol}"))
    if (root / "run/firewalld").is_dir():
        step = f"Open the port: sudo firewall-cmd --add-port={port}/{protocol}"
        found.append(note(FIREWALL, "firewalld runs", step))
    if "microsoft" in _config_text(root / "proc/version").lower():
        step = "Set networkingMode=mirrored in .wslconfig, and open the port in Windows Defender Firewall"
        found.append(note(FIREWALL, "this is WSL, which the network does not reach by itself", step))
    if (root / ".dockerenv").exists() or (root / "run/.containerenv").exists():
        step = f"Start it with --network host, or with -p {port}:{port}/{protocol}"
        found.append(note(FIREWALL, "this is a container, which the network does not reach by itself", step))
    if not found:
        step = f"sudo nft list ruleset shows what lets {protocol.upper()} port {port} in"
        found.append(note(FIREWALL, "no ufw and no firewalld here; other rules can only be seen by root", step))
    sender = "On a sender with Windows, allow its program in Windows Defender Firewall, for private and public networks"
    found.append(note(FIREWALL, "the sender's computer has one too", sender))
    return found


def _config_text(path: Path) -> str:
    with suppress(OSError):
        return path.read_text(encoding="utf-8", errors="replace")[:4096]
    return ""
