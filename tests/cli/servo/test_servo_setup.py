"""`retarget servo setup` on the emulator: found, shown, asked, written, verified; and what is refused."""

import functools
import signal

import pytest
from rich.console import Console

from bus_rig import bus_of, spec
from hardware.bus import ServoStates
from hardware.clock import VirtualClock
from hardware.dynamixel.bus import BusWatch
from hardware.dynamixel.checks import complaints, needed_ticks
from hardware.dynamixel.codec import Instruction
from hardware.dynamixel.line_scan import write_setting
from hardware.dynamixel.settings import ServoImage
from hardware.joint_map import JointMap
from messages import mentions, shows
from retarget.model.robot import load_robot
from servo_lab import ServoLab
from sim.emulator.faults import Fault, FaultKind
from sim.emulator.memory import Memory

BUS = ("--robot", "op3", "--port", "emulator")


def test_id_and_speed_last_and_verified(lab: ServoLab) -> None:
    lab.before = {(13, "baud_rate"): 1}
    words = ("--id", "13", "--new-id", "33", "--baud", "1000000", "--return-delay", "20", "--register", "shutdown=53")
    code, out, err = lab.run("setup", *BUS, *words, typed="y\n")
    assert (code, err) == (0, "")
    shows(out, 57600, 33, "2.0", 1000000)
    assert out.index("shutdown") < out.index("  id: 13 -> 33") < out.index("baud_rate: 1 -> 3")
    memory = lab.memory(33)
    assert [memory.value(name) for name in ("baud_rate", "return_delay_time", "shutdown")] == [3, 10, 53]


@pytest.mark.parametrize(
    ("words", "text"),
    [
        (("--id", "254"), "254 is the broadcast id"),
        (("--id", "13", "--new-id", "254"), "254 is the broadcast id"),
        (("--id", "13", "--new-id", "14"), "id 14 is taken"),
        (("--id", "13", "--register", "shutdown"), "this is no setting"),
        (("--id", "13", "--register", "protocol_type=1"), "no such register"),
        (("--id", "33", "--register", "drive_mode=0"), "no servo answers to id 33"),
        (("--id", "12", "--register", "drive_mode=1"), "torque is on, and locks the EEPROM"),
    ],
)
def test_refused(words: tuple[str, ...], text: str, lab: ServoLab) -> None:
    lab.before = {(12, "torque_enable"): 1}
    code, _, err = lab.run("setup", *BUS, *words, "--yes")
    assert code == 2 and text in err and Instruction.WRITE not in lab.instructions()


@pytest.mark.parametrize(("words", "typed"), [((), "n\n"), (("--dry-run",), "")])
def test_nothing_is_written_without_a_yes(words: tuple[str, ...], typed: str, lab: ServoLab) -> None:
    code, out, _ = lab.run("setup", *BUS, "--id", "13", "--register", "drive_mode=1", *words, typed=typed)
    assert code == 0 and "drive_mode: 0 -> 1" in out and Instruction.WRITE not in lab.instructions()


def test_ctrl_c_ends_after_the_value_that_is_written(lab: ServoLab, monkeypatch: pytest.MonkeyPatch) -> None:
    def interrupted(*arguments: object) -> object:
        signal.raise_signal(signal.SIGINT)
        return write_setting(*arguments)  # type: ignore[arg-type]

    monkeypatch.setattr("retarget.cli.servo.write_settings.write_setting", interrupted)
    code, _, err = lab.run("setup", *BUS, "--id", "13", "--register", "drive_mode=1", "--new-id", "33", "--yes")
    assert code == 1
    shows(err, "drive_mode")
    assert lab.memory(13).value("drive_mode") == 1


CURED = [{"drive_mode": 9}, {"drive_mode": 5}, {"startup_configuration": 3}, {"secondary_id": 7}]
CURED += [{"homing_offset": -50}, {"min_position_limit": 1500}]
CURED += [{"min_position_limit": 1500, "max_position_limit": 2500}]


def _complaints(memory: Memory) -> list[str]:
    servo = spec(13)
    memory.put("present_input_voltage", 120)
    image = ServoImage(memory.table, bytes(memory.image[: memory.table["present_temperature"].end]))
    return complaints(servo, bus_of([servo]), image, needed_ticks(JointMap([servo]))["j13"])


@pytest.mark.parametrize("values", CURED)
def test_the_command_that_a_complaint_names_does_it(values: dict[str, int], lab: ServoLab) -> None:
    lab.before = {(13, name): value for name, value in values.items()}
    assert lab.run("setup", *BUS, "--id", "13", "--register", "shutdown=52", "--dry-run")[0] == 0
    said = _complaints(lab.memory(13))
    assert said
    command = said[0].split("`")[1].split()
    assert command[:5] == ["retarget", "servo", "setup", "--port", "/dev/main"]
    code, _, err = lab.run("setup", *BUS, *command[5:], "--yes")
    assert (code, err) == (0, "")
    assert _complaints(lab.memory(13)) == []


def test_a_servo_that_answers_pings_only_is_written_blind(lab: ServoLab) -> None:
    lab.before = {(13, "status_return_level"): 0}
    code, _, err = lab.run("setup", "--port", "emulator", "--id", "13", "--register", "drive_mode=4", "--yes")
    assert code == 2
    shows(err, "--register", "status_return_level=2")
    assert Instruction.WRITE not in lab.instructions()
    words = ("--id", "13", "--register", "status_return_level=2", "--register", "drive_mode=4")
    for typed, more in (("n\n", ()), ("", ("--dry-run",))):
        code, out, _ = lab.run("setup", *BUS, *words, *more, typed=typed)
        assert code == 0 and "status_return_level: 0 -> 2" in out and Instruction.WRITE not in lab.instructions()
    code, out, err = lab.run("setup", *BUS, *words, "--yes")
    assert (code, err) == (0, "")
    shows(out, "status_return_level")
    assert [lab.memory(13).value(name) for name in ("status_return_level", "drive_mode")] == [2, 4]


