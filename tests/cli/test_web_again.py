"""A performer who is refused on the page of `web://` begins again there, at the same address, unless servos may have
torque."""

from contextlib import nullcontext
from unittest.mock import Mock

import pytest

from command_line import code_of
from hardware.clock import VirtualClock
from messages import shows
from retarget.cli import run
from retarget.cli.exit import INTERRUPTED, REFUSED
from sim.faults.sender import FakeSender
from sim.performer import synthetic_performer


class Page:
    """A page on which a performer stands still and never raises an arm, and presses STOP after some tries."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, *, tries: int) -> None:
        self.notes = list[str]()
        """The sentences that it shows."""
        sender, clock = FakeSender(frames=synthetic_performer().cut(0.0, 0.1)), VirtualClock()
        page = Mock(note=self.notes.append, messages=list, stop_requested=lambda: len(self.reasons) >= tries)
        self.opened = Mock(side_effect=lambda *_, **__: nullcontext((page, sender)))
        monkeypatch.setattr(run, "opened_web", self.opened)
        monkeypatch.setattr(run, "MonotonicClock", lambda: clock)

    @property
    def reasons(self) -> list[str]:
        return [text for text in self.notes if "begins again" in text]

    def count(self, begins: str) -> int:
        return sum(text.startswith(begins) for text in self.notes)


WEB = ("run", "--robot", "op3", "--source", "web://", "--countdown", "1")


def test_on_servos_without_torque_the_same_page_begins_again(monkeypatch: pytest.MonkeyPatch) -> None:
    page = Page(monkeypatch, tries=3)
    assert code_of(*WEB) == INTERRUPTED, "STOP on the page ends it"
    assert page.opened.call_count == 1 and len(page.reasons) == 3 and page.count("Raise your left arm") == 3
    for reason in page.reasons:
        shows(reason, "--no-check-sides")


def test_never_where_servos_may_have_torque(monkeypatch: pytest.MonkeyPatch) -> None:
    page = Page(monkeypatch, tries=3)
    assert code_of(*WEB, "--bus", "/dev/none") == REFUSED
    assert page.reasons == [] and page.count("Raise your left arm") == 1
