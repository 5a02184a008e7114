"""What a run sends to its page: it never waits for it, and receives nothing from it but that it is to stop."""

import os
import signal
import socket
from collections.abc import Callable
from contextlib import nullcontext
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from followers import dimensions, op3, performer
from messages import refuses
from retarget.cli.run import StreamOptions, follow_live
from retarget.errors import ConfigError, InputError
from retarget.model.human import build_human
from retarget.pictures.outputs import Outputs
from retarget.run.options import RunOptions
from retarget.run.record import KEPT, Record
from retarget.run.run_result import Extras
from retarget.run.table import RunTable
from retarget.types import RunState
from retarget.web.feed import READY, STOP, PageSetup, Settings, ViewFeed, open_feed, unpacked

TICKS = 50


def record() -> Record:
    widths = {"robot": 27, "servos": 20, "landmarks": 2, "observers": 21, "human": 60, "joints": 1, "sensors": 3}
    names: dict[str, Any] = {"human_joint_names": ("head",), "landmark_names": ("l_hand", "r_hand")}
    made = Record.empty(TICKS, widths, KEPT, start=np.zeros(20), **names)
    for array in (made.q, made.present, made.temperature, made.landmarks_asked):
        array[:] = 0.25
    made.bus_time[:] = np.arange(TICKS) / 125.0
    made.human_q[:], made.sensors[:] = 0.5, 0.75
    return made


def feed(*, every: int = 5) -> tuple[ViewFeed, socket.socket]:
    ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    theirs.setblocking(False)
    run = ViewFeed(ours, 0)
    theirs.send(READY)
    run.begin(PageSetup(None, None, None, "", landmarks=("head", "l_hand", "r_hand")), rate_hz=25.0 * every)
    theirs.recv(1 << 16)
    return run, theirs


def looked_at(port: int = 0) -> Settings:
    return Settings(listen=False, port=port, robot="op3", performs=False)


def received(page: socket.socket) -> RunTable:
    row = unpacked(page.recv(1 << 16))
    assert isinstance(row, RunTable)
    return row


def test_some_rows_are_shown_with_what_the_robot_does() -> None:
    run, page = feed()
    run.extras = Extras(words=lambda: ("holding", "the stream is silent"), current=lambda: np.full(20, 1.25))
    whole = record()
    for row in range(TICKS):
        run.on_row(whole, row)
    rows = [received(page) for _ in range(10)]
    for shown in rows:
        assert np.isnan(shown.landmarks_asked[0]).all() and (shown.landmarks_asked[1:] == 0.25).all()
        assert "observer_modes" in shown
    assert all(row.doing == "holding" and row.reason == "the stream is silent" for row in rows)
    assert all((row.current == 1.25).all() for row in rows)
    assert all((row.sensors == np.full((3, 3), 0.75)).all() for row in rows)
    assert [row.time for row in rows] == [pytest.approx(i / 125.0) for i in range(4, TICKS, 5)]
    with pytest.raises(BlockingIOError):
        page.recv(1)
    assert run.dropped == 0


def test_what_is_not_in_the_record_is_shown_too() -> None:
    run, page = feed(every=1)
    poses = np.tile([0.5, 0.5, 0.5, 1.0, 0.0, 0.0, 0.0], (2, 1))
    truth = np.concatenate([np.arange(7.0), np.arange(20.0), [0.25, -0.5]])
    run.extras = Extras(obstacles=lambda: poses, truth=lambda: truth)
    run.on_row(record(), 0)
    row = received(page)
    assert "current" not in row, "it is not known"
    np.testing.assert_array_equal(row.obstacles, poses)
    np.testing.assert_array_equal(row.truth, truth)


def test_a_page_that_takes_nothing_costs_nothing() -> None:
    run, page = feed(every=1)
    whole = record()
    for _ in range(100):
        for row in range(TICKS):
            run.on_row(whole, row)
    assert run.dropped > 4000
    page.close()
    run.on_row(whole, 0)
    assert not run.stop_requested(), "a page that is gone does not stop the robot"


@pytest.mark.long
def test_a_page_that_hangs_is_ended_with_the_run(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("retarget.web.feed.ENDING_S", 0.1)
    with open_feed(looked_at()) as run:
        os.kill(run.process, signal.SIGSTOP)
    with pytest.raises(ProcessLookupError):
        os.kill(run.process, 0)


def test_it_can_only_stop_and_stays_so() -> None:
    run, page = feed()
    assert not run.stop_requested()
    page.send(b"go")
    page.send(b"")
    assert not run.stop_requested() and not run.stop_requested()
    page.send(STOP)
    assert run.stop_requested() and run.stop_requested()


def test_what_is_asked_before_the_performer_is_known_is_not_lost() -> None:
    setup = PageSetup(None, None, None, "")
    run, theirs = feed()
    run.announce("calibrating")
    assert unpacked(theirs.recv(1 << 16)) == "calibrating"
    theirs.send(STOP)
    theirs.send(READY)
    run.begin(setup, rate_hz=25.0)
    assert run.stop_requested()
    theirs.close()
    run.announce("no page reads it")
    with refuses(ConfigError):
        run.begin(setup, rate_hz=25.0)


def test_a_page_is_there_before_the_performer_is_known_and_ends_with_the_run(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("retarget.web.feed.ENDING_S", 30.0)  # on a machine that has other things to do
    setup = PageSetup(str(op3().profile.path), None, "table", build_human(dimensions(performer())).mjcf)
    with open_feed(looked_at()) as run:
        assert run.address.startswith("http://127.0.0.1:")
        port = int(run.address.split(":")[2].split("/")[0])
        with open_feed(looked_at(port)) as other:
            assert f":{port}/" not in other.address, "the next port that is free"
        run.announce("calibrating")
        run.begin(setup, rate_hz=125.0)
    with pytest.raises(ProcessLookupError):
        os.kill(run.process, 0)


def test_a_page_that_dies_at_once_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("sys.executable", "/bin/false")
    with refuses(ConfigError), open_feed(looked_at()):
        pass


def test_the_page_of_a_live_run_is_open_while_the_performer_is_measured(monkeypatch: pytest.MonkeyPatch) -> None:
    said: list[str] = []
    page = SimpleNamespace(address="http://page", announce=said.append)
    monkeypatch.setattr("retarget.cli.view.open_feed", lambda *given: nullcontext(page))

    def begin(*given: Any, enter: Callable[[RunState], None], **named: Any) -> None:
        enter(RunState.COUNTDOWN)
        enter(RunState.CALIBRATING)
        raise InputError("the performer does not stand still")

    monkeypatch.setattr("retarget.cli.run.begin_live", begin)
    with refuses(InputError):
        follow_live("json://:14159", RunOptions(robot="op3"), Outputs(view=0), StreamOptions())
    assert said == ["countdown", "calibrating"]
