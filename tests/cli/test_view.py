"""`retarget view` and `--view`: what is refused, and what a button of the page does to a run."""

from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import pytest

from messages import shows
from retarget.cli import main
from retarget.cli.exit import REFUSED, StopRequest
from retarget.cli.view import ON_THE_PAGE, Viewing
from retarget.report.outputs import Outputs
from retarget.run.loop import Watch


def leave(*words: str | Path) -> int:
    with pytest.raises(SystemExit) as leaving:
        main([*map(str, words)])
    return int(leaving.value.code or 0)


def test_what_is_no_run_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    other = tmp_path / "notes.npz"
    other.write_text("no run")
    assert leave("view", other) == REFUSED
    assert leave("view", tmp_path / "none.npz") == REFUSED
    told = capsys.readouterr().err.splitlines()
    assert len(told) == 2
    shows(told[0])
    shows(told[1], "--record", "FILE.mcap")


def test_a_page_is_where_view_says() -> None:
    assert Outputs().view is None


class FakeFeed:
    def __init__(self) -> None:
        self.pressed, self.rows = False, list[int]()

    def stop_asked(self) -> bool:
        return self.pressed

    def on_row(self, record: object, row: int) -> None:
        self.rows.append(row)


def test_the_button_is_a_stop_that_is_told_once() -> None:
    feed, stop, told = FakeFeed(), StopRequest(), list[str]()
    page = Viewing(cast(Any, feed), told.append)
    asked = page.heard(stop, stop)
    assert not asked() and not told
    feed.pressed = True
    assert asked() and asked() and stop.why() == ON_THE_PAGE and not stop.forced_stop()
    assert told == [f"{ON_THE_PAGE}: stopping"]


def test_who_asked_first_stays_the_reason() -> None:
    feed, stop = FakeFeed(), StopRequest()
    stop.ask("the space bar")
    feed.pressed = True
    assert Viewing(cast(Any, feed)).heard(stop, stop)() and stop.why() == "the space bar"


def test_every_row_is_shown_to_all_who_look_on() -> None:
    feed, seen = FakeFeed(), list[int]()
    watch = Watch(on_row=lambda record, row: seen.append(row))
    for row in range(3):
        Viewing(cast(Any, feed)).watch(watch).on_row(cast(Any, SimpleNamespace()), row)
    assert seen == feed.rows == [0, 1, 2]


def test_without_a_page_nothing_is_changed() -> None:
    stop, watch = StopRequest(), Watch()
    assert Viewing(None).heard(stop, stop) is stop and Viewing(None).watch(watch) is watch
