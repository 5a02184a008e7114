"""The page of a recorded run: what is shown when, by its buttons, its slider and the clock; nothing for nobody."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from hardware.clock import VirtualClock
from retarget.rotations import FloatArray
from retarget.viewer.moment import Moment, Tracks
from retarget.viewer.page import PLAY, RecordedPage
from viewed import cast_of_op3, moment

ROWS, DT = 100, 0.01


class Run:
    """A run of a second; which rows of it were asked for."""

    def __init__(self, rows: int = ROWS) -> None:
        self.cast = cast_of_op3()
        self.times: FloatArray = np.arange(rows, dtype=np.float64) * DT
        self.notes: tuple[str, ...] = ()
        self.shown: list[int] = []

    def moment(self, row: int) -> Moment:
        self.shown.append(row)
        return moment(time=float(self.times[row]))

    def track(self, joint: int) -> Tracks:
        return Tracks(*(self.times,) * 5)


class Watched:
    """A page, whether somebody looks, and the clock that it plays by."""

    def __init__(self, server: Any, monkeypatch: pytest.MonkeyPatch, run: Run) -> None:
        self.looked, self.clock, self.run = True, VirtualClock(), run
        monkeypatch.setattr(server, "get_clients", lambda: {0: None} if self.looked else {})
        self.page: Any = RecordedPage(server, run, self.clock)

    def after(self, seconds: float) -> int:
        self.clock.sleep_until(self.clock.now() + seconds)
        self.page.tick()
        return self.run.shown[-1]

    def press(self, button: str) -> None:
        self.page._pressed(button)

    def slide(self, row: int, *, by: int | None) -> None:
        self.page._slider.value = row
        self.page._slid(SimpleNamespace(client_id=by))


@pytest.fixture
def watched(server: Any, monkeypatch: pytest.MonkeyPatch) -> Watched:
    return Watched(server, monkeypatch, Run())


def test_it_plays_by_the_clock_and_the_letters_follow(watched: Watched) -> None:
    assert watched.after(0.2005) == 20 and watched.page._slider.value == 20
    assert "0.20 s" in watched.page._state.content
    watched.page._timeline.speed = 0.1
    assert watched.after(0.2) == 22


def test_it_stands_steps_and_goes_on(watched: Watched) -> None:
    watched.after(0.2005)
    watched.press(PLAY)
    assert watched.after(0.5) == 20
    watched.press("+1")
    assert watched.after(0.5) == 21
    watched.press("-1")
    watched.press("-1")
    assert watched.after(0.0) == 19
    watched.press(PLAY)
    assert watched.after(0.1005) == 29


def test_a_person_slides_and_a_tick_does_not(watched: Watched) -> None:
    watched.slide(70, by=3)
    assert watched.after(0.5) == 70, "it stands where it was put"
    watched.press(PLAY)
    watched.slide(5, by=None)
    assert watched.after(0.1005) == 80, "the page moved its slider itself"


def test_nothing_is_worked_out_for_nobody(watched: Watched) -> None:
    watched.looked = False
    before = len(watched.run.shown)
    for _ in range(5):
        watched.after(0.1)
    assert len(watched.run.shown) == before
    watched.looked = True
    assert watched.after(0.0005) == 50, "and who comes later sees what is shown now"


def test_a_run_of_one_tick(server: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    watched = Watched(server, monkeypatch, Run(rows=1))
    for button in ("+1", "-1", PLAY, PLAY):
        watched.press(button)
        assert watched.after(1.0) == 0
