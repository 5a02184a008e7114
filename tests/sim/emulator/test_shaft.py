"""The shaft of an emulated servo: profiles, control laws, limits, loads; its law is that of the mock bus."""

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bus_rig import specs
from emulated import read_register, servo2, wrote
from hardware.bus import ServoGoals
from hardware.clock import VirtualClock
from hardware.dynamixel.codec import Error2, Instruction
from hardware.dynamixel.opencr import ID, NUMBER
from sim.emulator.controller import EmulatedController
from sim.emulator.power import ServoElectrics, Supply
from sim.emulator.robot_lines import devices_of
from sim.emulator.shaft import ProfilePath, Shaft, path_by_time, path_by_velocity
from sim.mock_bus import MockBus
from sim.servo_model import IDLE_CURRENT, LARGEST_CURRENT, SUPPLY_RESISTANCE


def test_the_plain_case_is_the_mock_bus() -> None:
    count, servos = 4, specs(4)
    clock, rng = VirtualClock(), np.random.default_rng(5)
    mock, devices = MockBus(servos, clock), devices_of(servos, protocols={"main": 2})
    mock.open()
    mock.write(ServoGoals(np.full(count, 2048)))
    mock.torque(True)
    for device in devices:
        assert device.write(64, b"\1", 0.0) is None
    goals = np.full(count, 2048)
    for cycle in range(400):
        jump = rng.integers(0, 4096, count)
        goals = jump if cycle % 50 == 0 else np.clip(goals + rng.integers(-30, 31, count), 0, 4095)
        mock.write(ServoGoals(goals))
        for device, goal in zip(devices, goals.tolist(), strict=True):
            device.write(116, goal.to_bytes(4, "little"), clock.now())
        clock.advance(0.008)
        replies = [device.read(132, 4, clock.now()).data for device in devices]
        positions = [int.from_bytes(data, "little", signed=True) for data in replies]
        assert np.abs(mock.read().position - positions).max() <= 1


def test_the_stepped_motion_is_near_the_exact_one() -> None:
    exact, stepped = (Shaft(0.0, 3000.0) for _ in range(2))
    for shaft in (exact, stepped):
        shaft.torque, shaft.target = True, 500.0
        shaft.integral = 0.0 if shaft is exact else 1e-12  # enough to leave the plain case
        shaft.refresh()
    for _ in range(40):
        for shaft in (exact, stepped):
            shaft.advance(shaft.time + 0.01)
        assert stepped.position == pytest.approx(exact.position, abs=6.0)
    assert stepped.position == pytest.approx(exact.position, abs=0.1)


@pytest.mark.parametrize(
    ("registers", "volts", "share", "pwm"),
    [({"goal_pwm": 177}, None, 0.2, 177), ({}, 10.0, 10.0 / 12.0, 885), ({"position_p_gain": 0}, None, 0.0, 0)],
)
def test_goal_pwm_supply_and_gain_slow_a_servo_down(
    registers: dict[str, int], volts: float | None, share: float, pwm: int
) -> None:
    servo = servo2(position=0.0)
    servo.supply(volts, 0.0)
    wrote(servo, **registers, torque_enable=1, goal_position=4000)
    assert read_register(servo, "present_position", 1.0) == pytest.approx(share * servo.top, abs=2)
    assert read_register(servo, "present_pwm", 1.0) == pwm


def test_goal_current_gives_way_in_mode_5() -> None:
    servo = servo2()
    wrote(servo, operating_mode=5, goal_current=100, torque_enable=1)  # 0.27 A
    servo.jam(True, 0.0)
    wrote(servo, goal_position=2500)
    assert read_register(servo, "present_current", 1.0) == pytest.approx(100, abs=12)
    servo.jam(False, 1.0)
    assert read_register(servo, "present_position", 10.0) == 2500
    wrote(servo, 10.0, goal_current=30, goal_position=3000)  # less than friction takes
    assert read_register(servo, "present_position", 12.0) == 2500


def test_velocity_pwm_and_current_modes() -> None:
    servo = servo2()
    wrote(servo, operating_mode=1, torque_enable=1, goal_velocity=-100)
    assert read_register(servo, "present_velocity", 1.0) == -100
    assert read_register(servo, "present_position", 61.0) < -4096  # it counts on
    wrote(servo, 61.0, profile_acceleration=1, goal_velocity=100)
    assert -100 < read_register(servo, "present_velocity", 62.0) < 0
    assert read_register(servo, "present_velocity", 80.0) == 100
    servo = servo2()
    wrote(servo, operating_mode=16, torque_enable=1, goal_pwm=-442)
    assert read_register(servo, "present_velocity", 1.0) == pytest.approx(-0.5 * 46 / 0.229, abs=1)
    wrote(servo, 1.0, torque_enable=0, operating_mode=0)
    wrote(servo, 1.0, torque_enable=1, goal_current=0)
    still = read_register(servo, "present_position", 2.0)
    wrote(servo, 2.0, goal_current=100)
    assert read_register(servo, "present_position", 3.0) > still + 100


_ticks = st.floats(-5000.0, 5000.0)
_speeds = st.floats(-800.0, 800.0)


