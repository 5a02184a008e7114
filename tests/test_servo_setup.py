"""`retarget servo setup` on the emulator: found, shown, asked, written, verified; and what is refused."""

import signal

import pytest

from hardware.dynamixel.packets import Instruction
from hardware.dynamixel.setup_write import write_setting
from servo_lab import ServoLab

BUS = ("--robot", "op3", "--port", "emulator")


@pytest.fixture
def lab(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> ServoLab:
    return ServoLab(monkeypatch, capsys)


def test_id_and_speed_last_and_verified(lab: ServoLab) -> None:
    lab.before = {(13, "baud_rate"): 1}
    words = ("--id", "13", "--new-id", "33", "--baud", "1000000", "--return-delay", "20", "--register", "shutdown=53")
    code, out, err = lab.run("setup", *BUS, *words, typed="y\n")
    assert (code, err) == (0, "") and "57600 baud" in out
    assert "it answers as id 33, protocol 2.0, 1000000 baud" in out
    assert out.index("shutdown") < out.index("  id: 13 -> 33") < out.index("baud_rate: 1 -> 3")
    memory = lab.memory(33)
    assert [memory.value(name) for name in ("baud_rate", "return_delay_time", "shutdown")] == [3, 10, 53]


@pytest.mark.parametrize(
    ("words", "text"),
    [
        (("--id", "254"), "254 is everybody"),
        (("--id", "13", "--new-id", "254"), "254 is everybody"),
        (("--id", "13", "--new-id", "253"), "found 253"),
        (("--id", "13", "--new-id", "14"), "id 14 is taken"),
        (("--id", "13", "--baud", "123456"), "no such baud rate"),
        (("--id", "13", "--return-delay", "600"), "600 us"),
        (("--id", "13", "--register", "shutdown"), "this is no setting"),
        (("--id", "13", "--register", "goal_position=1"), "no such register"),
        (("--id", "13", "--register", "protocol_type=1"), "no such register"),
        (("--id", "13", "--register", "drive_mode=300"), "no such drive_mode"),
        (("--id", "13", "--register", "nothing=1"), "nothing"),
        (("--id", "33"), "no servo answers to id 33"),
        (("--id", "12", "--drive-mode", "1"), "torque is on, and locks the EEPROM"),
    ],
)
def test_refused(words: tuple[str, ...], text: str, lab: ServoLab) -> None:
    lab.before = {(12, "torque_enable"): 1}
    code, _, err = lab.run("setup", *BUS, *words, "--yes")
    assert code == 2 and text in err and Instruction.WRITE not in lab.instructions()


@pytest.mark.parametrize(("words", "typed"), [((), "n\n"), (("--dry-run",), "")])
def test_nothing_is_written_without_a_yes(words: tuple[str, ...], typed: str, lab: ServoLab) -> None:
    code, out, _ = lab.run("setup", *BUS, "--id", "13", "--drive-mode", "1", *words, typed=typed)
    assert code == 0 and "drive_mode: 0 -> 1" in out and Instruction.WRITE not in lab.instructions()


def test_ctrl_c_ends_after_the_value_that_is_written(lab: ServoLab, monkeypatch: pytest.MonkeyPatch) -> None:
    def interrupted(*arguments: object) -> object:
        signal.raise_signal(signal.SIGINT)
        return write_setting(*arguments)  # type: ignore[arg-type]

    monkeypatch.setattr("retarget.cli.servo.setup.write_setting", interrupted)
    code, _, err = lab.run("setup", *BUS, "--id", "13", "--drive-mode", "1", "--new-id", "33", "--yes")
    assert code == 1 and "written: drive_mode; not written: id" in err
    assert lab.memory(13).value("drive_mode") == 1
