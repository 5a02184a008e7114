"""The doctor's findings, and those on this machine: cores, scheduler, serial ports, solver, firewall."""

import errno
import grp
import importlib
import os
import platform
import stat
from collections.abc import Iterable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from enum import StrEnum
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

import retarget
from hardware.clock import Clock, thread_cpu
from hardware.dynamixel import serial_port
from hardware.errors import HardwareError, printable
from hardware.processes import PROCESSES
from hardware.realtime import HOW_TO_PERMIT, USUAL_PRIORITY, Scheduling, refuse_scheduling
from retarget.errors import Problem
from retarget.live.receivers import RECEIVE_BUFFER
from retarget.schema import strict_yaml


class FindingLevel(StrEnum):
    """Level of a finding. Only FIX is a fault. NONE is not reported."""

    NONE = "none"
    OK = "ok"
    NOTE = "note"
    FIX = "fix"


@dataclass(frozen=True, slots=True)
class DoctorFinding:
    """The result of a check. subject: a word or two. what: the state. then: the next step, "" for none."""

    level: FindingLevel
    subject: str
    what: str
    then: str = ""

    def render(self) -> str:
        """One printable line, even if a sender's names are not printable."""
        step = self.then + "." if self.then and self.then[-1] not in ".?" else self.then
        line = f"{self.level:<4} {self.subject}: {self.what}" + (f". {step}" if step else "")
        return printable(line, one_line=True)


@cache
def checks() -> Mapping[str, Any]:
    """Read the table of checks, `doctor.yaml`."""
    return strict_yaml.load(Path(__file__).with_name("doctor.yaml")).data


def finding(check: str, *, subject: str = "", **facts: Any) -> DoctorFinding:
    """The finding of a check: the first row of `doctor.yaml` whose limits the facts are beyond."""
    entry: Mapping[str, Any] = checks()[check]
    row = next(
        row
        for row in entry.get("rows", ({},))
        if all(facts[fact] < facts.get(limit, limit) for fact, limit in row.get("under", {}).items())
        and all(facts[fact] > facts.get(limit, limit) for fact, limit in row.get("over", {}).items())
    )
    what, then = entry.get("what", "") + row.get("what", ""), row.get("then", entry.get("then", ""))
    level = FindingLevel(row.get("level", entry.get("level")))
    return DoctorFinding(level, subject or check.split("/")[0], what.format_map(facts), then.format_map(facts))


def findings(*names: str, **facts: Any) -> list[DoctorFinding]:
    """The findings of several checks, without those of level NONE."""
    found = [finding(name, **facts) for name in names]
    return [one for one in found if one.level is not FindingLevel.NONE]


def fix_all(subject: str, problems: Iterable[Problem]) -> list[DoctorFinding]:
    """A finding of level FIX for each problem."""
    return [DoctorFinding(FindingLevel.FIX, subject, problem.render()) for problem in problems]


ROOT = Path("/")
GOOD_GOVERNORS = {"performance", "schedutil"}
TICKS, TICK_S = 100, 0.01
"""Number and period, s, of the ticks of `lateness_finding`."""


