"""Servo ports: nothing is opened."""

import os
from pathlib import Path

import pytest

from doctor_rig import mends, text_of
from retarget.doctor.port_findings import port_findings
from support.messages import shows


@pytest.fixture
def terminal(tmp_path: Path) -> Path:
    """A link to a device of characters that everybody may open."""
    link = tmp_path / "servo"
    link.symlink_to(os.devnull)
    return link


def test_a_sound_port(terminal: Path, tmp_path: Path) -> None:
    found = port_findings(str(terminal), baud=1_000_000, devices=tmp_path, processes=tmp_path)
    assert not mends(found)
    shows(text_of(found), 1000000)


def test_a_path_that_leads_nowhere_and_a_file(tmp_path: Path) -> None:
    shows(mends(port_findings(str(tmp_path / "none")))[0])
    shows(mends(port_findings(str(tmp_path)))[0])
    shows(mends(port_findings("x" * 5000))[0])


def test_without_permission(terminal: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(os, "access", lambda *_: False)
    shows(mends(port_findings(str(terminal)))[0])


@pytest.mark.parametrize(("timer", "count"), [("16", 1), ("1", 0)])
def test_the_latency_timer(terminal: Path, tmp_path: Path, timer: str, count: int) -> None:
    (tmp_path / "null").mkdir()
    (tmp_path / "null/latency_timer").write_text(timer)
    lines = mends(port_findings(str(terminal), devices=tmp_path, processes=tmp_path / "null"))
    assert len(lines) == count
    if count:
        shows(lines[0], 16)


def test_who_has_it(terminal: Path, tmp_path: Path) -> None:
    descriptors = tmp_path / "77/fd"
    descriptors.mkdir(parents=True)
    (descriptors / "5").symlink_to(os.devnull)
    (tmp_path / "77/cmdline").write_bytes(b"retarget\0servo\0monitor\0")
    lines = mends(port_findings(str(terminal), devices=tmp_path, processes=tmp_path))
    assert len(lines) == 1
    shows(lines[0], 77)
