"""A bus on which nobody is understood is given up at once; a rough one stops the robot while it can brake."""

from dataclasses import replace

import numpy as np
import pytest

from guard_rig import DT, MAP, Rig
from hardware.bus import ServoStates
from hardware.guard_state import GuardState, StopCause
from hardware.joint_map import JointMap
from hardware.line_health import DEAF_CYCLES, DEAF_S, MOST_ROUGH, LineHealth
from sim.mock_faults import FaultKind, MockFault
from support.messages import shows


@pytest.fixture
def states() -> ServoStates:
    return Rig().bus.read()


def silent(states: ServoStates, age: float, who: slice = slice(None)) -> ServoStates:
    valid, ages = states.valid.copy(), states.age.copy()
    valid[who], ages[who] = False, age
    return replace(states, valid=valid, age=ages)


def test_a_deaf_bus_is_lost_after_some_cycles_and_some_time(states: ServoStates) -> None:
    health = LineHealth(MAP)
    for _ in range(DEAF_CYCLES - 1):
        assert health.lost(silent(states, 9.0)) is None  # the host may have been held up
    found = health.lost(silent(states, 2.0 * DEAF_S))
    assert found is not None and "bus" in found
    assert health.lost(silent(states, 0.5 * DEAF_S)) is None
    assert health.lost(states) is None
    assert health.lost(silent(states, 9.0)) is None  # it was heard in between


def test_one_servo_that_answers_keeps_a_bus(states: ServoStates) -> None:
    health = LineHealth(MAP)
    assert all(health.lost(silent(states, 9.0, slice(1, None))) is None for _ in range(50))


def test_a_servo_alone_on_its_bus_is_left_to_its_age(states: ServoStates) -> None:
    servos = [replace(servo, bus=str(place)) for place, servo in enumerate(MAP.servos)]
    health = LineHealth(JointMap(servos))
    assert all(health.lost(silent(states, 9.0)) is None for _ in range(50))


def test_what_was_never_heard_is_not_lost(states: ServoStates) -> None:
    health = LineHealth(MAP)
    assert all(health.lost(silent(states, np.inf)) is None for _ in range(50))


def test_a_rough_line_is_told(states: ServoStates) -> None:
    health = LineHealth(MAP)
    assert health.rough(replace(states, rough=MOST_ROUGH - 0.01)) is None
    shows(health.rough(replace(states, rough=0.75)))


def test_the_guard_cuts_when_a_bus_is_deaf() -> None:
    rig = Rig(*(MockFault(FaultKind.MISSING, first=20, cycles=1000, servo=servo) for servo in range(4)))
    rig.guard.arm()
    rig.run(19)
    assert rig.state() is GuardState.MOVING
    rig.run(4)
    assert rig.state() is GuardState.STOPPED
    assert rig.guard.stop_reason is not None and rig.guard.stop_reason.cause is StopCause.BUS
    assert rig.bus.calls[-1] == "torque off"


def test_the_guard_brakes_on_a_rough_line() -> None:
    rig = Rig()
    rig.guard.arm()
    rig.run(30)
    read = rig.bus.read
    rig.bus.read = lambda: replace(read(), rough=0.9)  # type: ignore[method-assign]
    rig.clock.advance(DT)
    rig.guard.tick(rig.faster)
    assert rig.state() is GuardState.STOPPING
    rig.run(100)
    assert rig.state() is GuardState.STOPPED and rig.gate.at_rest
    rig.check_goals()
