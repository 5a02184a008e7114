"""`retarget view` and `--view`: what is refused, and what a button of the page does to a run."""

from pathlib import Path
from unittest.mock import Mock

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
from retarget.web.server import cast_of
from sim.mock_bus import mock_bus


@pytest.mark.parametrize(("before", "why"), [("", ON_THE_PAGE), ("the space bar", "the space bar")])
def test_the_button_is_a_stop_and_who_asked_first_stays_the_reason(before: str, why: str) -> None:
    feed, stop = Mock(stop_requested=Mock(return_value=False)), StopRequest(before)
    with prepare(performer(), RunOptions(robot="human"), clock=VirtualClock(), make_bus=mock_bus) as prepared:
        operator = RunOperator(prepared, stop, page=feed)
        assert operator.poll(None) == OperatorInput(before or None)
        feed.stop_requested.return_value = True
        assert operator.poll(None) == operator.poll(None) == OperatorInput(why)


@pytest.mark.parametrize(("bus", "measure"), [("mock", False), ("none", False), ("emulator", True)])
def test_a_page_shows_heat_and_current_where_servos_measure_them(bus: str, measure: bool) -> None:
    feed, options = Mock(), RunOptions(robot="op3", bus=bus)
    with (
        prepare(performer(), options, clock=VirtualClock(), make_bus=mock_bus) as prepared,
        viewing(feed, prepared, options, notify=lambda text: None),
    ):
        assert cast_of(feed.begin.call_args.args[0]).servos_measure == measure


def test_a_folder_with_a_run_is_that_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("websockets", reason="the extra 'view' is not installed (make test installs it)")
    opened = Mock(side_effect=InputError("enough"))
    monkeypatch.setattr("retarget.web.recorded.open_recorded", opened)
    (tmp_path / "run.npz").touch()
    for path, expected in ((tmp_path, tmp_path / "run.npz"), (tmp_path / "none", tmp_path / "none")):
        assert code_of("view", path) == 2
        assert opened.call_args.args == (expected,)
