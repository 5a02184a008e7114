"""`retarget servo scan` on the emulator: what it shows, what it misses, and that it writes nothing."""

import pytest

from hardware.dynamixel.packets import Instruction
from servo_lab import ServoLab
from sim.emulator.faults import Fault, FaultKind


@pytest.fixture
def lab(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> ServoLab:
    return ServoLab(monkeypatch, capsys)


def _row(out: str, device: int) -> str:
    return next(line for line in out.splitlines() if line.split()[2:3] == [str(device)])


def test_everybody_is_found_and_nothing_is_written(lab: ServoLab) -> None:
    code, out, err = lab.run("scan", "--robot", "op3", "--port", "emulator")
    assert (code, err) == (0, "")
    assert len(out.splitlines()) == 1 + 1 + 21 and "missing" not in out
    assert _row(out, 13).split() == ["2.0", "2000000", "13", "XM430-W350", "52", "r_knee"]
    assert "a device of the bus" in _row(out, 200)
    assert lab.instructions() <= {Instruction.PING, Instruction.READ}


def test_missing_strange_fast_and_wrong_servos_are_told(lab: ServoLab) -> None:
    lab.before = {(2, "baud_rate"): 1, (3, "id"): 77}
    lab.faults = [Fault(FaultKind.MISSING, ids=(5,)), Fault(FaultKind.ID_CLASH, ids=(6,))]
    code, out, _ = lab.run("scan", "--robot", "op3", "--port", "emulator", "--protocol", "2")
    assert code == 0
    assert "57600" in _row(out, 2) and "should be protocol 2.0, 2000000 baud" in _row(out, 2)
    assert _row(out, 77).endswith("unknown") or "unknown" in _row(out, 77)
    assert "two servos with this id" in _row(out, 6)
    missing = next(line for line in out.splitlines() if line.startswith("missing"))
    assert "id 3" in missing and "id 5" in missing and "id 6" not in missing


def test_a_latched_error_is_said_in_words(lab: ServoLab) -> None:
    lab.faults = [Fault(FaultKind.OVER_TEMPERATURE, ids=(7,), value=95.0)]
    code, out, _ = lab.run("scan", "--port", "emulator", "--baud", "2000000", "--ids", "6-8")
    assert code == 0 and "OVERHEATING (too hot)" in _row(out, 7) and "OVERHEATING" not in _row(out, 8)


def test_silence_is_an_error_that_says_what_was_tried(lab: ServoLab) -> None:
    lab.faults = [Fault(FaultKind.MISSING)]
    code, out, err = lab.run("scan", "--port", "emulator", "--protocol", "1", "--baud", "1000000", "--ids", "1,4-6")
    assert (code, out) == (2, "")
    assert "ids 1, 4, 5, 6" in err and "protocol 1.0 with 1000000 baud" in err and "power" in err


def test_a_dry_run_sends_nothing(lab: ServoLab) -> None:
    code, out, _ = lab.run("scan", "--robot", "op3", "--port", "emulator", "--dry-run", "--protocol", "2")
    assert code == 0 and lab.sent == [] and "would ping all ids" in out and "9600, 57600" in out


@pytest.mark.parametrize(
    ("words", "text"),
    [
        (("--port", "emulator", "--ids", "1,x"), "these are no ids"),
        (("--port", "emulator", "--ids", "254"), "these are no ids"),
        (("--port", "emulator", "--ids", "5-2"), "no id is meant"),
        (("--port", "emulator", "--protocol", "3"), "no such protocol"),
        (("--port", "emulator", "--baud", "0"), "no such speed"),
        ((), "no port is named"),
        (
            (
                "--port",
                "no-such-port",
            ),
            "no-such-port",
        ),
        (("--robot", "op4"), "Did you mean op3?"),
        (("--port", "x", "--faults", "f.yaml"), "faults happen on the emulator"),
    ],
)
def test_bad_options(words: tuple[str, ...], text: str, lab: ServoLab) -> None:
    code, out, err = lab.run("scan", *words)
    assert (code, out) == (2, "") and text in err and lab.sent == []
