"""`retarget view` and `--view`: what is refused, and what a button of the page does to a run."""

from pathlib import Path
from typing import Any, cast

import pytest

from hardware.clock import VirtualClock
from messages import shows
from recordings import performer
from retarget.cli import main
from retarget.cli.exit import REFUSED, StopRequest
from retarget.cli.view import ON_THE_PAGE, Viewing, viewing
from retarget.report.outputs import Outputs
from retarget.run.options import RunOptions
from retarget.run.prepare import prepare
from retarget.viewer.feed import PageSetup
from retarget.viewer.live_page import cast_of
from sim.mock_bus import mock_bus


def leave(*words: str | Path) -> int:
    with pytest.raises(SystemExit) as leaving:
        main([*map(str, words)])
    return int(leaving.value.code or 0)


def test_what_is_no_run_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    other = tmp_path / "notes.npz"
    other.write_text("no run")
    assert leave("view", other) == REFUSED
    assert leave("view", tmp_path / "none.npz") == REFUSED
    lines = capsys.readouterr().err.splitlines()
    assert len(lines) == 2
    shows(lines[0])
    shows(lines[1], "--record", "FILE.mcap")


def test_a_page_is_where_view_says() -> None:
    assert Outputs().view is None


class FakeFeed:
    def __init__(self) -> None:
        self.pressed, self.rows = False, list[int]()
        self.setup: PageSetup

    def begin(self, setup: PageSetup, *, rate_hz: float) -> None:
        self.setup = setup

    def stop_asked(self) -> bool:
        return self.pressed

    def on_row(self, record: object, row: int) -> None:
        self.rows.append(row)


def test_the_button_is_a_stop() -> None:
    feed, stop, notes = FakeFeed(), StopRequest(), list[str]()
    page = Viewing(cast(Any, feed), notes.append)
    asked = page.with_stop_button(stop, stop)
    assert not asked() and not notes
    feed.pressed = True
    assert asked() and asked() and stop.why() == ON_THE_PAGE and not stop.forced_stop()


def test_who_asked_first_stays_the_reason() -> None:
    feed, stop = FakeFeed(), StopRequest()
    stop.ask("the space bar")
    feed.pressed = True
    assert Viewing(cast(Any, feed)).with_stop_button(stop, stop)() and stop.why() == "the space bar"


@pytest.mark.parametrize(("bus", "measure"), [("mock", False), ("none", False), ("emulator", True)])
def test_a_page_shows_heat_and_current_where_servos_measure_them(bus: str, measure: bool) -> None:
    feed, options = FakeFeed(), RunOptions(robot="op3", bus=bus)
    with (
        prepare(performer(), options, clock=VirtualClock(), make_bus=mock_bus) as prepared,
        viewing(cast(Any, feed), prepared, options, notify=lambda text: None),
    ):
        assert cast_of(feed.setup).servos_measure == measure
