"""Findings as lines, and the findings on a machine, its ports and its firewall."""

import importlib
import os
from pathlib import Path
from unittest.mock import Mock

import pytest

from doctor_rig import fixes, text_of
from hardware.clock import VirtualClock
from messages import shows
from retarget.errors import Problem
from retarget.setup.doctor_machine import (
    DoctorFinding,
    FindingLevel,
    checks,
    firewall_findings,
    fix_all,
    lateness_finding,
    machine_findings,
    port_findings,
    python_findings,
    seconds_per_frame,
    serial_findings,
)


def test_each_finding_and_each_problem_of_a_refusal_is_a_line() -> None:
    assert DoctorFinding(FindingLevel.OK, "rate", "100 frames/s").render() == "ok   rate: 100 frames/s"
    assert DoctorFinding(FindingLevel.NOTE, "clock", "coarse").render() == "note clock: coarse"
    assert DoctorFinding(FindingLevel.FIX, "port", "taken", "Stop it").render() == "fix  port: taken. Stop it."
    assert DoctorFinding(FindingLevel.FIX, "port", "taken", "Who?").render().endswith("Who?")
    found = fix_all("port", [Problem("taken", next_step="Stop it"), Problem("also")])
    assert [one.level for one in found] == [FindingLevel.FIX, FindingLevel.FIX]
    assert found[0].what == "taken. Stop it."


@pytest.mark.parametrize("name", checks())
def test_each_check_has_a_level_whatever_its_facts(name: str) -> None:
    entry = checks()[name]
    *limited, last = entry.get("rows", [entry])
    assert all(row.keys() & {"under", "over"} for row in limited) and not last.keys() & {"under", "over"}
    for row in (*limited, last):
        level = FindingLevel(row.get("level", entry.get("level")))
        assert level is not FindingLevel.FIX or row.get("then", entry.get("then")), (
            "it is wrong, and nothing is to be done"
        )


def test_each_firewall_has_a_finding_with_its_command(tmp_path: Path) -> None:
    (tmp_path / "etc/ufw").mkdir(parents=True)
    (tmp_path / "etc/ufw/ufw.conf").write_text("ENABLED=yes\n")
    (tmp_path / "run/firewalld").mkdir(parents=True)
    (tmp_path / "proc").mkdir()
    (tmp_path / "proc/version").write_text("Linux 5.15 Microsoft")
    (tmp_path / ".dockerenv").touch()
    text = text_of(firewall_findings(39_539, root=tmp_path))
    for part in ("sudo ufw allow 39539/udp", "--add-port=39539/udp", "mirrored", "-p 39539:39539/udp", "Windows"):
        assert part in text


GOVERNOR = "sys/devices/system/cpu/cpu0/cpufreq/scaling_governor"


def said(root: Path, name: str, content: str) -> str:
    path = root / name
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(content + "\n")
    return text_of(machine_findings(root=root))


@pytest.mark.parametrize(
    ("name", "content", "line"),
    [
        (GOVERNOR, "powersave", "note governor: powersave"),
        (GOVERNOR, "performance", "ok   governor: performance"),
        ("proc/sys/net/core/rmem_max", "65536", "fix  UDP buffer: net.core.rmem_max 65536"),
        ("proc/sys/net/core/rmem_max", "212992", "note UDP buffer"),
        ("proc/sys/net/core/rmem_max", "4194304", "ok   UDP buffer"),
        ("sys/fs/cgroup/cpu.max", "50000 100000", ", limited to 0.5 by a cgroup"),
        ("proc/loadavg", "99.00 1 1", "note cores"),
        ("sys/kernel/realtime", "1", "PREEMPT_RT"),
        ("proc/version", "Linux #1 SMP PREEMPT_DYNAMIC", "PREEMPT_DYNAMIC"),
    ],
)
def test_each_file_is_read(tmp_path: Path, name: str, content: str, line: str) -> None:
    assert line in said(tmp_path, name, content)


def test_a_process_that_wakes_up_late_has_a_finding() -> None:
    assert not fixes([lateness_finding(VirtualClock())])

    class Late(VirtualClock):
        def sleep_until(self, deadline: float) -> None:
            super().sleep_until(deadline + 0.006)

    assert fixes([lateness_finding(Late())])


@pytest.fixture
def terminal(tmp_path: Path) -> Path:
    """A link to a device of characters that every user may open."""
    link = tmp_path / "servo"
    link.symlink_to(os.devnull)
    return link


@pytest.mark.parametrize(("timer", "count"), [("16", 1), ("1", 0)])
def test_the_latency_timer(terminal: Path, tmp_path: Path, timer: str, count: int) -> None:
    (tmp_path / "null").mkdir()
    (tmp_path / "null/latency_timer").write_text(timer)
    lines = fixes(port_findings(str(terminal), devices=tmp_path, processes=tmp_path / "null"))
    assert len(lines) == count
    if count:
        shows(lines[0], 16)


def test_the_process_that_holds_a_port_is_named(terminal: Path, tmp_path: Path) -> None:
    descriptors = tmp_path / "77/fd"
    descriptors.mkdir(parents=True)
    (descriptors / "5").symlink_to(os.devnull)
    (tmp_path / "77/cmdline").write_bytes(b"retarget\0servo\0monitor\0")
    lines = fixes(port_findings(str(terminal), devices=tmp_path, processes=tmp_path))
    assert len(lines) == 1
    shows(lines[0], 77)


def test_paths_that_are_no_ports_and_rights_that_are_missing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for path in (str(tmp_path / "none"), str(tmp_path), "x" * 5000):
        shows(fixes(port_findings(path))[0])
    shows(text_of(serial_findings([])))
    with monkeypatch.context() as patch:
        patch.setattr(os, "access", lambda *_: False)
        shows(fixes(serial_findings([os.devnull]))[0], "usermod")
    monkeypatch.setattr(os, "geteuid", lambda: 1000)
    monkeypatch.setattr(os, "getegid", lambda: 1000)
    monkeypatch.setattr(os, "getgroups", list)
    assert not fixes(serial_findings([]))


def test_a_wheel_that_cannot_be_imported(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(importlib, "import_module", Mock(side_effect=ImportError("wrong machine")))
    shows(text_of(python_findings()))


def test_a_frame_is_really_solved() -> None:
    assert 1e-5 < seconds_per_frame(5) < 0.5
