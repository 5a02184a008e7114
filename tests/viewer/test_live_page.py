"""The page of a live run: rows are drawn while a browser is connected, its button stops, and its end is shown."""

import asyncio
from typing import Any

import numpy as np
import pytest

from followers import op3
from messages import shows
from retarget.run.table import RunTable
from retarget.viewer.joint_plot import curves
from retarget.viewer.live_page import STOPPING_WORDS, LivePage
from viewed import cast_of_op3, person


def row(tick: int, *, state: str = "following", truth: bool = False) -> RunTable:
    robot = op3()
    joints = int((robot.body.joint_type > 1).sum())
    known: dict[str, Any] = {"truth": np.arange(9.0 + joints)} if truth else {}
    return RunTable(
        time=np.array(0.04 * tick),
        doing=np.array(state, dtype=np.object_),
        reason=np.array("", dtype=np.object_),
        q=robot.body.qpos0 + 0.001 * tick,
        human_q=person().body.qpos0,
        present=np.where(np.arange(20) == 3, np.nan, 0.01 * tick),
        temperature=np.full(20, 25.0 + tick),
        current=np.full(20, 0.05 * tick),
        landmarks_asked=np.full((1, 3), 0.1 if tick % 2 else np.nan),
        observer_modes=np.full(len(robot.profile.observers), tick % 3, dtype=np.uint8),
        obstacles=np.array([[0.01 * tick, 0.2, 0.3, 1.0, 0.0, 0.0, 0.0]]),
        **known,
        sensors=np.array([[0.01 * tick, 0.0, 1.0], [np.nan] * 3]),
    )


class Watched:
    """A page, the stops that were asked for on it, and whether a browser is connected."""

    def __init__(self, server: Any, monkeypatch: pytest.MonkeyPatch) -> None:
        self.stops, self.looked = list[int](), True
        monkeypatch.setattr(server, "get_clients", lambda: {0: None} if self.looked else {})
        self.page = LivePage(server, lambda: self.stops.append(1))

    def show(self, row: RunTable, *, newest: bool = True) -> None:
        self.page.show(row, newest=newest)

    @property
    def letters(self) -> str:
        return str(self.page.state.content)


@pytest.fixture
def watched(server: Any, monkeypatch: pytest.MonkeyPatch) -> Watched:
    return Watched(server, monkeypatch)


def test_it_can_be_stopped_before_anything_moves(watched: Watched) -> None:
    assert "WAITING" in watched.letters
    watched.page.announce("calibrating")
    assert "CALIBRATING" in watched.letters
    asyncio.run(watched.page.pressed(None))
    assert watched.stops == [1] and watched.page.button.label == STOPPING_WORDS


@pytest.mark.long
def test_rows_are_drawn_and_the_end_is_shown(watched: Watched, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("retarget.viewer.live_page.LAST_SHOWN_S", 0.0)
    watched.page.begin(cast_of_op3())
    for tick in range(60):
        watched.show(row(tick))
    assert "FOLLOWING" in watched.letters and "2.36 s" in watched.letters
    watched.show(row(60, state="stopped"))
    assert "STOPPED" in watched.letters
    watched.show(row(61, state="ended"), newest=False)
    assert "STOPPED" in watched.letters, "a newer one waits"
    watched.page.end()
    shows(watched.letters)
    assert watched.page.button.disabled


def test_nothing_is_drawn_without_a_browser_but_all_is_kept_for_the_plot(watched: Watched) -> None:
    watched.looked = False
    watched.page.begin(cast_of_op3())
    for tick in range(600):
        watched.show(row(tick))
    assert "0.00 s" in watched.letters
    watched.looked = True
    watched.show(row(600, state="holding"))
    assert "HOLDING" in watched.letters and "24.00 s" in watched.letters
    time, _, temperature = curves(watched.page.rows, cast_of_op3(), 0, "temperature")
    assert len(time) == 500 and time[-1] == pytest.approx(24.0)
    np.testing.assert_allclose(temperature[-2:], [624.0, 625.0])
