"""`retarget servo rest` on the emulator: limp and confirmed, or said who is not."""

import signal
from collections.abc import Collection, Mapping

import pytest

from hardware.dynamixel.codec import Instruction
from hardware.dynamixel.cyclic import BusLine
from hardware.dynamixel.torque import off_everywhere
from messages import shows
from servo_lab import ServoLab
from sim.emulator.faults import Fault, FaultKind


@pytest.fixture
def lab(lab: ServoLab) -> ServoLab:
    lab.before = {(device, "torque_enable"): 1 for device in range(1, 21)}
    return lab


WAYS = [("--robot", "op3"), ("--baud", "2000000", "--protocol", "2")]


def _torques(lab: ServoLab) -> list[int]:
    return [lab.memory(device).value("torque_enable") for device in range(1, 21)]


@pytest.mark.parametrize("words", [*WAYS, ()])
def test_all_go_limp_after_a_yes(words: tuple[str, ...], lab: ServoLab) -> None:
    code, out, _ = lab.run("rest", *words, "--port", "emulator", typed="y\n")
    assert code == 0
    shows(out, 20)
    assert not any(_torques(lab))


@pytest.mark.parametrize("typed", ["n\n", "\n", "what\nn\n"])
def test_without_a_yes_nothing_is_written(typed: str, lab: ServoLab) -> None:
    code, out, _ = lab.run("rest", "--robot", "op3", "--port", "emulator", typed=typed)
    assert code == 0 and all(_torques(lab))
    shows(out)
    assert not lab.instructions() & {Instruction.WRITE, Instruction.SYNC_WRITE}


def test_a_limp_robot_is_left_alone_and_a_dry_run_sends_nothing(lab: ServoLab) -> None:
    code, out, _ = lab.run("rest", "--robot", "op3", "--port", "emulator", "--dry-run")
    assert code == 0 and "torque_enable := 0" in out and lab.sent == []
    lab.before = {}
    code, out, _ = lab.run("rest", "--robot", "op3", "--port", "emulator")
    assert code == 0 and Instruction.SYNC_WRITE not in lab.instructions()
    shows(out, 20)


@pytest.mark.parametrize(
    ("before", "faults", "facts", "limp"),
    [
        ({}, [Fault(FaultKind.SHORT)], (), False),
        ({(200, "dynamixel_power"): 0}, [], (200,), True),
        ({(device, "baud_rate"): 3 for device in range(1, 21)}, [], (1, 1000000, 2000000, "--baud", "2000000`"), True),
    ],
    ids=["a dead line", "a power switch that is off", "another speed"],
)
def test_why_no_servo_answers_is_said(
    before: dict[tuple[int, str], int], faults: list[Fault], facts: tuple[int | str, ...], limp: bool, lab: ServoLab
) -> None:
    lab.before, lab.faults = before | lab.before, faults
    code, _, err = lab.run("rest", "--robot", "op3", "--port", "emulator", "--yes")
    assert code == 2 and any(_torques(lab)) != limp
    shows(err, facts)


def test_a_silent_servo_is_named_and_the_others_are_limp(lab: ServoLab) -> None:
    lab.faults = [Fault(FaultKind.MISSING, ids=(13,))]
    code, out, err = lab.run("rest", "--robot", "op3", "--port", "emulator", "--yes")
    assert code == 1
    for text in (out, err):
        shows(text, "r_knee", 13)
    assert [device for device, on in enumerate(_torques(lab), 1) if on] == [13]


UNKNOWN = 4711
"""The number of a model without a table."""


@pytest.mark.parametrize("words", WAYS)
@pytest.mark.parametrize("unknown", [(7,), tuple(range(1, 21))])
def test_servos_of_unknown_models_go_limp_too(words: tuple[str, ...], unknown: tuple[int, ...], lab: ServoLab) -> None:
    lab.models = dict.fromkeys(unknown, UNKNOWN)
    code, out, err = lab.run("rest", *words, "--port", "emulator", "--yes")
    assert code == 0 and not any(_torques(lab))
    shows(out, 20)
    assert f"(id {unknown[0]}) is a model" in err or f"id {unknown[0]} is a model" in err
    assert f"number {UNKNOWN}" in err


@pytest.mark.parametrize("moved", [30, 252])
def test_an_id_unknown_to_the_profile_goes_limp_too(moved: int, lab: ServoLab) -> None:
    lab.moved = {7: moved}
    code, _, err = lab.run("rest", "--robot", "op3", "--port", "emulator", "--yes")
    assert code == 1
    shows(err, moved, "XM430-W350", 7)
    assert lab.memory(moved).value("torque_enable") == 0


@pytest.mark.parametrize("words", WAYS)
def test_an_unknown_one_that_does_not_confirm_is_named(words: tuple[str, ...], lab: ServoLab) -> None:
    lab.models = {7: UNKNOWN}
    lab.upon = {Instruction.SYNC_WRITE: Fault(FaultKind.MISSING, ids=(7,))}
    code, out, err = lab.run("rest", *words, "--port", "emulator", "--yes")
    assert code == 1
    shows(out)
    shows(err, 7)


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_an_interrupt_does_not_leave_half_of_them_powered(
    number: signal.Signals, lab: ServoLab, monkeypatch: pytest.MonkeyPatch
) -> None:
    def interrupted(buses: Mapping[BusLine, Collection[int]]) -> list[str]:
        signal.raise_signal(number)
        signal.raise_signal(number)
        return off_everywhere(buses)

    monkeypatch.setattr("retarget.cli.servo.rest.off_everywhere", interrupted)
    code, out, _ = lab.run("rest", "--robot", "op3", "--port", "emulator", "--yes")
    assert code == 0 and not any(_torques(lab))
    shows(out, 20)


@pytest.mark.parametrize(("words", "first"), [((), 1_000_000), (("--robot", "op3"), 2_000_000)])
def test_torque_off_is_sent_to_all_before_any_is_looked_for(words: tuple[str, ...], first: int, lab: ServoLab) -> None:
    lab.before = {(5, "baud_rate"): 1} | lab.before
    lab.upon = {Instruction.PING: Fault(FaultKind.MISSING)}  # from the first ping on no servo receives anything
    code, _, err = lab.run("rest", *words, "--port", "emulator", "--yes")
    assert code == 2
    shows(err)
    assert not any(_torques(lab))
    assert lab.bauds[0] == first and lab.sent[0][4:10].hex(" ") == "fe 06 00 03 40 00"
