"""What the report says of the bus: its clock as it went, and every failure that somebody saw."""

import numpy as np
import pytest

from hardware.bus import ServoStates
from retarget.metrics import bus
from retarget.metrics.measure import measure
from retarget.pipeline import Pipeline
from retarget.report import BusReport
from rig import Rig, StubReconstructor, person, result, short_clip

TICKS = 51


def bus_of(rig: Rig) -> BusReport:
    human, clip = person(), short_clip()
    ending = Pipeline(clip=clip, reconstructor=StubReconstructor(human), robot=rig.side).run()
    found = measure(result(ending, clip, human, rig.robot)).bus
    assert found is not None
    return found


def test_the_rate_is_the_profiles_where_nothing_stalls() -> None:
    found = bus_of(Rig(np.zeros((TICKS, 20))))
    assert found.rate_hz == pytest.approx(125.0) and found.longest_period_ms == pytest.approx(8.0)


def test_a_stall_of_the_bus_shows(monkeypatch: pytest.MonkeyPatch) -> None:
    rig, reads = Rig(np.zeros((TICKS, 20))), 0
    read = rig.bus.read

    def stalling() -> ServoStates:
        nonlocal reads
        reads += 1
        if reads == 20:
            rig.clock.advance(0.05)
        return read()

    monkeypatch.setattr(rig.bus, "read", stalling)
    found = bus_of(rig)
    assert found.rate_hz is not None and 50 / 0.5 < found.rate_hz < 120.0
    assert found.longest_period_ms == pytest.approx(58.0)


def test_what_was_not_measured_is_unknown() -> None:
    for times in (np.zeros(0), np.zeros(1), np.full(3, np.nan), np.zeros(3)):
        assert bus.tick_rate(times) is None
    assert bus.longest_period(np.full(3, np.nan)) is None
    assert bus.tick_rate(np.array([0.0, np.nan, 0.5])) == pytest.approx(2.0)
