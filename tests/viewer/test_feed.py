"""What a run sends to its page: it never waits for it, and receives nothing from it but that it is to stop."""

import socket
import subprocess
from dataclasses import fields, replace
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from followers import dimensions, op3, performer
from messages import refuses
from retarget.errors import ConfigError
from retarget.model.human import build_human
from retarget.model.scene_state import ObstaclePoses
from retarget.run.record import HumanRecord, Record, RobotRecord, Timing
from retarget.run.run_result import Extras, Truth
from retarget.viewer.feed import STOP, LiveRow, PageSetup, RowSizes, ViewFeed, open_feed, pack, unpack
from retarget.viewer.live_page import _serve, announced

TICKS = 50
SIZES = RowSizes(robot=27, human=60, servos=20, landmarks=2, observers=21, sensors=3)


def record() -> Record:
    robot = RobotRecord.empty(TICKS, nq=27, start=np.zeros(20), landmark_names=("l_hand", "r_hand"), observers=21)
    for array in (robot.q, robot.present, robot.temperature, robot.landmarks_asked):
        array[:] = 0.25
    robot.bus_time[:] = np.arange(TICKS) / 125.0
    human = HumanRecord.empty(TICKS, nq=60, joint_names=("head",), sensors=3)
    human.q[:], human.sensors[:] = 0.5, 0.75
    return Record(np.zeros(TICKS), np.zeros(TICKS, dtype=np.int8), human, robot, Timing.empty(TICKS))


class FakeProcess:
    """The process of a page, which ends or does not."""

    def __init__(self, *, hangs: bool = False) -> None:
        self.hangs, self.killed = hangs, False

    def wait(self, timeout: float | None = None) -> int:
        if self.hangs and not self.killed:
            raise subprocess.TimeoutExpired("page", timeout or 0.0)
        return 0

    def kill(self) -> None:
        self.killed = True


def feed(*, every: int = 5, process: FakeProcess | None = None) -> tuple[ViewFeed, socket.socket]:
    ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    ours.setblocking(False)
    theirs.setblocking(False)
    return ViewFeed(ours, cast(Any, process or FakeProcess()), address="", rate_hz=25.0 * every), theirs


def test_some_rows_are_shown_with_what_the_robot_does() -> None:
    run, page = feed()
    run.extras = Extras(words=lambda: ("holding", "the stream is silent"), current=lambda: np.full(20, 1.25))
    whole = record()
    for row in range(TICKS):
        run.on_row(whole, row)
    sizes = announced(page.recv(4096))
    assert sizes.landmarks == ("l_hand", "r_hand") and sizes.observers == 21
    rows = [unpack(page.recv(1 << 16), SIZES) for _ in range(10)]
    assert all(row is not None and row.state == "holding" and row.why == "the stream is silent" for row in rows)
    assert all(row is not None and (row.current == 1.25).all() for row in rows)
    assert all(row is not None and (row.sensors == 0.75).all() and row.sensors.shape == (3, 3) for row in rows)
    assert [row.time for row in rows if row] == [pytest.approx(i / 125.0) for i in range(4, TICKS, 5)]
    with pytest.raises(BlockingIOError):
        page.recv(1)
    assert run.dropped == 0


def test_what_is_not_in_the_record_is_shown_too() -> None:
    run, page = feed(every=1)
    still = np.zeros((2, 3))
    poses = ObstaclePoses(np.full((2, 3), 0.5), np.tile([1.0, 0.0, 0.0, 0.0], (2, 1)), still, still)
    truth = Truth(np.arange(7.0), np.arange(20.0), np.array([0.25, -0.5]))
    run.extras = Extras(obstacles=lambda: poses, truth=lambda: truth)
    run.on_row(record(), 0)
    sizes = announced(page.recv(4096))
    assert (sizes.obstacles, sizes.truth) == (2, 29)
    row = unpack(page.recv(1 << 16), replace(SIZES, obstacles=sizes.obstacles, truth=sizes.truth))
    assert row is not None and np.isnan(row.current).all(), "current is not known"
    np.testing.assert_array_equal(row.obstacle_poses, [[0.5, 0.5, 0.5, 1.0, 0.0, 0.0, 0.0]] * 2)
    np.testing.assert_array_equal(row.truth, truth.numbers())


def test_a_page_that_takes_nothing_costs_nothing() -> None:
    run, page = feed(every=1)
    whole = record()
    for _ in range(100):
        for row in range(TICKS):
            run.on_row(whole, row)
    assert run.dropped > 4000
    page.close()
    run.on_row(whole, 0)
    assert not run.stop_asked(), "a page that is gone does not stop the robot"


