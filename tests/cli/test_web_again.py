"""A performer who is refused on the page of `web://` begins again there, at the same address, unless servos may have
torque."""

from collections.abc import Iterator
from contextlib import contextmanager
from unittest.mock import Mock

import pytest

from hardware.clock import VirtualClock
from messages import shows
from retarget.cli import main, run
from retarget.cli.exit import REFUSED
from sim.faults.sender import FakeSender
from sim.performer import synthetic_performer


class Page:
    """A page on which a performer stands still and never raises an arm. notes: the sentences that it shows."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, *, tries: int) -> None:
        self.notes, self.opened, self._tries, clock = list[str](), 0, tries, VirtualClock()
        still = synthetic_performer().cut(0.0, 0.1)
        self.sender = FakeSender(frames=still)
        monkeypatch.setattr(run, "opened_web", self._opened)
        monkeypatch.setattr(run, "MonotonicClock", lambda: clock)

    @contextmanager
    def _opened(self, *_: object, **__: object) -> Iterator[tuple[Mock, FakeSender]]:
        self.opened += 1
        yield Mock(note=self._note, messages=list, stop_requested=self._is_tired), self.sender

    def _note(self, text: str) -> None:
        self.notes.append(text)

    def _is_tired(self) -> bool:
        return len(self.reasons) >= self._tries

    @property
    def reasons(self) -> list[str]:
        return [text for text in self.notes if "begins again" in text]

    def count(self, begins: str) -> int:
        return sum(text.startswith(begins) for text in self.notes)


def code_of(*words: str) -> int:
    with pytest.raises(SystemExit) as left:
        main(["run", "--robot", "op3", "--source", "web://", "--countdown", "1", *words])
    return int(left.value.code or 0)


def test_on_servos_without_torque_the_same_page_begins_again(monkeypatch: pytest.MonkeyPatch) -> None:
    page = Page(monkeypatch, tries=3)
    assert code_of() == 130, "STOP on the page ends it"
    assert page.opened == 1 and len(page.reasons) == 3 and page.count("Raise your left arm") == 3
    for reason in page.reasons:
        shows(reason, "--no-check-sides")


def test_never_where_servos_may_have_torque(monkeypatch: pytest.MonkeyPatch) -> None:
    page = Page(monkeypatch, tries=3)
    assert code_of("--bus", "/dev/none") == REFUSED
    assert page.reasons == [] and page.count("Raise your left arm") == 1
