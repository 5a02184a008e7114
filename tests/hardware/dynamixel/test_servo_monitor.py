"""`retarget servo monitor` on the emulator: what it shows, and that it writes nothing."""

import functools
import signal

import pytest
from rich.console import Console

from hardware.bus import ServoStates
from hardware.clock import VirtualClock
from hardware.dynamixel.bus import Watch
from hardware.dynamixel.codec import Instruction
from messages import shows
from retarget.model.robot import load_robot
from servo_lab import ServoLab
from sim.emulator.faults import Fault, FaultKind

READING = {Instruction.PING, Instruction.READ, Instruction.SYNC_READ, Instruction.FAST_SYNC_READ}


@pytest.fixture
def lab(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> ServoLab:
    return ServoLab(monkeypatch, capsys)


@pytest.mark.parametrize("words", [("--robot", "op3"), ("--baud", "2000000", "--protocol", "2")])
def test_a_table_of_all_servos_and_nothing_written(words: tuple[str, ...], lab: ServoLab) -> None:
    lab.before = {(13, "torque_enable"): 1}
    lab.faults = [Fault(FaultKind.OVER_TEMPERATURE, ids=(7,), value=95.0)]
    code, out, _ = lab.run("monitor", *words, "--port", "emulator", "--once")
    assert code == 0 and len(out.splitlines()) == 1 + 20 + 1
    shows(out, "p50")
    rows = out.splitlines()[1:21]
    shows(rows[6], "OVERHEATING")
    assert " on " in rows[12] and " on " not in rows[7]
    assert lab.instructions() <= READING and lab.memory(13).value("torque_enable") == 1


def test_names_are_whole_on_a_narrow_terminal(lab: ServoLab, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("retarget.cli.servo.monitor.console", functools.partial(Console, width=55))
    code, out, _ = lab.run("monitor", "--robot", "op3", "--port", "emulator", "--once")
    joints = load_robot("op3").joint_map.joints
    assert code == 0 and [name for name in joints if name not in out.split()] == [] and out.count(" off") == len(joints)


def test_bad_rate_and_dry_run(lab: ServoLab) -> None:
    code, _, err = lab.run("monitor", "--robot", "op3", "--port", "emulator", "--rate", "0")
    assert code == 2
    shows(err)
    code, out, _ = lab.run("monitor", "--robot", "op3", "--port", "emulator", "--dry-run")
    assert code == 0 and lab.sent == []
    shows(out)


def test_ctrl_c_ends_the_live_table(lab: ServoLab, monkeypatch: pytest.MonkeyPatch) -> None:
    read, cycles = Watch.read, []

    def interrupted(watch: Watch) -> ServoStates:
        cycles.append(1)
        if len(cycles) == 20:
            signal.raise_signal(signal.SIGINT)
        return read(watch)

    monkeypatch.setattr(Watch, "read", interrupted)
    monkeypatch.setattr("retarget.cli.servo.monitor.MonotonicClock", VirtualClock)
    monkeypatch.setattr("retarget.cli.servo.monitor.console", functools.partial(Console, force_terminal=True))
    code, out, err = lab.run("monitor", "--robot", "op3", "--port", "emulator")
    assert (code, err) == (0, "") and len(cycles) == 20 and "head_tilt" in out
    assert lab.instructions() <= READING
