"""Real-time priority and a core of its own: given back afterwards, and refused with what to do."""

import os
import re
import threading
from datetime import UTC, datetime

import numpy as np
import pytest

from benchmarks.lateness import DT, Stopwatch, lateness
from hardware.clock import MonotonicClock, PacedClock, TickTiming, VirtualClock, wall_to_monotonic
from hardware.errors import HardwareError
from hardware.realtime import USUAL_PRIORITY, Scheduling, refuse_scheduling, scheduled
from messages import mentions, refuses


def kernel(monkeypatch: pytest.MonkeyPatch, *, error: OSError | None = None) -> list[tuple[int, int]]:
    """A scheduler that permits, or does not, and the policies and priorities that it was given."""
    calls: list[tuple[int, int]] = []

    def schedule(pid: int, policy: int, parameter: os.sched_param) -> None:
        if error is not None and policy & os.SCHED_FIFO:
            raise error
        calls.append((policy, parameter.sched_priority))

    monkeypatch.setattr(os, "sched_setscheduler", schedule)
    return calls


def test_priority_and_core_are_had_and_given_back(monkeypatch: pytest.MonkeyPatch) -> None:
    calls, cores = kernel(monkeypatch), os.sched_getaffinity(0)
    core = min(cores)
    with scheduled(Scheduling(priority=USUAL_PRIORITY, core=core)):
        assert calls == [(os.SCHED_FIFO | os.SCHED_RESET_ON_FORK, USUAL_PRIORITY)]
        assert os.sched_getaffinity(0) == {core}
    assert calls[-1] == (os.sched_getscheduler(0), os.sched_getparam(0).sched_priority)
    assert os.sched_getaffinity(0) == cores


def test_what_is_not_permitted_is_refused_with_how_to_permit_it(monkeypatch: pytest.MonkeyPatch) -> None:
    cores = os.sched_getaffinity(0)
    kernel(monkeypatch, error=PermissionError(1, "Operation not permitted"))
    with pytest.raises(HardwareError) as refused:
        refuse_scheduling(Scheduling(priority=40, core=min(cores)))
    mentions(refused.value, "--realtime: ", "not permitted", "limits.d", "LimitRTPRIO", "leave --realtime out")
    assert os.sched_getaffinity(0) == cores


def test_a_priority_or_a_core_that_does_not_exist_is_refused_and_nothing_asked_changes_nothing() -> None:
    for priority in (0, -1, 100):
        with refuses(HardwareError, "--realtime", 1, 99):
            refuse_scheduling(Scheduling(priority=priority))
    for core in (-1, 1023, 10**12):
        with refuses(HardwareError, "--core", varies=re.compile(r"allowed: [^.]*")):
            refuse_scheduling(Scheduling(core=core))
    before = os.sched_getscheduler(0), os.sched_getaffinity(0)
    with scheduled(Scheduling()):
        assert (os.sched_getscheduler(0), os.sched_getaffinity(0)) == before


def test_only_the_calling_thread_and_none_that_it_starts() -> None:
    """Where it is permitted; elsewhere the refusal is all there is to see."""
    seen: list[int] = []
    try:
        with scheduled(Scheduling(priority=1)):
            thread = threading.Thread(target=lambda: seen.append(os.sched_getscheduler(0)))
            thread.start()
            thread.join()
            mine = os.sched_getscheduler(0) & ~os.SCHED_RESET_ON_FORK
    except HardwareError as error:
        pytest.skip(str(error))
    assert mine == os.SCHED_FIFO and seen == [os.SCHED_OTHER] and os.sched_getscheduler(0) == os.SCHED_OTHER


# Clocks: virtual time jumps, real time does not go back.


def test_virtual_time_moves_only_forward_and_the_monotonic_clock_returns_at_once_when_late() -> None:
    clock = VirtualClock(5.0)
    for deadline in (6.5, 1.0):
        clock.sleep_until(deadline)
        assert clock.now() == 6.5
    clock.advance(0.25)
    assert clock.now() == 6.75
    real = MonotonicClock()
    before = real.now()
    real.sleep_until(before - 1.0)
    real.sleep_until(before + 0.002)
    assert 0.002 <= real.now() - before < 1.0


def test_a_paced_clock_is_never_faster_than_real_time_and_catches_nothing_up() -> None:
    wall = VirtualClock(100.0)
    clock = PacedClock(3.0, wall=wall)
    clock.sleep_until(3.5)
    assert (clock.now(), wall.now()) == (3.5, 100.5), "real time was waited for"
    wall.advance(0.25)
    assert clock.now() == 3.5, "a slow machine changes nothing of what is computed"
    clock.advance(0.0625)
    clock.sleep_until(3.75)
    assert (clock.now(), wall.now()) == (3.75, 100.75), "computing took some of it"
    wall.advance(2.0)
    clock.sleep_until(4.0)
    assert (clock.now(), wall.now()) == (4.0, 102.75)
    clock.sleep_until(4.5)
    assert (clock.now(), wall.now()) == (4.5, 103.25), "two seconds late, and not caught up"


def test_stamps_of_the_wall_clock_come_onto_the_monotonic_one() -> None:
    before = MonotonicClock().now()
    stamp = datetime.now(tz=UTC).timestamp()
    after = MonotonicClock().now()
    assert before - 0.01 <= stamp + wall_to_monotonic() * 1e-9 <= after + 0.01


@pytest.mark.parametrize(
    ("pauses", "behind"),
    [
        ([1.0, 1.3, 1.5, 1.0, 1.5, 1.0], [False] * 6),
        ([1.6, 1.6, 1.6, 1.0, 1.6], [False, True, True, False, False]),
        ([1.4, 1.4, 1.4, 1.0], [False, False, True, False]),
        ([1.3] * 50, [False] * 50),
    ],
)
def test_one_late_tick_is_no_harm_two_are_and_a_little_again_and_again_adds_up(
    pauses: list[float], behind: list[bool]
) -> None:
    timing, now = TickTiming(0.01), 5.0
    assert timing.begin(now) == 0.0
    for pause, expected in zip(pauses, behind, strict=True):
        now += pause * 0.01
        assert timing.begin(now) == pytest.approx(pause * 0.01)
        assert timing.behind == expected


# The benchmark of lateness: what counts as late, and a robot at its rate.


def test_a_deadline_that_was_put_off_counts_from_where_it_would_have_been(monkeypatch: pytest.MonkeyPatch) -> None:
    virtual = VirtualClock()
    monkeypatch.setattr(MonotonicClock, "now", lambda self: virtual.now())
    monkeypatch.setattr(MonotonicClock, "sleep_until", lambda self, deadline: virtual.sleep_until(deadline + 1e-4))
    clock = Stopwatch()
    clock.sleep_until(1.0)
    clock.counting = True
    clock.sleep_until(1.0 + DT)
    virtual.advance(2.5 * DT)
    clock.sleep_until(virtual.now())
    np.testing.assert_allclose(clock.late, [1e-4, 1.5 * DT + 2e-4], atol=1e-9)


def test_percentiles_in_ms_and_whole_periods() -> None:
    found = lateness("live", np.array([*np.full(98, 1e-4), 2e-3, 0.02]))
    assert (found.ticks, found.missed) == (100, 1)
    assert found.p50 == pytest.approx(0.1) and found.longest == pytest.approx(20.0)
