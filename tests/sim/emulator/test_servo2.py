"""Instructions of protocol 2.0 to one emulated servo."""

import pytest

from emulated import answered, read_register, servo2, shown, wrote
from hardware.dynamixel.codec import Error2, Instruction
from sim.emulator.servo2 import RESTORE, STORE


def test_a_broadcast_is_obeyed_in_silence() -> None:
    servo = servo2()
    wrote(servo, id=9)
    assert servo.execute(Instruction.WRITE, bytes((65, 0, 1)), 0.0, broadcast=True) is None
    assert read_register(servo, "led") == 1
    assert servo.execute(Instruction.READ, bytes((65, 0, 1, 0)), 0.0, broadcast=True) is None
    servo.execute(Instruction.FACTORY_RESET, b"\xff", 0.0, broadcast=True)
    assert servo.id == 9  # since firmware 42
    old = servo2(firmware=41)
    old.execute(Instruction.FACTORY_RESET, b"\xff", 0.0, broadcast=True)
    servo.execute(Instruction.REBOOT, b"", 0.0, broadcast=True)
    assert old.booting(0.0) and servo.booting(0.0)


def test_a_secondary_id_reaches_the_ram_only() -> None:
    servo = servo2()
    assert servo2().secondary_id is None
    wrote(servo, secondary_id=5)
    assert servo.secondary_id == 5
    for code, params in (
        (Instruction.WRITE, bytes((65, 0, 1))),
        (Instruction.WRITE, bytes((7, 0, 8))),
        (Instruction.REBOOT, b""),
    ):
        assert servo.execute(code, params, 0.0, broadcast=False, secondary=True) is None
    servo.write(7, b"\x08", 0.0, secondary=True)
    assert read_register(servo, "led") == 1 and servo.id == 1 and not servo.booting(0.0)


def test_backup_and_restore() -> None:
    servo = servo2()

    def back_up(what: bytes) -> int:
        return answered(servo, Instruction.CONTROL_TABLE_BACKUP, what).error

    assert back_up(RESTORE) == Error2.RESULT_FAIL
    wrote(servo, startup_configuration=2, velocity_limit=50, position_p_gain=77)
    assert back_up(STORE) == 0 and read_register(servo, "backup_ready") == 1
    wrote(servo, velocity_limit=60, torque_enable=1)
    assert back_up(RESTORE) == Error2.RESULT_FAIL
    wrote(servo, torque_enable=0)
    assert back_up(RESTORE) == 0 and servo.booting(0.1)
    assert shown(servo, 1.0, "velocity_limit", "position_p_gain", "backup_ready") == (50, 77, 1)
    assert answered(servo2(firmware=44), Instruction.CONTROL_TABLE_BACKUP, STORE).error == Error2.INSTRUCTION


@pytest.mark.parametrize(
    ("code", "params", "error"),
    [
        *((code, b"\1\2\3\4", Error2.INSTRUCTION) for code in (0x00, 0x07, 0x55, 0x82, 0x8A, 0xFF)),
        (Instruction.READ, b"\x74\0\4", Error2.DATA_LENGTH),
        (Instruction.WRITE, b"\x74\0", Error2.DATA_LENGTH),
        (Instruction.REG_WRITE, b"", Error2.DATA_LENGTH),
        (Instruction.FACTORY_RESET, b"", Error2.DATA_LENGTH),
        (Instruction.FACTORY_RESET, b"\3", Error2.DATA_RANGE),
        (Instruction.CLEAR, b"\2ERCL", Error2.DATA_RANGE),
        (Instruction.CONTROL_TABLE_BACKUP, b"\3CTRL", Error2.DATA_RANGE),
    ],
)
def test_bad_instructions_and_parameters(code: int, params: bytes, error: Error2) -> None:
    servo = servo2()
    assert answered(servo, code, params).error == error and not servo.booting(0.0)
