"""The page of a recorded run: what is shown when, by its buttons, its slider and the clock."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any, cast
from unittest.mock import MagicMock

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from followers import op3
from hardware.clock import VirtualClock
from messages import shows
from retarget.ik.gravity_torque import GRAVITY
from retarget.run.table import RunTable
from retarget.types import FloatArray
from retarget.viewer.joint_plot import OF_ANGLES, QUANTITIES, JointPlot, curves
from retarget.viewer.page import PLAY, RecordedPage, headline_of
from retarget.viewer.snapshot import zero_moment_point
from viewed import cast_of_op3, person, snapshot

ROWS, DT = 100, 0.01


class Run:
    """A run of a second; which rows of it were asked for."""

    def __init__(self, rows: int = ROWS) -> None:
        self.cast = cast_of_op3()
        self.time: FloatArray = np.arange(rows, dtype=np.float64) * DT
        self.notes: tuple[str, ...] = ()
        self.shown: list[int] = []

    def __len__(self) -> int:
        return len(self.time)

    def __getitem__(self, row: int) -> RunTable:
        return rows_of(self.time[row : row + 1])[0]


def rows_of(times: FloatArray, *, present: float = 0.1) -> list[RunTable]:
    """Goals at 0.2 rad; servos at `present` rad, from the tenth row on."""
    human, servos = person().body.qpos0, np.ones(20)
    goal = op3().body.qpos0.copy()
    goal[op3().servo_columns] = 0.2
    known: dict[str, Any] = {"human_q": human, "q": goal, "temperature": 40.0 * servos, "current": 0.5 * servos}
    return [
        RunTable(time=np.array(time), present=(present if row > 8 or len(times) > 50 else np.nan) * servos, **known)
        for row, time in enumerate(times.tolist())
    ]


class Watched:
    """A page, whether a browser is connected, and the clock that it plays by."""

    def __init__(self, server: Any, monkeypatch: pytest.MonkeyPatch, run: Run) -> None:
        self.looked, self.clock, self.run = True, VirtualClock(), run
        monkeypatch.setattr(server, "get_clients", lambda: {0: None} if self.looked else {})
        self.page: Any = RecordedPage(server, cast(Any, run), self.clock)
        show = self.page._page.show

        def shown(row: int) -> None:
            run.shown.append(row)
            show(row)

        monkeypatch.setattr(self.page._page, "show", shown)

    def after(self, seconds: float) -> int:
        self.clock.sleep_until(self.clock.now() + seconds)
        self.page.tick()
        return self.run.shown[-1] if self.run.shown else 0

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
    assert "0.20 s" in watched.page._page._state.content
    watched.page._speed.value = "0.1"
    assert watched.after(0.2) == 22


def test_nothing_is_computed_without_a_browser(watched: Watched) -> None:
    watched.looked = False
    before = len(watched.run.shown)
    for _ in range(5):
        watched.after(0.1)
    assert len(watched.run.shown) == before
    watched.looked = True
    assert watched.after(0.0005) == 50, "and who comes later sees what is shown now"


@given(st.lists(st.tuples(st.floats(0.0, 3.0), st.integers(-600, 600), st.booleans()), max_size=20))
def test_it_is_always_somewhere(moves: list[tuple[float, int, bool]]) -> None:
    server, clock, run = MagicMock(), VirtualClock(), Run()
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(
            "retarget.viewer.page.Page", lambda server, cast, rows, state: SimpleNamespace(show=run.shown.append)
        )
        page: Any = RecordedPage(server, cast(Any, run), clock)
        page._speed.value = "1"
        for later, row, plays in moves:
            clock.sleep_until(clock.now() + later)
            page._slider.value = row
            page._slid(SimpleNamespace(client_id=1))
            if plays:
                page._pressed(PLAY)
            page.tick()
    assert all(0 <= row < ROWS for row in run.shown)


def test_letters_say_what_it_does_and_why_and_hold_no_markup() -> None:
    text = headline_of(snapshot(doing="stopping", reason="a <script>", present=np.full(20, 0.1)), "gone")
    shows(text, "STOPPING", "5.7")
    assert "degrees" not in headline_of(snapshot(present=np.full(20, np.nan)))


@pytest.mark.parametrize("quantity", QUANTITIES)
def test_curves_of_a_joint_are_no_more_than_can_be_seen(quantity: str) -> None:
    at, goal, servo = curves(rows_of(np.arange(5000.0)), cast_of_op3(), 3, quantity)
    assert len(at) == len(goal) == len(servo) <= 1500 and (at[0], at[-1]) == (0.0, 4999.0)
    expected = {"angle": np.degrees(0.1), "off its goal": np.degrees(0.1), "temperature": 40.0, "current": 0.5}
    np.testing.assert_allclose(servo, expected[quantity])
    assert np.isnan(goal).all() == (quantity != "angle")


def test_what_servos_do_not_measure_is_not_offered(server: Any) -> None:
    plot: Any = JointPlot(server, replace(cast_of_op3(), servos_measure=False), rows_of(np.arange(50.0)))
    assert plot._quantity.options == OF_ANGLES


@pytest.mark.parametrize("quantity", QUANTITIES)
def test_a_plot_gives_its_range(quantity: str, server: Any) -> None:
    """It finds that out by itself only where all is known: a goal that is NaN left the whole plot empty."""
    plot: Any = JointPlot(server, cast_of_op3(), rows_of(np.arange(50.0)))
    plot._quantity.value = quantity
    plot.draw()
    reach, shown = plot._plot.scales["y"]["range"], plot._plot.data[2]
    assert reach[0] < np.nanmin(shown) <= np.nanmax(shown) < reach[1]


# The zero-moment point of a motion, against mechanics.


def test_at_rest_it_is_below_the_centre_of_mass() -> None:
    com = np.tile([0.02, -0.01, 0.25], (3, 1))
    np.testing.assert_allclose(zero_moment_point(np.array([-0.04, 0.0, 0.04]), com), [0.02, -0.01])


@pytest.mark.parametrize("times", [[-0.04, 0.0, 0.04], [-0.02, -0.01, 0.0, 0.03]])
def test_under_a_constant_acceleration_it_is_behind(times: list[float]) -> None:
    """Parabolas are met exactly, also where looks come at uneven times."""
    at, pull = np.array(times), np.array([0.8, -0.3, 0.5])
    com, now = (np.array([0.0, 0.0, 0.25]) + 0.5 * pull * (times[..., None] + 0.9) ** 2 for times in (at, np.zeros(1)))
    expected = now[0, :2] - now[0, 2] / (GRAVITY + 0.5) * pull[:2]
    np.testing.assert_allclose(zero_moment_point(at, com), expected, atol=1e-9)


@pytest.mark.parametrize("times", [[0.0], [0.0, 0.04, 0.05], [-0.05, -0.04, 0.0]])
def test_without_looks_before_and_after_there_is_none(times: list[float]) -> None:
    assert np.isnan(zero_moment_point(np.array(times), np.ones((len(times), 3)))).all()


def test_in_free_fall_there_is_none() -> None:
    at = np.array([-0.04, 0.0, 0.04])
    com = np.column_stack([np.zeros(3), np.zeros(3), 1.0 - 0.5 * 9.9 * at**2])
    assert np.isnan(zero_moment_point(at, com)).all()
