"""An emulated 2.0 servo: access rules, torque, modes, errors."""

import pytest

from emulated import answered, servo2, shown, told
from hardware.dynamixel.packets import ALERT, Error2, Instruction
from hardware.servo import SERVO_MODELS
from sim.emulator.device import Device, Faulty


def speaks(device: Device) -> None:
    assert device.protocol == 2 and not device.booting(0.0)


def hurts(device: Faulty) -> None:
    device.load(0.0, 0.0)


@pytest.mark.parametrize("model", [name for name, model in SERVO_MODELS.items() if 2 in model.protocols])
def test_every_model_moves_to_its_goal(model: str) -> None:
    servo = servo2(model)
    speaks(servo)
    hurts(servo)
    assert told(servo, "torque_enable", 1) == 0
    assert told(servo, "goal_position", 2100) == 0
    assert shown(servo, "present_position", 2.0) == 2100
    assert shown(servo, "model_number") == servo.number == servo.table.number


def test_eeprom_is_locked_while_torque_is_on() -> None:
    servo = servo2()
    assert told(servo, "id", 9) == 0 and servo.id == 9
    told(servo, "torque_enable", 1)
    assert told(servo, "id", 10) == Error2.ACCESS and servo.id == 9
    told(servo, "torque_enable", 0)
    assert told(servo, "id", 253) == Error2.DATA_RANGE and servo.id == 9


@pytest.mark.parametrize(
    ("address", "data", "error"),
    [
        (132, bytes(4), Error2.ACCESS),  # read only
        (66, bytes(1), Error2.ACCESS),  # a hole
        (660, bytes(4), Error2.ACCESS),  # beyond the end
        (117, bytes(3), Error2.ACCESS),  # not where a register begins
        (116, bytes(3), Error2.DATA_LENGTH),
        (116, b"", Error2.DATA_LENGTH),
        (116, (4096).to_bytes(4, "little"), Error2.DATA_LIMIT),
        (116, (-1).to_bytes(4, "little", signed=True), Error2.DATA_LIMIT),
        (116, (1048576).to_bytes(4, "little"), Error2.DATA_RANGE),
        (104, (201).to_bytes(4, "little"), Error2.DATA_LIMIT),
        (11, bytes((2,)), Error2.DATA_RANGE),
        (10, bytes((2,)), Error2.DATA_RANGE),
        (98, bytes((0x80,)), Error2.DATA_RANGE),
        (104, bytes(12) + (4096).to_bytes(4, "little"), Error2.DATA_LIMIT),
    ],
)
def test_a_bad_write_changes_nothing(address: int, data: bytes, error: Error2) -> None:
    servo = servo2()
    told(servo, "goal_velocity", 7)
    before = bytes(servo.memory.image)
    answer = answered(servo, Instruction.WRITE, address.to_bytes(2, "little") + data)
    assert answer == (error, b"")
    servo.write(address, data, 0.0)
    assert bytes(servo.memory.image) == before


def test_reads_across_holes_and_beyond_the_end() -> None:
    servo = servo2()
    assert len(servo.read(0, 147, 0.0).data) == 147
    assert servo.read(66, 2, 0.0) == (Error2.ACCESS, b"")
    assert servo.read(650, 13, 0.0) == (Error2.ACCESS, b"")
    assert servo.read(116, 0, 0.0) == (Error2.DATA_LENGTH, b"")


def test_torque_on_goes_to_the_old_goal() -> None:
    servo = servo2(position=1000.0)
    told(servo, "goal_position", 3000)
    assert shown(servo, "present_position", 1.0) == 1000
    told(servo, "torque_enable", 1, 1.0)
    assert shown(servo, "present_position", 3.0) == 3000


def test_a_goal_switches_torque_on_in_that_drive_mode_only() -> None:
    for mode, torque in ((0, 0), (8, 1)):
        servo = servo2()
        told(servo, "drive_mode", mode)
        servo.write(116, (2100).to_bytes(4, "little"), 0.0)
        assert shown(servo, "torque_enable") == torque


def test_a_new_mode_resets_gains_profile_and_goals() -> None:
    servo = servo2()
    for name, value in (("position_p_gain", 100), ("profile_velocity", 9), ("goal_pwm", 3), ("goal_current", 4)):
        told(servo, name, value)
    told(servo, "operating_mode", 3)
    assert shown(servo, "position_p_gain") == 100  # the same mode
    told(servo, "operating_mode", 5)
    names = ("position_p_gain", "profile_velocity", "goal_pwm", "goal_current")
    assert [shown(servo, name) for name in names] == [800, 0, 885, 1193]