def machine_findings(*, root: Path = ROOT) -> list[DoctorFinding]:
    """Findings on the operating system. root: folder of the kernel's files."""
    usable, there = len(os.sched_getaffinity(0)), os.cpu_count() or 1
    share, limited = float(usable), ""
    quota = _text(root / "sys/fs/cgroup/cpu.max").split()
    if len(quota) == 2 and quota[0].isdigit() and int(quota[1]) > 0:
        limit = int(quota[0]) / int(quota[1])
        share, limited = min(usable, int(limit)), f", limited to {limit:.1f} by a cgroup"
    load = float((_text(root / "proc/loadavg").split() or ["0"])[0])
    paths = (root / "sys/devices/system/cpu").glob("cpu[0-9]*/cpufreq/scaling_governor")
    governors = {_text(path) for path in paths} - {""}
    version = _text(root / "proc/version")
    kind = next((word for word in ("PREEMPT_RT", "PREEMPT_DYNAMIC", "PREEMPT") if word in version), "not preemptible")
    if _text(root / "sys/kernel/realtime") == "1":
        kind = "PREEMPT_RT"
    most = _text(root / "proc/sys/net/core/rmem_max")
    return [
        *findings("cores", usable=usable, there=there, quota=limited, share=share, load=load),
        *findings(
            "governor",
            governors=", ".join(sorted(governors)),
            set=len(governors),
            slow=len(governors - GOOD_GOVERNORS),
        ),
        *findings("scheduler", release=platform.release(), kind=kind),
        *findings("real time", priority=USUAL_PRIORITY, how=HOW_TO_PERMIT, permitted=_may_schedule()),
        *findings("UDP buffer", most=int(most) if most.isdigit() else -1, needed=RECEIVE_BUFFER),
    ]


def lateness_finding(clock: Clock) -> DoctorFinding:
    """Finding on the lateness of this process in a second of idle ticks at 100 Hz."""
    start, late = clock.now(), []
    for tick in range(1, TICKS + 1):
        clock.sleep_until(start + tick * TICK_S)
        late.append(clock.now() - start - tick * TICK_S)
    p50, p99 = 1e3 * np.percentile(late, (50, 99))
    return finding("ticks", p50=p50, p99=p99)


def _may_schedule() -> bool:
    try:
        refuse_scheduling(Scheduling(priority=USUAL_PRIORITY))
    except HardwareError:
        return False
    return True


def _text(path: Path) -> str:
    with suppress(OSError):
        return path.read_text(encoding="utf-8", errors="replace")[:4096].strip()
    return ""


# Serial ports, and the permission to open them.

GROUP = "dialout"
"""Group of serial ports that is assumed if no port is plugged in."""


def serial_findings(ports: Iterable[str] | None = None) -> list[DoctorFinding]:
    """Findings on the permission to open serial ports. ports: paths, None for all of this machine."""
    paths = [*(serial_port.existing_ports() if ports is None else ports)]
    if not paths:
        try:
            number = grp.getgrnam(GROUP).gr_gid
        except KeyError:
            number = -1
        member = number in {*os.getgroups(), os.getegid()}
        return [finding("serial/none", root=os.geteuid() == 0, known=number >= 0, member=member, group=GROUP)]
    refused = [path for path in paths if not os.access(path, os.R_OK | os.W_OK)]
    usable = [path for path in paths if path not in refused]
    groups = sorted({group for path in refused if (group := _group(path))})
    known = {"groups": ", ".join(groups) or "none", "group": groups[0] if groups else GROUP}
    found = [finding("serial/refused", ports=", ".join(refused), **known)] if refused else []
    return found + ([finding("serial", ports=", ".join(usable))] if usable else [])


def _group(path: str) -> str:
    """The group that may open a port, "" if there is none."""
    try:
        mode = Path(path).stat().st_mode
        return Path(path).group() if mode & stat.S_IRGRP and mode & stat.S_IWGRP else ""
    except (OSError, KeyError):
        return ""


# Python and the compiled solver.

FRAMES = 100
"""Frames whose median cost is taken."""


def python_findings() -> list[DoctorFinding]:
    """Findings on the version of Python, and on the import of the compiled solver."""
    implementation, machine = platform.python_implementation(), platform.machine()
    python = finding("Python", version=platform.python_version(), implementation=implementation, machine=machine)
    try:
        importlib.import_module("retarget._solver")
    except ImportError as error:
        return [python, finding("wheel/broken", error=error)]
    return [python, finding("wheel", version=retarget.__version__)]


def frame_findings() -> list[DoctorFinding]:
    """Finding on the CPU time of both stages per frame."""
    try:
        return [finding("solver", ms=1e3 * seconds_per_frame())]
    except ImportError:
        return []


