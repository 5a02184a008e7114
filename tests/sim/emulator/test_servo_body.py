"""The common part of emulated servos of both protocols: start, power, what is kept without power, load."""

from collections.abc import Callable

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from emulated import servo1, servo2
from sim.emulator.servo1 import EmulatedServo1
from sim.emulator.servo2 import EmulatedServo

Make = Callable[[], EmulatedServo | EmulatedServo1]
both = pytest.mark.parametrize("make", [servo2, servo1])


@both
@settings(max_examples=30)
@given(
    goal=st.integers(0, 4095),
    times=st.lists(st.floats(0.0, 3.0), max_size=12),
)
def test_how_often_one_looks_changes_no_motion(make: Make, goal: int, times: list[float]) -> None:
    watched, left = make(), make()
    for servo in (watched, left):
        servo.write(24 if servo.protocol == 1 else 64, b"\1", 0.0)
        size = 2 if servo.protocol == 1 else 4
        servo.write(30 if servo.protocol == 1 else 116, goal.to_bytes(size, "little"), 0.0)
    for now in (*sorted(times), 3.0):
        watched.catch_up(now)
    left.catch_up(3.0)
    assert watched.shaft.position == pytest.approx(left.shaft.position, abs=1e-3)
    assert left.shaft.position == pytest.approx(goal, abs=0.5)


@both
def test_power_is_there_only_when_nothing_takes_it(make: Make) -> None:
    servo = make()
    servo.power_cut(1.0)
    assert servo.booting(1e9) and servo.electrics.current == 0.0
    servo.supply(3.0, 2.0)  # a brown-out as well
    servo.power_back(3.0)
    assert servo.booting(1e9)
    servo.supply(12.0, 4.0)
    assert servo.booting(4.1) and not servo.booting(4.0 + servo.boot_time)
    servo.power_back(5.0)  # it has power: nothing happens
    servo.supply(11.0, 5.0)
    assert not servo.booting(5.0)
