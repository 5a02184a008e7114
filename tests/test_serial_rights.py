"""Rights for serial ports."""

import os

import pytest

from doctor_rig import mends, text_of
from retarget.doctor.serial_rights import serial_findings
from support.messages import shows


def test_ports_that_may_be_opened() -> None:
    assert not mends(serial_findings([os.devnull]))


def test_ports_that_may_not(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(os, "access", lambda *_: False)
    shows(mends(serial_findings([os.devnull]))[0], "usermod")


def test_where_nothing_is_plugged_in(monkeypatch: pytest.MonkeyPatch) -> None:
    shows(text_of(serial_findings([])))
    monkeypatch.setattr(os, "geteuid", lambda: 1000)
    monkeypatch.setattr(os, "getegid", lambda: 1000)
    monkeypatch.setattr(os, "getgroups", list)
    assert not mends(serial_findings([]))