def continuous(path: ProfilePath, position: float, velocity: float, *, jumps: bool = False, rate: float = 0.0) -> None:
    """The path starts where it should, and positions are what velocities add up to."""
    count = 400
    times = [5.0 + (path.end - 5.0) * index / count for index in range(count + 1)]
    step = (path.end - 5.0) / count
    points = [path.at(time) for time in times]
    assert points[0].position == pytest.approx(position, abs=1e-6) or step == 0.0
    if not jumps and step > 0.0:
        assert points[0].velocity == pytest.approx(velocity, abs=1e-6)
    steepest = max(rate, *(abs(point.acceleration) for point in points))
    fastest = max(abs(point.velocity) for point in points) + 0.5 * steepest * step  # a peak may lie between two points
    for before, after in pairwise(points):
        assert abs(after.position - before.position) <= 1.001 * fastest * step + 1e-6
        assert jumps or abs(after.velocity - before.velocity) <= 1.001 * steepest * step + 1e-6
    assert path.at(path.end).position == path.goal and path.at(path.end + 1.0).velocity == 0.0
    assert path.at(path.end - 1e-9).position == pytest.approx(path.goal, abs=1e-3)


@settings(max_examples=60, deadline=None)
@given(position=_ticks, goal=_ticks, velocity=_speeds, top=st.floats(5.0, 800.0), rate=st.floats(50.0, 5000.0))
def test_by_velocity(position: float, goal: float, velocity: float, top: float, rate: float) -> None:
    path = path_by_velocity(goal, position=position, velocity=velocity, top=top, acceleration=rate, now=5.0)
    continuous(path, position, velocity, rate=rate)
    assert all(abs(path.at(5.0 + 0.01 * k).velocity) <= max(top, abs(velocity)) + 1e-6 for k in range(200))


@settings(max_examples=60, deadline=None)
@given(position=_ticks, goal=_ticks, velocity=_speeds, total=st.floats(0.1, 5.0), share=st.floats(0.05, 1.0))
def test_by_time(position: float, goal: float, velocity: float, total: float, share: float) -> None:
    path = path_by_time(goal, position=position, velocity=velocity, total=total, ramp=share * total, now=5.0)
    continuous(path, position, velocity)
    assert path.end == pytest.approx(5.0 + total)


# Supply, current and heat of emulated servos.


def test_servos_share_a_supply() -> None:
    supply = Supply()
    one, other = (ServoElectrics(supply, 12.0, turn=0.0015, top=3000.0) for _ in range(2))
    one.advance(1.0, 0.0, effort=-1.0, torque=True)
    assert one.current == pytest.approx(IDLE_CURRENT + LARGEST_CURRENT) and one.direction < 0.0
    sag = SUPPLY_RESISTANCE * (2 * IDLE_CURRENT + LARGEST_CURRENT)
    assert other.voltage == pytest.approx(12.0 - sag) and other.supplied == 1.0
    one.draw(0.0)
    assert other.voltage == pytest.approx(12.0 - SUPPLY_RESISTANCE * IDLE_CURRENT)


def test_registers_show_voltage_and_temperature() -> None:
    servo = servo2()
    assert read_register(servo, "present_input_voltage") == 120
    servo.supply(11.1, 0.0)
    servo.heat(55.4, 0.0)
    assert read_register(servo, "present_input_voltage") == 111 and read_register(servo, "present_temperature") == 55
    servo.supply(None, 0.0)
    servo.heat(None, 0.0)
    wrote(servo, shutdown=0, torque_enable=1)  # an overload takes no torque
    servo.jam(True, 0.0)
    wrote(servo, goal_position=4000)
    assert read_register(servo, "present_temperature", 1.0) == 25
    for minute in range(1, 11):
        read_register(servo, "present_temperature", 60.0 * minute)
    assert read_register(servo, "present_temperature", 601.0) > 40


# The emulated OpenCR.


def test_the_controller_switches_the_power_of_servos_and_refuses_the_rest() -> None:
    servo = servo2()
    controller = EmulatedController([servo], baud=2_000_000)
    assert (controller.id, controller.baud) == (ID, 2_000_000)
    assert servo.booting(100.0)
    assert controller.execute(Instruction.WRITE, bytes((24, 0, 1)), 100.0, broadcast=False) == (0, b"")
    assert servo.booting(100.1) and not servo.booting(100.3)
    controller.write(24, b"\0", 101.0)
    assert servo.booting(200.0) and controller.read(24, 1, 101.0) == (0, b"\0")
    controller = EmulatedController(baud=1_000_000)
    ping = controller.execute(Instruction.PING, b"", 0.0, broadcast=True)
    assert ping == (0, NUMBER.to_bytes(2, "little") + b"\2")
    for code, params, error in (
        (Instruction.WRITE, bytes((24, 0, 2)), Error2.DATA_RANGE),
        (Instruction.WRITE, bytes((31, 0, 2)), Error2.ACCESS),
        (Instruction.WRITE, bytes((24, 0)), Error2.DATA_LENGTH),
        (Instruction.READ, bytes((24, 0, 1)), Error2.DATA_LENGTH),
        (Instruction.READ, bytes((24, 0, 100, 0)), Error2.ACCESS),
        (Instruction.REBOOT, b"", Error2.INSTRUCTION),
    ):
        assert controller.execute(code, params, 0.0, broadcast=False) == (error, b"")
    controller.supply(10.0, 0.0)
    assert controller.read(31, 1, 0.0).data == b"\x64"
    controller.supply(2.0, 0.0)
    assert controller.booting(1.0)
    controller.supply(None, 1.0)
    assert not controller.booting(1.0)
