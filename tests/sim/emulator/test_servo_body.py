"""The common part of emulated servos of both protocols: start, power, what is kept without power, load."""

from collections.abc import Callable

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from emulated import servo1, servo2, write_register
from hardware.dynamixel.control_table import find_table
from hardware.servo import find_model
from sim.emulator.power import Supply
from sim.emulator.servo1 import EmulatedServo1
from sim.emulator.servo2 import EmulatedServo
from sim.emulator.servo_body import ServoBody, ServoBuild

Make = Callable[[], EmulatedServo | EmulatedServo1]
both = pytest.mark.parametrize("make", [servo2, servo1])


def test_a_servo_begins_as_it_is_built() -> None:
    supply = Supply()
    build = ServoBuild(1234.0, now=5.0, supply=supply, boot_time=1.5, warmth=40.0)
    servo = ServoBody(find_table("MX-28", 1), find_model("MX-28"), build)
    assert servo.shaft.position == 1234.0 and servo.electrics.warmth == 40.0
    assert not servo.booting(5.0) and servo.started == 5.0
    assert supply.drawn == servo.electrics.current > 0.0
    servo.reboot(6.0)
    assert servo.booting(7.49) and not servo.booting(7.5) and servo.started == 7.5
    other = ServoBody(find_table("MX-28", 1), find_model("MX-28"), ServoBuild(0.0, supply=supply))
    assert supply.drawn == servo.electrics.current + other.electrics.current


@both
def test_settings_come_from_registers(make: Make) -> None:
    servo = make()
    for name, value in (("id", 17), ("return_delay_time", 100), ("status_return_level", 0), ("baud_rate", 1)):
        servo.memory.put(name, value)
    servo.tune()
    assert servo.id == 17 and servo.return_delay == pytest.approx(200e-6) and not servo.answers_reads
    assert servo.baud == {1: 1_000_000, 2: 57_600}[servo.protocol]


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


def test_a_jam_and_its_end_reach_the_shaft() -> None:
    servo = servo2(position=1000.0)
    write_register(servo, "torque_enable", 1)
    servo.jam(True, 0.0)
    write_register(servo, "goal_position", 1500, 0.1)
    servo.catch_up(0.3)
    assert servo.shaft.position == 1000.0
    servo.jam(False, 0.3)
    servo.catch_up(2.0)
    assert servo.shaft.position == pytest.approx(1500.0, abs=0.5)
