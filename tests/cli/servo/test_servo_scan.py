"""`retarget servo scan` on the emulator: found, missing and wrong servos; nothing is written."""

from collections.abc import Iterable

import pytest

from hardware.dynamixel.codec import Instruction
from hardware.dynamixel.single_requests import FoundServo, OneOff
from messages import shows
from servo_lab import ServoLab
from sim.emulator.faults import Fault, FaultKind


def _row(out: str, device: int) -> str:
    return next(line for line in out.splitlines() if line.split()[2:3] == [str(device)])


OP3 = ("scan", "--robot", "op3", "--port", "emulator")


def test_every_servo_is_found_and_nothing_is_written(lab: ServoLab) -> None:
    code, out, err = lab.run(*OP3)
    assert code == 0
    shows(err)
    assert len(out.splitlines()) == 1 + 1 + 21 and "missing" not in out
    assert _row(out, 13).split() == ["2.0", "2000000", "13", "XM430-W350", "52", "r_knee"]
    shows(_row(out, 200))
    assert lab.instructions() <= {Instruction.PING, Instruction.READ}
    assert lab.bauds[0] == 2_000_000  # the speed of the profile comes first


def test_servos_without_power_a_latched_error_and_a_scan_that_finds_nothing_are_reported(lab: ServoLab) -> None:
    lab.before = {(200, "dynamixel_power"): 0}
    code, out, _ = lab.run(*OP3, "--protocol", "2")
    assert code == 0 and Instruction.WRITE not in lab.instructions()
    shows(out.splitlines()[-1])
    lab.before, lab.faults = {}, [Fault(FaultKind.OVER_TEMPERATURE, ids=(7,), value=95.0)]
    code, out, _ = lab.run("scan", "--port", "emulator", "--baud", "2000000", "--ids", "6-8")
    assert code == 0 and "OVERHEATING" not in _row(out, 8)
    shows(_row(out, 7), "OVERHEATING")
    lab.faults = [Fault(FaultKind.MISSING)]
    code, out, err = lab.run("scan", "--port", "emulator")
    assert (code, out) == (2, "")
    shows(err, "--all")


def test_a_servo_at_an_unusual_speed_is_found_by_a_whole_scan(lab: ServoLab) -> None:
    lab.before = {(2, "baud_rate"): 0}  # 9600 baud
    code, out, err = lab.run(*OP3)
    assert code == 0 and "l_sho_pitch (id 2)" in out and "--all" in err
    code, out, err = lab.run(*OP3, "--all", "--protocol", "2")
    assert (code, err) == (0, "") and "missing" not in out and _row(out, 2).split()[1] == "9600"


def test_missing_unknown_fast_and_wrong_servos_are_reported(lab: ServoLab) -> None:
    lab.before = {(2, "baud_rate"): 1, (3, "id"): 77}
    lab.faults = [Fault(FaultKind.MISSING, ids=(5,)), Fault(FaultKind.ID_CLASH, ids=(6,))]
    code, out, _ = lab.run(*OP3, "--protocol", "2")
    assert code == 0
    shows(_row(out, 2), 57600, "2.0", 2000000)
    assert _row(out, 77).endswith("unknown") or "unknown" in _row(out, 77)
    shows(_row(out, 6))
    missing = next(line for line in out.splitlines() if line.startswith("missing"))
    assert "id 3" in missing and "id 5" in missing and "id 6" not in missing


@pytest.mark.parametrize(
    ("words", "text"),
    [
        (("--port", "emulator", "--ids", "1,x"), "these are no ids"),
        (("--port", "emulator", "--ids", "254"), "these are no ids"),
        (("--port", "emulator", "--ids", "5-2"), "no id is meant"),
        (("--port", "emulator", "--protocol", "3"), "no such protocol"),
        (("--port", "emulator", "--baud", "0"), "no such speed"),
        (("--port", "emulator", "--baud", "77"), "found 77; allowed: 9600, 19200"),
        (("--port", "emulator", "--baud", "77", "--protocol", "2"), "found 77; allowed: 9600, 57600, 115200, 1000000"),
        (("--port", "emulator", "--baud", "4500000", "--protocol", "1"), "no servo has it"),
        (("--port", "emulator", "--protocol", "2", "--ids", "253"), "0 to 252"),
        ((), "--bus emulator, or --robot NAME"),
        (("--port", "no-such-port"), "without servos: --bus emulator"),
        (("--robot", "op4"), "Did you mean op3?"),
        (("--port", "x", "--faults", "f.yaml"), "only the emulator has faults to inject"),
    ],
)
def test_bad_options(words: tuple[str, ...], text: str, lab: ServoLab) -> None:
    code, out, err = lab.run("scan", *words)
    assert (code, out) == (2, "") and text in err and lab.sent == []


def test_ctrl_c_leaves_what_was_found(lab: ServoLab, monkeypatch: pytest.MonkeyPatch) -> None:
    lab.before = {(5, "baud_rate"): 1}
    scan, speeds = OneOff.scan, []

    def interrupted(client: OneOff, ids: Iterable[int], *, alone: Iterable[int]) -> list[FoundServo]:
        speeds.append(client.port.baud)
        if len(speeds) == 3:
            raise KeyboardInterrupt
        return scan(client, ids, alone=alone)

    monkeypatch.setattr(OneOff, "scan", interrupted)
    code, out, err = lab.run("scan", "--port", "emulator", "--protocol", "2")
    assert code == 130 and speeds == [1_000_000, 57_600, 2_000_000]
    shows(err)
    shows(out, 1)
    assert _row(out, 5).split()[:4] == ["2.0", "57600", "5", "XM430-W350"]


@pytest.mark.parametrize("words", [("scan",), ("monitor", "--once"), ("rest", "--yes")])
def test_an_adapter_that_echoes_is_reported_once(words: tuple[str, ...], lab: ServoLab) -> None:
    lab.faults = [Fault(FaultKind.ECHO)]
    for more in (("--robot", "op3"), ("--protocol", "2", "--baud", "2000000")):
        if words[0] == "scan":
            more = (*more, "--ids", "1-5")
        code, _, err = lab.run(*words, *more, "--port", "emulator")
        assert code == 0 and err.count("the adapter echoes what is sent") == 1
    lab.faults = []
    assert "echoes" not in lab.run(*words, "--robot", "op3", "--port", "emulator")[2]