def test_the_end_is_shown_also_where_no_row_was_sent_for_it() -> None:
    run, page = feed()
    with run:
        run.extras = Extras(words=lambda: ("following", ""))
        run.on_row(record(), 3)
        run.extras = Extras(words=lambda: ("stopped", "the bus is dead"))
    announced(page.recv(4096))
    row = unpack(page.recv(1 << 16), SIZES)
    assert row is not None and (row.state, row.why) == ("stopped", "the bus is dead")
    assert page.recv(1) == b""


def test_a_page_that_hangs_is_ended_with_the_run() -> None:
    process = FakeProcess(hangs=True)
    with feed(process=process)[0]:
        pass
    assert process.killed


def test_whatever_is_shown_last_is_not_lost_with_the_link() -> None:
    run, page = feed(every=1)
    whole, shown = record(), list[float]()
    for row in range(3):
        run.on_row(whole, row)
    page.recv(4096)
    run._link.close()
    page.setblocking(True)
    _serve(page, cast(Any, SimpleNamespace(show=lambda row: shown.append(row.time))), SIZES)
    assert shown == [pytest.approx(2 / 125.0)]


def test_it_can_only_stop_and_stays_so() -> None:
    run, page = feed()
    assert not run.stop_asked()
    page.send(b"go")
    page.send(b"")
    assert not run.stop_asked() and not run.stop_asked()
    page.send(STOP)
    assert run.stop_asked() and run.stop_asked()


def test_the_process_of_a_page_opens_and_ends_with_the_run() -> None:
    human = build_human(dimensions(performer()))
    setup = PageSetup("a <b>run</b>", 0, str(op3().profile.path), "", "table", human.mjcf)
    with open_feed(setup, rate_hz=125.0) as run:
        assert run.address.startswith("http://127.0.0.1:")
        port = int(run.address.split(":")[2].split("/")[0])
        with refuses(ConfigError):
            open_feed(PageSetup("", port, "", "", "", human.mjcf), rate_hz=125.0)
        process = run._process
    assert process.wait(timeout=20.0) == 0


def test_what_the_page_cannot_show_is_refused() -> None:
    human = build_human(dimensions(performer())).mjcf
    with refuses(ConfigError):
        open_feed(PageSetup("", 0, "unknown", "", "", human), rate_hz=125.0)


VIEW_WIRE_SIZES = RowSizes(robot=27, human=55, servos=20, landmarks=6, observers=21, obstacles=2, truth=29, sensors=5)


def row(*, state: str = "following", why: str = "") -> LiveRow:
    random = np.random.default_rng(7)
    return LiveRow(
        12.5,
        state,
        why,
        random.normal(size=27),
        random.normal(size=55),
        random.normal(size=20),
        random.uniform(20.0, 70.0, 20),
        random.uniform(0.0, 2.3, 20),
        np.vstack([random.normal(size=(5, 3)), np.full((1, 3), np.nan)]),
        random.integers(0, 3, 21).astype(np.uint8),
        random.normal(size=(2, 7)),
        random.normal(size=29),
        np.vstack([random.normal(size=(4, 3)), np.full((1, 3), np.nan)]),
    )


def test_a_row_arrives() -> None:
    sent = row(why="the performer stands behind a pillar")
    got = unpack(pack(sent), VIEW_WIRE_SIZES)
    assert got is not None
    assert (got.time, got.state, got.why) == (sent.time, sent.state, sent.why)
    for name in [one.name for one in fields(LiveRow)][3:]:
        np.testing.assert_allclose(getattr(got, name), getattr(sent, name), atol=1e-5)


@given(st.text(max_size=400))
def test_a_text_of_any_length_fits(words: str) -> None:
    got = unpack(pack(row(state=words, why=words)), VIEW_WIRE_SIZES)
    assert got is not None
    assert words.startswith(got.state) and words.startswith(got.why)
    if len(words.encode()) <= 48 and not words.endswith("\0"):
        assert got.state == got.why == words


@given(st.binary(max_size=2000))
def test_anything_else_is_no_row(data: bytes) -> None:
    whole = len(pack(row()))
    assert (unpack(data, VIEW_WIRE_SIZES) is None) == (len(data) != whole)
    assert unpack(pack(row())[:-1], VIEW_WIRE_SIZES) is None
