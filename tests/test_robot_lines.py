"""The lines of a robot: its servos where it stands, its controller, its power switch."""

from hardware.dynamixel import protocol2
from retarget.cli.buses import standing_ticks
from retarget.robot_body import load_robot
from sim.emulator.line import Line
from sim.emulator.robot_lines import robot_lines
from sim.emulator.wire import Timing

ROBOT = load_robot("op3")


def _line(powered: bool) -> Line:
    lines = robot_lines(
        ROBOT.joint_map.servos,
        ROBOT.profile.bus_specs(),
        start=standing_ticks(ROBOT),
        now=5.0,
        timing=Timing.none(),
        powered=powered,
    )
    assert list(lines) == ["main"]
    return lines["main"]


def _ask(line: Line, data: bytes, now: float) -> bytes:
    line.hear(data, now)
    return line.take(now)


def test_servos_stand_and_everybody_answers() -> None:
    line = _line(powered=True)
    assert [device.id for device in line.devices] == [*(servo.id for servo in ROBOT.joint_map.servos), 200]
    for servo, tick in zip(ROBOT.joint_map.servos, standing_ticks(ROBOT), strict=True):
        status = protocol2.status(servo.id, 0, int(tick).to_bytes(4, "little", signed=True))
        assert _ask(line, protocol2.read(servo.id, 132, 4), 5.0) == status


def test_without_power_only_the_switch_answers_until_it_is_on() -> None:
    line = _line(powered=False)
    assert _ask(line, protocol2.ping(1), 5.0) == b""
    assert _ask(line, protocol2.write(200, 24, b"\x01"), 5.0) == protocol2.status(200)
    assert _ask(line, protocol2.ping(1), 5.01) == b""
    assert len(_ask(line, protocol2.ping(1), 6.0)) == 14
