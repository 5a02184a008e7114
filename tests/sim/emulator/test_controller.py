"""The emulated OpenCR."""

from emulated import servo2
from hardware.dynamixel.codec import Error2, Instruction
from sim.emulator.controller import ID, NUMBER, EmulatedController


def test_it_switches_the_servos_power() -> None:
    servo = servo2()
    controller = EmulatedController([servo], baud=2_000_000)
    assert (controller.id, controller.baud) == (ID, 2_000_000)
    assert servo.booting(100.0)
    assert controller.execute(Instruction.WRITE, bytes((24, 0, 1)), 100.0, broadcast=False) == (0, b"")
    assert servo.booting(100.1) and not servo.booting(100.3)
    controller.write(24, b"\0", 101.0)
    assert servo.booting(200.0) and controller.read(24, 1, 101.0) == (0, b"\0")


def test_what_it_answers() -> None:
    controller = EmulatedController(baud=1_000_000)
    ping = controller.execute(Instruction.PING, b"", 0.0, broadcast=True)
    assert ping == (0, NUMBER.to_bytes(2, "little") + b"\1")
    for code, params, error in (
        (Instruction.WRITE, bytes((24, 0, 2)), Error2.DATA_RANGE),
        (Instruction.WRITE, bytes((50, 0, 2)), Error2.ACCESS),
        (Instruction.WRITE, bytes((24, 0)), Error2.DATA_LENGTH),
        (Instruction.READ, bytes((24, 0, 1)), Error2.DATA_LENGTH),
        (Instruction.READ, bytes((24, 0, 100, 0)), Error2.ACCESS),
        (Instruction.REBOOT, b"", Error2.INSTRUCTION),
    ):
        assert controller.execute(code, params, 0.0, broadcast=False) == (error, b"")
    controller.supply(10.0, 0.0)
    assert controller.read(50, 1, 0.0).data == b"\x64"
    controller.supply(2.0, 0.0)
    assert controller.booting(1.0)
    controller.supply(None, 1.0)
    assert not controller.booting(1.0)
