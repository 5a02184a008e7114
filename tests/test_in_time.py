"""Ticks in time where no robot keeps it."""

import pytest

from hardware.clock import VirtualClock
from retarget.cli.in_time import in_time


def test_without_a_robot_ticks_come_in_time_too() -> None:
    clock, looked = VirtualClock(), list[float]()

    def look() -> bool:
        looked.append(clock.now())
        if len(looked) == 3:
            clock.advance(0.025)
        return False

    timed = in_time(look, 0.01, clock)
    for _ in range(5):
        timed()
    assert looked == pytest.approx([0.01, 0.02, 0.03, 0.055, 0.065])
