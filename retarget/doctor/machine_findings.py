"""The machine: cores, governor, scheduler, rights, clock, buffers, disk, serial ports. Read from the kernel's files."""

import os
import platform
import shutil
from contextlib import suppress
from pathlib import Path

import numpy as np

from hardware.clock import Clock
from hardware.errors import HardwareError
from hardware.realtime import HOW_TO_PERMIT, USUAL_PRIORITY, Scheduling, refuse_scheduling
from retarget.doctor.finding import Finding, mend, note, ok
from retarget.live.udp_socket import RECEIVE_BUFFER

__all__ = ["lateness_finding", "machine_findings"]

ROOT = Path("/")
GOOD_CLOCKS = ("tsc", "arch_sys_counter", "kvm-clock", "hyperv_clocksource_tsc_page", "hyperv_clocksource")
USUAL_BUFFER = 212_992
"""Bytes of rmem_max that Linux has from the start: a quarter of a second of SlimeVR's VMC, with the kernel's share."""
PER_HOUR = 2.3e9
"""Bytes of an hour of SlimeVR's VMC (2.6 kB, 232 a second, and the header of each)."""
TICKS, TICK_S = 100, 0.01
LATE_S = 0.003


def machine_findings(folder: Path, *, root: Path = ROOT) -> list[Finding]:
    """folder: where recordings would go. root: of the kernel's files."""
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
    """How late this process wakes up, for a second of ticks of 100 Hz in which it does nothing."""
    start, late = clock.now(), []
    for tick in range(1, TICKS + 1):
        clock.sleep_until(start + tick * TICK_S)
        late.append(clock.now() - start - tick * TICK_S)
    p50, p99 = np.percentile(late, (50, 99))
    told = f"wakes up {1e3 * p50:.2f} ms late (p99 {1e3 * p99:.2f} ms) at 100 Hz"
    if p99 > LATE_S:
        step = "End what else runs, set the governor to performance, use --realtime and --core"
        return mend("ticks", told, step)
    return ok("ticks", told)


def _cores(root: Path) -> Finding:
    usable, there = len(os.sched_getaffinity(0)), os.cpu_count() or 1
    told = f"{usable} of {there}"
    quota = _text(root / "sys/fs/cgroup/cpu.max").split()
    if len(quota) == 2 and quota[0].isdigit() and int(quota[1]) > 0:
        told += f", limited to {int(quota[0]) / int(quota[1]):.1f} by a cgroup"
        usable = min(usable, int(int(quota[0]) / int(quota[1])))
    load = float((_text(root / "proc/loadavg").split() or ["0"])[0])
    told += f"; load {load:.1f}"
    if usable < 2:
        return mend("cores", told, "Give it a core of its own beside one for everything else")
    if load > usable:
        return note("cores", told, "More wants to run than there are cores: end what else runs")
    return ok("cores", told)


def _governor(root: Path) -> list[Finding]:
    paths = (root / "sys/devices/system/cpu").glob("cpu[0-9]*/cpufreq/scaling_governor")
    names = sorted({_text(path) for path in paths} - {""})
    if not names:
        return [ok("governor", "none: the clock of the cores is not ours to set")]
    told = ", ".join(names)
    if set(names) <= {"performance", "schedutil"}:
        return [ok("governor", told)]
    return [note("governor", f"{told}: cores slow down between ticks", "sudo cpupower frequency-set -g performance")]


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
        return ok("clock", f"source {name or 'not told'}")
    return note("clock", f"source {name}, slow to read or coarse", "See in dmesg why tsc was given up")


def _receive_buffer(root: Path) -> Finding:
    text = _text(root / "proc/sys/net/core/rmem_max")
    if not text.isdigit():
        return ok("UDP buffer", "limit not told")
    most, step = int(text), f"sudo sysctl -w net.core.rmem_max={RECEIVE_BUFFER}"
    told = f"net.core.rmem_max {most} bytes"
    if most < USUAL_BUFFER:
        return mend("UDP buffer", f"{told}: bursts are lost", step)
    if most < RECEIVE_BUFFER:
        return note("UDP buffer", f"{told}, and {RECEIVE_BUFFER} are asked for", f"To have them: {step}")
    return ok("UDP buffer", told)


def _disk(folder: Path) -> Finding:
    try:
        free = shutil.disk_usage(folder).free
    except OSError as error:
        return note("disk", f"{folder}: {error.strerror or error}", "Record to another folder")
    hours = free / PER_HOUR
    told = f"{free / 1e9:.0f} GB free here, {hours:.0f} h of --record-raw of SlimeVR's VMC"
    return ok("disk", told) if hours > 1.0 else mend("disk", told, "Make room, or record to another disk")


def _text(path: Path) -> str:
    with suppress(OSError):
        return path.read_text(encoding="utf-8", errors="replace")[:4096].strip()
    return ""
