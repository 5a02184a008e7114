"""`retarget view` and `--view`: what is refused, and what a button of the page does to a run."""

from pathlib import Path
from typing import Any, cast

import pytest

from command_line import code_of
from hardware.clock import VirtualClock
from recordings import performer
from retarget.cli.exit import StopRequest
from retarget.cli.operator import ON_THE_PAGE, RunOperator
from retarget.cli.view import viewing
from retarget.errors import InputError
from retarget.run.options import RunOptions
from retarget.run.prepare import prepare
from retarget.run.supervisor import OperatorInput
from retarget.web.feed import PageSetup
from retarget.web.server import cast_of
from sim.mock_bus import mock_bus


class FakeFeed:
    def __init__(self) -> None:
        self.pressed, self.rows = False, list[int]()
        self.setup: PageSetup

    def begin(self, setup: PageSetup, *, rate_hz: float) -> None:
        self.setup = setup

    def stop_requested(self) -> bool:
        return self.pressed

    def on_row(self, record: object, row: int) -> None:
        self.rows.append(row)


@pytest.mark.parametrize(("before", "why"), [("", ON_THE_PAGE), ("the space bar", "the space bar")])
def test_the_button_is_a_stop_and_who_asked_first_stays_the_reason(before: str, why: str) -> None:
    feed, stop = FakeFeed(), StopRequest(before)
    options = RunOptions(robot="human")
    with prepare(performer(), options, clock=VirtualClock(), make_bus=mock_bus) as prepared:
        operator = RunOperator(prepared, stop, page=cast(Any, feed))
        assert operator.poll(None) == OperatorInput(before or None)
        feed.pressed = True
        assert operator.poll(None) == operator.poll(None) == OperatorInput(why)


@pytest.mark.parametrize(("bus", "measure"), [("mock", False), ("none", False), ("emulator", True)])
def test_a_page_shows_heat_and_current_where_servos_measure_them(bus: str, measure: bool) -> None:
    feed, options = FakeFeed(), RunOptions(robot="op3", bus=bus)
    with (
        prepare(performer(), options, clock=VirtualClock(), make_bus=mock_bus) as prepared,
        viewing(cast(Any, feed), prepared, options, notify=lambda text: None),
    ):
        assert cast_of(feed.setup).servos_measure == measure


def test_a_folder_with_a_run_is_that_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("websockets", reason="the extra 'view' is not installed (make test installs it)")
    opened: list[Path] = []

    def open_recorded(path: Path, *, body: Path | None) -> None:
        opened.append(path)
        raise InputError("enough")

    monkeypatch.setattr("retarget.web.recorded.open_recorded", open_recorded)
    (tmp_path / "run.npz").touch()
    for path, expected in ((tmp_path, tmp_path / "run.npz"), (tmp_path / "none", tmp_path / "none")):
        assert code_of("view", path) == 2
        assert opened[-1] == expected
