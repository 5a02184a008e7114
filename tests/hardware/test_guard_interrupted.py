"""A tick that is torn between filter and bus: what was not sent is sent next, never together with the next."""

from contextlib import suppress

import numpy as np
import pytest

from guard_rig import DT, MAP, Rig
from hardware.arrays import FloatArray, TickArray
from hardware.bus import ServoGoals
from hardware.errors import HardwareError
from hardware.guard_state import GuardState, StopCause


def torn(rig: Rig, monkeypatch: pytest.MonkeyPatch, *ticks: int) -> None:
    """Interrupt instead of writing, the so many times that something is to be written."""
    write, count = rig.bus.write, 0

    def interrupted(goals: ServoGoals) -> None:
        nonlocal count
        count += 1
        if count in ticks:
            raise KeyboardInterrupt
        write(goals)

    monkeypatch.setattr(rig.bus, "write", interrupted)


def fast() -> Rig:
    rig = Rig()
    rig.guard.arm()
    rig.run(20)
    return rig


def longest_step(rig: Rig) -> FloatArray:
    return np.asarray(np.abs(np.diff(rig.bus.goals, axis=0)).max(axis=1))


@pytest.mark.parametrize("ticks", [(1,), (1, 2), (1, 3)])
def test_an_interrupted_write_doubles_no_step(ticks: tuple[int, ...], monkeypatch: pytest.MonkeyPatch) -> None:
    rig = fast()
    torn(rig, monkeypatch, *ticks)
    while rig.guard.active:
        try:
            rig.run(1)
        except KeyboardInterrupt:
            rig.guard.stop("interrupted")
    assert rig.state() is GuardState.STOPPED and rig.gate.at_rest
    np.testing.assert_array_equal(rig.bus.goals[-1], MAP.to_radians(MAP.to_ticks(rig.gate.position)))
    assert longest_step(rig).max() <= 2.0 * DT + 0.002


def test_going_on_after_an_interrupt_doubles_no_step(monkeypatch: pytest.MonkeyPatch) -> None:
    rig = fast()
    torn(rig, monkeypatch, 1)
    with pytest.raises(KeyboardInterrupt):
        rig.run(1)
    rig.run(3)
    assert rig.state() is GuardState.MOVING
    assert longest_step(rig).max() <= 2.0 * DT + 0.002


def test_an_interrupted_brake_on_the_callers_trajectory_doubles_no_step(monkeypatch: pytest.MonkeyPatch) -> None:
    rig = fast()
    rig.guard.stop("space bar")
    torn(rig, monkeypatch, 2)
    asked = 0

    def gently() -> FloatArray:
        nonlocal asked
        asked += 1
        return rig.gate.position + DT * rig.gate.velocity * 0.9

    for _ in range(3):
        rig.clock.advance(DT)
        with suppress(KeyboardInterrupt):
            rig.guard.tick(rig.faster, gently)
    assert asked == 2  # the third tick sends what the second could not
    steps = longest_step(rig)
    assert steps[-1] <= steps[-2] + 0.002


@pytest.mark.parametrize("failures", [1, 2])
def test_a_posture_that_no_servo_takes_doubles_no_step(failures: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """It is tried once more, instead of braking; a filter that still cannot be understood costs the torque."""
    rig = fast()
    to_ticks, written, count = MAP.to_ticks, len(rig.bus.goals), 0

    def once(positions: FloatArray) -> TickArray:
        nonlocal count
        count += 1
        if count <= failures:
            raise HardwareError("beyond the servo's travel")
        return to_ticks(positions)

    monkeypatch.setattr(MAP, "to_ticks", once)
    rig.run(1)
    assert rig.guard.stop_reason is not None and rig.guard.stop_reason.cause is StopCause.FILTER
    assert len(rig.bus.goals) == written + (failures == 1)
    assert rig.bus.torque_on == (failures == 1)
    rig.run(30)
    assert rig.state() is GuardState.STOPPED
    assert longest_step(rig).max() <= 2.0 * DT + 0.002