SPOILT = {"return_delay_time": 50, "drive_mode": 9, "homing_offset": -50, "startup_configuration": 3}
SPOILT |= {"operating_mode": 4, "min_position_limit": 2000, "secondary_id": 7, "id": 1}
"""r_knee as a servo that was in another robot, at another speed as well."""


def test_with_a_joint_everything_in_which_it_differs_from_the_profile_is_proposed(lab: ServoLab) -> None:
    lab.before = {(1, "id"): 41} | {(13, name): value for name, value in SPOILT.items()} | {(1, "baud_rate"): 1}
    words = (*BUS, "--joint", "r_knee", "--id", "1")
    code, out, _ = lab.run("setup", *words, "--dry-run")
    assert code == 0 and Instruction.WRITE not in lab.instructions()
    mentions(out, "return_delay_time: 50 -> 0 (0 us)", "drive_mode: 9 -> 0 (0x00)", "homing_offset: -50 -> 0 (0.0 deg)")
    mentions(out, "startup_configuration: 3 -> 2 (0x02)", "operating_mode: 4 -> 3 (position)", "  id: 1 -> 13\n")
    mentions(out, "min_position_limit: 2000 -> ", "secondary_id: 7 -> 255", "baud_rate: 1 -> 4 (2000000)")
    assert len([line for line in out.splitlines() if " -> " in line]) == len(SPOILT) + 1
    code, out, err = lab.run("setup", *words, "--return-delay", "20", "--yes")
    assert (code, err) == (0, "")
    shows(out, 13, "2.0", 2000000)
    memory = lab.memory(13)
    assert memory.value("return_delay_time") == 10 and _complaints(memory) == []


@pytest.mark.parametrize(
    ("words", "text"),
    [
        (("--new-id", "254"), "found 254"),
        (("--return-delay", "3"), "found 3 us"),
        (("--baud", "77"), "--baud: "),
        (("--register", "drive_mode=300"), "found 300"),
        (("--register", "id=3"), "the option --new-id"),
    ],
)
@pytest.mark.parametrize("robot", [(), ("--robot", "op3")])
def test_the_impossible_is_refused_before_a_port_is_opened(
    words: tuple[str, ...], text: str, robot: tuple[str, ...], lab: ServoLab
) -> None:
    code, _, err = lab.run("setup", *robot, "--port", "/dev/none", "--id", "13", *words)
    assert code == 2 and text in err and "/dev/none" not in err


# `retarget servo monitor` on the emulator: what it shows, and that it writes nothing.

READING = {Instruction.PING, Instruction.READ, Instruction.SYNC_READ, Instruction.FAST_SYNC_READ}


@pytest.mark.parametrize("words", [("--robot", "op3"), ("--baud", "2000000", "--protocol", "2")])
def test_a_table_of_all_servos_and_nothing_written(words: tuple[str, ...], lab: ServoLab) -> None:
    lab.before = {(13, "torque_enable"): 1}
    lab.faults = [Fault(FaultKind.OVER_TEMPERATURE, ids=(7,), value=95.0)]
    code, out, _ = lab.run("monitor", *words, "--port", "emulator", "--once")
    imu = "--robot" in words  # the last line but one, by the profile
    assert code == 0 and len(out.splitlines()) == 1 + 20 + imu + 1 and ("m/s^2" in out) == imu
    shows(out, "p50")
    rows = out.splitlines()[1:21]
    shows(rows[6], "OVERHEATING")
    assert " on " in rows[12] and " on " not in rows[7]
    assert lab.instructions() <= READING and lab.memory(13).value("torque_enable") == 1


def test_names_are_whole_on_a_narrow_terminal(lab: ServoLab, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("retarget.cli.servo.monitor.console", functools.partial(Console, width=55))
    code, out, _ = lab.run("monitor", *BUS, "--once")
    joints = load_robot("op3").joint_map.joints
    assert code == 0 and [name for name in joints if name not in out.split()] == [] and out.count(" off") == len(joints)


def test_bad_rate_and_dry_run(lab: ServoLab) -> None:
    code, _, err = lab.run("monitor", *BUS, "--rate", "0")
    assert code == 2
    shows(err)
    code, out, _ = lab.run("monitor", *BUS, "--dry-run")
    assert code == 0 and lab.sent == []
    shows(out)


def test_ctrl_c_ends_the_live_table(lab: ServoLab, monkeypatch: pytest.MonkeyPatch) -> None:
    read, cycles = BusWatch.read, []

    def interrupted(watch: BusWatch) -> ServoStates:
        cycles.append(1)
        if len(cycles) == 20:
            signal.raise_signal(signal.SIGINT)
        return read(watch)

    monkeypatch.setattr(BusWatch, "read", interrupted)
    monkeypatch.setattr("retarget.cli.servo.monitor.MonotonicClock", VirtualClock)
    monkeypatch.setattr("retarget.cli.servo.monitor.console", functools.partial(Console, force_terminal=True))
    code, out, err = lab.run("monitor", *BUS)
    assert (code, err) == (0, "") and len(cycles) == 20 and "head_tilt" in out
    assert lab.instructions() <= READING