def seconds_per_frame(frames: int = FRAMES) -> float:
    """Median CPU time, s, of a tick in which OP3 follows the sample recording."""
    from retarget.pipeline import Pipeline
    from retarget.sources.open import SAMPLE, open_source

    recording, pipeline = open_source(SAMPLE), Pipeline("op3")
    pipeline.start(recording.sample(recording.time[0]))
    costs = []
    for tick in range(1, frames + 1):
        sample = recording.sample(recording.time[0] + tick * pipeline.dt)
        before = thread_cpu()
        pipeline.step(sample, pipeline.dt)
        costs.append(thread_cpu() - before)
    return float(np.median(costs))


# A servo port. It is not opened, since that moves the lines of some adapters, and a byte might reach the servos.

SUBJECT = "port"
UNKNOWN_HOLDER = "another process"
"""Words of `serial_port.holders` for an unknown process."""


def port_findings(
    path: str, *, baud: int | None = None, devices: Path = serial_port.DEVICES, processes: Path = PROCESSES
) -> list[DoctorFinding]:
    """Findings on one servo port. baud: of the profile's bus, None if unknown."""
    refusal = _open_refusal(path, baud or 57_600)
    if refusal is not None:
        return [refusal]
    timer = serial_port.latency_timer_ms(path, devices)
    limits = {"timer": -1 if timer is None else timer, "needed": serial_port.LOW_TIMER_MS}
    found = [
        finding("servo port", subject=path, target=Path(path).resolve()),
        *_holders(path, processes),
        finding("servo port/timer", subject=path, command=serial_port.timer_command(path, devices), **limits),
    ]
    return found if baud is None else [*found, finding("servo port/baud", subject=path, baud=baud)]


def _open_refusal(path: str, baud: int) -> DoctorFinding | None:
    """The error that opening the port would raise, None if it would open."""
    try:
        there = Path(path).exists()
        is_device = there and Path(path).is_char_device()
    except (OSError, ValueError):
        there = is_device = False
    if not there:
        return DoctorFinding(FindingLevel.FIX, SUBJECT, str(serial_port.no_such_port(path)))
    if not is_device:
        cause = OSError(errno.ENOTTY, os.strerror(errno.ENOTTY))
    elif not os.access(path, os.R_OK | os.W_OK):
        cause = OSError(errno.EACCES, os.strerror(errno.EACCES))
    else:
        return None
    return DoctorFinding(FindingLevel.FIX, SUBJECT, str(serial_port.why_not_open(path, baud, cause)))


def _holders(path: str, processes: Path) -> list[DoctorFinding]:
    """Findings on processes that have the port open."""
    holder, _, behind = serial_port.holders(path, processes).partition("; ")
    found = [finding("servo port/behind", subject=path, behind=behind)] if behind else []
    if holder != UNKNOWN_HOLDER:
        return [finding("servo port/held", subject=path, holder=holder), *found]
    return [*found, finding("servo port/free", subject=path)]


# Firewalls, containers and virtual machines, which may block a sender.

_SIGNS = (
    ("etc/ufw/ufw.conf", "enabled=yes", "firewall/ufw"),
    ("run/firewalld", "", "firewall/firewalld"),
    ("proc/version", "microsoft", "firewall/WSL"),
    (".dockerenv", "", "firewall/container"),
    ("run/.containerenv", "", "firewall/container"),
)
"""Paths that every user may read, a text in their content ("" for any), and the check."""


def firewall_findings(port: int, *, root: Path = ROOT) -> list[DoctorFinding]:
    """Findings on firewalls that readable files reveal, with the command that opens the port."""
    shown = dict.fromkeys(
        check
        for path, text, check in _SIGNS
        if (text in _text(root / path).lower() if text else (root / path).exists())
    )
    names = [*(shown or ["firewall/none"]), "firewall/sender"]
    return [finding(name, port=port) for name in names]
