"""A page that hangs, is stopped, or is dead changes nothing of a run: on virtual time it is equal bit for bit."""

import os
import signal
from contextlib import suppress

import numpy as np
import pytest

from hardware.clock import VirtualClock
from retarget.cli.exit import StopRequest
from retarget.cli.operator import RunOperator
from retarget.cli.view import opened_page, viewing
from retarget.human.samples import Playback
from retarget.run.loop import RowObserver
from retarget.run.options import RunOptions
from retarget.run.prepare import prepare
from retarget.run.record import Record
from retarget.web.feed import ViewFeed
from sim.mock_bus import mock_bus
from sim.performer import synthetic_performer

pytest.importorskip("websockets", reason="the extra view is not installed")

SAME = (
    *("human_q", "human_joints", "sensors", "q", "goals", "goal_ticks", "present", "landmarks_asked"),
    *("observer_modes", "gated", "phase", "time"),
)
"""The fields that are compared: of the rest some are measured times."""
HURT_AT = 40
"""The row after which something happens to the page: rows have been shown by then."""


def run(*, port: int | None, hurt: signal.Signals | None = None) -> tuple[Record, int]:
    """A second of the performer on virtual time, and how many moments the page did not take. hurt: a signal to the
    process of the page."""
    options, feeds = RunOptions(robot="op3", playback=Playback(end=1.0)), list[ViewFeed]()
    with (
        prepare(synthetic_performer, options, clock=VirtualClock(), make_bus=mock_bus) as prepared,
        opened_page(port, options, notify=lambda text: None) as feed,
        viewing(feed, prepared, options, notify=lambda text: None) as page,
    ):
        if feed is not None:
            feed._every = 1  # so that what the page does not take is more than fits between the two

        def hurting(record: Record, row: int) -> None:
            if row == HURT_AT and feed is not None:
                feeds.append(feed)
                if hurt is not None:
                    os.kill(feed.process, hurt)

        operator = RunOperator(prepared, StopRequest(), page=feed)
        record = prepared.run(operator, [RowObserver(hurting), page]).record
        for one in feeds:  # else closing it would wait for a process that cannot end
            with suppress(ProcessLookupError):
                os.kill(one.process, signal.SIGKILL)
    return record, sum(one.dropped for one in feeds)


@pytest.fixture(scope="module")
def alone() -> Record:
    return run(port=None)[0]


@pytest.mark.long
@pytest.mark.parametrize(("hurt", "least_dropped"), [(None, 0), (signal.SIGSTOP, 10), (signal.SIGKILL, 100)])
def test_goals_and_all_else_are_equal_bit_for_bit(
    alone: Record, hurt: signal.Signals | None, least_dropped: int
) -> None:
    record, dropped = run(port=0, hurt=hurt)
    assert dropped >= least_dropped, "the page was hurt"
    assert len(record) == len(alone) > 150
    for name in SAME:
        np.testing.assert_array_equal(record.known[name], alone.known[name], err_msg=name)
