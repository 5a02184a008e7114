"""`retarget servo reboot` on the emulator: errors in words, cleared, and seen to be cleared."""

import signal
from collections.abc import Callable

import pytest

from hardware.dynamixel.codec import Instruction
from hardware.dynamixel.cyclic import BusLine
from hardware.dynamixel.single_requests import OneOff
from hardware.dynamixel.torque import Restarted, restart
from messages import shows
from retarget.cli.servo import reboot as reboot_file
from servo_lab import ServoLab
from sim.emulator.faults import Fault, FaultKind

REBOOT = ("reboot", "--robot", "op3", "--port", "emulator")


@pytest.mark.parametrize("servo", [("--id", "7"), ("--joint", "r_hip_yaw")])
def test_a_latched_error_is_explained_and_cleared(servo: tuple[str, str], lab: ServoLab) -> None:
    lab.faults = [Fault(FaultKind.OVER_TEMPERATURE, ids=(7,), value=95.0, end=0.01)]
    code, out, err = lab.run(*REBOOT, *servo, typed="y\n")
    assert (code, err) == (0, "")
    shows(out, "OVERHEATING", 1)
    assert lab.memory(7).value("hardware_error_status") == 0


def test_torque_is_not_dropped_unasked(lab: ServoLab) -> None:
    lab.before = {(13, "torque_enable"): 1}
    code, _, err = lab.run(*REBOOT, "--id", "13", typed="y\n")
    assert code == 2
    shows(err, "r_knee", 13)
    assert Instruction.REBOOT not in lab.instructions()
    code, out, _ = lab.run(*REBOOT, "--id", "13", "--yes")
    assert code == 0 and lab.memory(13).value("torque_enable") == 0
    shows(out)


@pytest.mark.parametrize(
    ("before", "upon"),
    [
        ({(13, "startup_configuration"): 1}, {}),
        ({}, {Instruction.REBOOT: Fault(FaultKind.MISSING, ids=(13,))}),
    ],
    ids=["torque on at start", "does not come back"],
)
def test_a_servo_that_is_not_as_it_should_be_afterwards_is_reported(
    before: dict[tuple[int, str], int], upon: dict[int, Fault], lab: ServoLab
) -> None:
    lab.before, lab.upon = before, {**upon}
    code, _, err = lab.run(*REBOOT, "--id", "13", "--yes")
    assert code == 2
    shows(err, "r_knee", 13)


@pytest.mark.parametrize(
    ("words", "text"),
    [
        ((), "one of --id 1,2, --joint NAME and --all"),
        (("--all", "--id", "3"), "one of --id 1,2, --joint NAME and --all"),
        (("--joint", "r_kne"), "Did you mean r_knee"),
        (("--id", "33"), "no servo answers to id 33"),
        (("--id", "254"), "--id: these are no ids; found '254'; allowed: such as 1,2,5-9; 0 to 252"),
        (("--id", "200"), "no servo answers to id 200"),
    ],
)
def test_bad_options(words: tuple[str, ...], text: str, lab: ServoLab) -> None:
    code, _, err = lab.run(*REBOOT, *words)
    assert code == 2 and text in err and Instruction.REBOOT not in lab.instructions()


def test_no_and_dry_run_restart_nothing(lab: ServoLab) -> None:
    code, out, _ = lab.run(*REBOOT, "--all", typed="n\n")
    assert code == 0 and Instruction.REBOOT not in lab.instructions()
    shows(out)
    lab.sent.clear()
    code, out, _ = lab.run(*REBOOT, "--all", "--dry-run")
    assert code == 0 and lab.sent == []
    shows(out)


@pytest.mark.parametrize(
    ("at", "code", "text"), [(0, 130, "restarted: no servo; not: r_sho_pitch"), (2, 1, "r_sho_pitch")]
)
def test_ctrl_c_ends_before_the_next_servo_and_lists_those_restarted(
    at: int, code: int, text: str, lab: ServoLab, monkeypatch: pytest.MonkeyPatch
) -> None:
    done: list[int] = []
    reboot = OneOff.reboot

    def counted(client: OneOff, device: int) -> None:
        done.append(device)
        reboot(client, device)
        if len(done) == at:
            signal.raise_signal(signal.SIGINT)

    def asked(question: str, *, yes: bool) -> bool:
        monkeypatch.setattr(reboot_file, "restart", interrupted if at == 0 else restart)
        return True

    def interrupted(line: BusLine, ids: list[int], stop: Callable[[], bool]) -> Restarted:
        signal.raise_signal(signal.SIGINT)
        return restart(line, ids, stop)

    monkeypatch.setattr(OneOff, "reboot", counted)
    monkeypatch.setattr(reboot_file, "agreed", asked)
    left, _, err = lab.run(*REBOOT, "--id", "1,2,3")
    assert left == code and text in err
    shows(err)
    assert done == [1, 2, 3][:at] and "(id 3)" in err.partition("; not: ")[2]