def test_many_turns_and_the_way_back_to_one() -> None:
    servo = servo2(position=1000.0)
    told(servo, "operating_mode", 4)
    told(servo, "torque_enable", 1)
    assert told(servo, "goal_position", 10000) == 0
    assert shown(servo, "present_position", 20.0) == 10000
    assert answered(servo, Instruction.CLEAR, bytes.fromhex("0144584c22"), 20.0) == (0, b"")
    assert shown(servo, "present_position", 21.0) == 10000 - 2 * 4096 == shown(servo, "goal_position", 21.0)
    told(servo, "goal_position", 10000, 21.0)
    assert answered(servo, Instruction.CLEAR, bytes.fromhex("0144584c22"), 22.0).error == Error2.RESULT_FAIL
    shown(servo, "present_position", 40.0)
    told(servo, "torque_enable", 0, 40.0)
    told(servo, "operating_mode", 3, 40.0)
    assert shown(servo, "present_position", 40.0) == 10000 - 2 * 4096
    assert shown(servo, "goal_position", 40.0) == 4095  # pulled inside its limits


def test_reverse_mode_mirrors_and_the_offset_keeps_its_sign() -> None:
    servo = servo2(position=1000.0)
    told(servo, "homing_offset", 100)
    assert shown(servo, "present_position") == 1100
    told(servo, "drive_mode", 1)
    assert shown(servo, "present_position") == 4096 - 1000 + 100
    told(servo, "homing_offset", 1025)  # ignored in mode 3
    assert shown(servo, "present_position") == 4096 - 1000
    told(servo, "operating_mode", 4)
    assert shown(servo, "present_position") == 4096 - 1000 + 1025


def test_an_error_latches_until_reboot() -> None:
    servo = servo2()
    told(servo, "torque_enable", 1)
    servo.heat(81.0, 1.0)
    assert shown(servo, "hardware_error_status", 1.0) == 4 and shown(servo, "torque_enable", 1.0) == 0
    servo.heat(None, 2.0)
    assert told(servo, "torque_enable", 1, 2.0) == ALERT | Error2.RESULT_FAIL
    assert answered(servo, Instruction.PING, b"", 2.0).error == ALERT
    assert answered(servo, Instruction.REBOOT, b"", 2.0).error == ALERT
    assert servo.booting(2.1) and not servo.booting(2.21)
    assert servo.execute(Instruction.PING, b"", 2.1, broadcast=False) is None
    assert told(servo, "torque_enable", 1, 2.3) == 0


def test_an_error_outside_the_mask_only_alerts() -> None:
    servo = servo2()  # shutdown 52: voltage is not in it
    told(servo, "torque_enable", 1)
    servo.supply(9.0, 1.0)
    assert servo.read(64, 1, 1.0) == (ALERT, b"\1")
    servo.shock(2.0)
    assert servo.read(70, 1, 2.0) == (ALERT, b"\x11") and shown(servo, "torque_enable", 2.0) == 0


def test_a_jam_overloads_after_a_while() -> None:
    servo = servo2()
    told(servo, "torque_enable", 1)
    servo.jam(True, 0.0)
    told(servo, "goal_position", 3000)
    seen = [shown(servo, "hardware_error_status", 0.05 * step) for step in range(41)]
    assert seen[10] == 0 and seen[-1] == 0x20
    assert shown(servo, "present_position", 2.1) == 2048


def test_a_brown_out_loses_the_ram() -> None:
    servo = servo2()
    told(servo, "position_p_gain", 100)
    told(servo, "torque_enable", 1)
    servo.supply(3.0, 1.0)
    assert servo.booting(100.0)
    servo.supply(None, 100.0)
    assert servo.booting(100.1) and not servo.booting(100.3)
    assert shown(servo, "torque_enable", 100.3) == 0 and shown(servo, "position_p_gain", 100.3) == 800


def test_what_a_servo_kept_moves_into_another_one() -> None:
    servo = servo2(position=1234.0)
    told(servo, "id", 7)
    other = servo2()
    other.restore(servo.keep(), 5.0)
    assert other.id == 7 and other.booting(5.1) and shown(other, "present_position", 5.3) == 1234


def test_a_multi_register_write_with_a_profile_in_it() -> None:
    servo = servo2()
    told(servo, "torque_enable", 1)
    data = (10).to_bytes(4, "little") + (50).to_bytes(4, "little") + (3000).to_bytes(4, "little")
    servo.write(108, data, 0.0)
    assert shown(servo, "moving_status", 0.2) & 0x32 == 0x32
    speeds = [shown(servo, "velocity_trajectory", 0.05 * step) for step in range(100)]
    assert max(speeds) == 50 and speeds[-1] == 0 and shown(servo, "present_position", 6.0) == 3000
