"""The benchmark of lateness: what counts as late, and a robot at its rate."""

import numpy as np
import pytest

from benchmarks.lateness import DT, Stopwatch, lateness
from hardware.clock import MonotonicClock, VirtualClock


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
