"""The lines of a robot: its servos where it stands, its controller, its power switch."""

from dataclasses import replace

import numpy as np
import pytest

import more_frames
from bus_rig import four_servos
from hardware.bus import BusSpec
from hardware.dynamixel.codec import protocol2
from hardware.errors import HardwareError
from hardware.servo import ServoMode
from messages import refuses
from retarget.cli.buses import posture_ticks
from retarget.model.robot import load_robot
from sim.emulator.conversation import Conduct
from sim.emulator.line import Line, LineTiming
from sim.emulator.robot_lines import devices_of, robot_lines
from sim.emulator.servo1 import EmulatedServo1
from sim.emulator.servo2 import EmulatedServo
from sim.emulator.servo2_registers import FedBy

WATCHDOG, TORQUE, MISSING = 98, 64, 77


def _line(conduct: Conduct | None) -> Line:
    """Servos 1, 2 and 3, XM430 of protocol 2.0."""
    servos = four_servos()[:3]
    bus = BusSpec("main", "port", 1_000_000, 2, ids=(1, 2, 3))
    start = np.array([servo.zero_tick for servo in servos])
    lines = robot_lines(servos, (bus,), start=start, now=0.0, timing=LineTiming.none(), conduct=conduct)
    return lines["main"]


def _answer(line: Line, data: bytes, now: float) -> bytes:
    line.receive(data, now)
    return line.take(now)


@pytest.mark.parametrize(
    ("fed_by", "packet", "feeds"),
    [
        (FedBy.ANY, protocol2.ping(2), True),
        (FedBy.OWN, protocol2.ping(2), False),
        (FedBy.OWN, protocol2.ping(1), True),
        (FedBy.OWN, protocol2.sync_write(116, 4, [(2, bytes(4))]), True),
        (FedBy.OWN, protocol2.write(200, 25, b"\0"), True),  # its secondary id
    ],
)
def test_a_frame_feeds_the_bus_watchdog_of_its_servo_or_of_any(fed_by: FedBy, packet: bytes, feeds: bool) -> None:
    line = _line(Conduct(fed_by=fed_by))
    for address, value in ((12, 200), (WATCHDOG, 5), (TORQUE, 1)):
        assert _answer(line, protocol2.write(1, address, bytes((value,))), 0.0) == protocol2.status(1)
    for step in range(1, 11):
        _answer(line, packet, 0.05 * step)
    trip = protocol2.status(1, 0, b"\x05" if feeds else b"\xff")
    assert _answer(line, more_frames.read(1, WATCHDOG, 1), 0.55) == trip


@pytest.mark.parametrize("powered", [True, False])
def test_the_servos_of_a_robot_stand_and_answer_once_its_switch_is_on(powered: bool) -> None:
    robot = load_robot("op3")
    servos, start = robot.joint_map.servos, posture_ticks(robot)
    lines = robot_lines(
        servos, robot.profile.bus_specs(), start=start, now=5.0, timing=LineTiming.none(), powered=powered
    )
    (line,) = lines.values()
    assert list(lines) == ["main"] and [device.id for device in line.devices] == [*(one.id for one in servos), 200]
    if not powered:
        assert _answer(line, protocol2.ping(1), 5.0) == b""
        assert _answer(line, protocol2.write(200, 24, b"\x01"), 5.0) == protocol2.status(200)
        assert _answer(line, protocol2.ping(1), 5.01) == b""
    for servo, tick in zip(servos, start, strict=True):
        status = protocol2.status(servo.id, 0, int(tick).to_bytes(4, "little", signed=True))
        assert _answer(line, more_frames.read(servo.id, 132, 4), 6.0) == status


def test_devices_are_as_the_profile_says_or_refused() -> None:
    x_series, ax = four_servos()[0], replace(four_servos()[3], bus="old")
    wound = replace(x_series, id=8, mode=ServoMode.EXTENDED_POSITION, homing_offset=2000)
    first, second, third = devices_of(
        (x_series, wound, ax),
        protocols={"main": 2, "old": 1},
        bauds={"main": 4_000_000, "old": 1_000_000},
        return_delays={"main": 0},
        start=(1000, 9000, 300),
    )
    assert isinstance(first, EmulatedServo) and isinstance(third, EmulatedServo1)
    assert [device.id for device in (first, second, third)] == [x_series.id, 8, ax.id]
    assert [device.baud for device in (first, third)] == [4_000_000, 1_000_000]
    assert [device.return_delay for device in (first, third)] == [0.0, 500e-6]
    assert [device.shaft.position for device in (first, second, third)] == [1000.0, 9000.0, 300.0]
    assert second.memory.value("goal_position") == 9000 and second.memory.value("operating_mode") == 4
    assert first.electrics.voltage == second.electrics.voltage < 12.0
    with refuses(HardwareError, 4500000):
        devices_of(four_servos()[3:], protocols={"main": 1}, bauds={"main": 4_500_000})
    with refuses(HardwareError):
        devices_of(four_servos()[3:], protocols={"main": 2})
