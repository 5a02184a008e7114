"""The machine, by the kernel's files."""

import re
from pathlib import Path

import pytest

from doctor_rig import mends, text_of
from hardware.clock import VirtualClock
from retarget.doctor.machine_findings import lateness_finding, machine_findings
from support.messages import shows_lines

GOVERNOR = "sys/devices/system/cpu/cpu0/cpufreq/scaling_governor"
CLOCK = "sys/devices/system/clocksource/clocksource0/current_clocksource"

CORES = re.compile(r"\d+ of \d+")


def said(root: Path, name: str, content: str) -> str:
    path = root / name
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(content + "\n")
    return text_of(machine_findings(root, root=root))


@pytest.mark.parametrize(
    ("name", "content", "line"),
    [
        (GOVERNOR, "powersave", "note governor: powersave"),
        (GOVERNOR, "performance", "ok   governor: performance"),
        (CLOCK, "hpet", "note clock: source hpet"),
        (CLOCK, "tsc", "ok   clock: source tsc"),
        ("proc/sys/net/core/rmem_max", "65536", "mend UDP buffer: net.core.rmem_max 65536"),
        ("proc/sys/net/core/rmem_max", "212992", "note UDP buffer"),
        ("proc/sys/net/core/rmem_max", "4194304", "ok   UDP buffer"),
        ("sys/fs/cgroup/cpu.max", "50000 100000", "limited to 0.5 by a cgroup"),
        ("proc/loadavg", "99.00 1 1", "note cores"),
        ("sys/kernel/realtime", "1", "PREEMPT_RT"),
        ("proc/version", "Linux #1 SMP PREEMPT_DYNAMIC", "PREEMPT_DYNAMIC"),
    ],
)
def test_each_file_is_read(tmp_path: Path, name: str, content: str, line: str) -> None:
    assert line in said(tmp_path, name, content)


def test_half_a_core_is_too_little(tmp_path: Path) -> None:
    shows_lines(said(tmp_path, "sys/fs/cgroup/cpu.max", "50000 100000"), "mend cores", varies=CORES)


def test_without_the_files_nothing_fails(tmp_path: Path) -> None:
    text = text_of(machine_findings(tmp_path / "gone", root=tmp_path))
    shows_lines(text, re.compile("disk|UDP buffer"))


def test_who_wakes_in_time_and_who_late() -> None:
    assert not mends([lateness_finding(VirtualClock())])

    class Late(VirtualClock):
        def sleep_until(self, deadline: float) -> None:
            super().sleep_until(deadline + 0.006)

    assert mends([lateness_finding(Late())])
