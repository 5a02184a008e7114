"""All problems of a bus are reported at once, each with its fix; nothing is written then."""

from collections.abc import Callable
from dataclasses import replace

import pytest

from bus_rig import BusRig, bus_of, spec, specs, waist_servos
from hardware.dynamixel.checks import needed_ticks
from hardware.dynamixel.codec import protocol2
from hardware.dynamixel.control_table import find_table
from hardware.dynamixel.cyclic import ReadKind, ReadRequest
from hardware.dynamixel.found_servos import servos_on
from hardware.dynamixel.opening import LOOKS, too_slow
from hardware.errors import BusError
from hardware.joint_map import JointMap
from hardware.servo import ServoMode
from messages import mentions, refuses, shows
from packet_vectors import ScriptedPort
from sim.emulator.faults import Fault, FaultKind
from sim.emulator.line import LineTiming


def _said(protocol: int, turnaround: float, *faults: Fault) -> tuple[str, BusRig]:
    timing = LineTiming(turnaround=turnaround)
    rig = BusRig(specs(2, "MX-28"), protocol=protocol, baud=1_000_000, timing=timing)
    rig.port.open(1_000_000)
    for fault in faults:
        rig.fault(fault)
    return too_slow(rig.port, rig.devices[0].table, 1, 500e-6), rig


@pytest.mark.parametrize("protocol", [1, 2])
def test_a_line_is_held_against_what_a_cycle_waits_and_an_echo_is_no_answer(protocol: int) -> None:
    for echo in ([], [Fault(FaultKind.ECHO)]):
        assert _said(protocol, 20e-6, *echo)[0] == ""
        assert _said(protocol, 0.006, *echo)[0]
    said, rig = _said(protocol, 0.006)
    shows(said, "7.")  # ms: turnaround, return delay, latency, bytes
    assert len(rig.port.sent) == LOOKS
    rig.clock.advance(1.0)
    assert rig.port.read() == b""


@pytest.mark.parametrize("late", [0.004, 0.030])
def test_an_answer_in_pieces_is_no_quick_one(late: float) -> None:
    """The tail of one answer must not be taken for the beginning of the next."""
    table = find_table("XM430-W350", 2)
    status = protocol2.status(1, 0, b"\x00\x08\x00\x00")

    def in_pieces(request: bytes) -> list[tuple[float, bytes]]:
        return [(late, status[:5]), (late + 0.001, status[5:10]), (late + 0.002, status[10:])]

    port = ScriptedPort(in_pieces, baud=57_600)
    problem = too_slow(port, table, 1, 0.0)
    allowed = ReadRequest(ReadKind.SYNC, (1,), 132, 4).timeouts(port, 0.0).first
    assert bool(problem) == (late > allowed)


Spoil = Callable[[BusRig], None]


def register(number: int, **values: int) -> Spoil:
    """Registers of one servo hold something else."""
    return lambda rig: rig.put(number, **values)


def overheated(rig: BusRig) -> None:
    rig.device(2).heat(90.0, 0.0)
    rig.device(2).heat(30.0, 0.0)
    rig.device(2).memory.put("hardware_error_status", 4)


def supply(rig: BusRig) -> None:
    for one in rig.devices:
        one.supply(9.0, 0.0)


def other_speed(*ids: int) -> Spoil:
    """57600 baud."""
    return lambda rig: rig.put(*ids, baud_rate=1)


def fault(kind: FaultKind, *ids: int) -> Spoil:
    return lambda rig: rig.fault(Fault(kind, ids=ids) if ids else Fault(kind))


PROBLEMS: dict[str, tuple[Spoil, tuple[str, ...]]] = {
    "missing": (fault(FaultKind.MISSING, 2, 4), ("j2 (id 2), j4 (id 4) did not answer", "servo scan", "too busy")),
    "no servo": (fault(FaultKind.MISSING), ("no servo answers", "check the servos' power", "too busy")),
    "other speed": (
        other_speed(1, 2, 3, 4),
        ("no servo answers", "(id 1) answers at 57600", "correct `baud`", "--port /dev/main --id 1 --baud 2000000`"),
    ),
    "one at another speed": (
        other_speed(3),
        ("j3 (id 3) did not answer", "j3 (id 3) answers at 57600 baud, and its bus has 2000000", "--id 3 --baud"),
    ),
    "second id": (register(2, secondary_id=1), ("servo j2 (id 2) also obeys what is meant for id 1",)),
    "status return off": (register(2, status_return_level=0), ("answers pings only", "status_return_level=2`")),
    "unknown": (register(4, id=9), ("j4 (id 4) did not answer", "ids that are not in the profile: 9 (XM430-W350)")),
    "clash": (fault(FaultKind.ID_CLASH, 3), ("j3 (id 3) gives several different answers", "one at a time")),
    "errors": (overheated, ("servo j2 (id 2) has latched OVERHEATING (too hot)", "servo reboot")),
    "voltage": (supply, ("has a supply of 9.0 V, allowed 9.5 to 16 V", "battery")),
    "torque": (register(1, torque_enable=1), ("has torque on, and its EEPROM must be written", "servo rest")),
    "by goal": (register(1, drive_mode=8), ("has drive mode 0x08, bit 3 (torque on by goal", "drive_mode=0")),
    "reverse": (register(1, drive_mode=5), ("has drive mode 0x05, bit 0 (reverse", "drive_mode=4`")),
    "follower": (register(1, drive_mode=2), ("has drive mode 0x02, bit 1 (follower",)),
    "at start": (register(1, startup_configuration=1), ("torque on by itself when it starts", "servo setup")),
    "offset": (register(1, homing_offset=-50), ("has homing offset -50, the profile says 0",)),
    "travel": (register(1, min_position_limit=1500), ("takes ticks 1500 to 4095 only, the joint needs 1071 to 3025",)),
}


def refusal(rig: BusRig) -> str:
    """What opening says; nothing was written to a servo, and no port is left open."""
    before = rig.images()
    with pytest.raises(BusError) as caught:
        rig.bus.open()
    assert rig.images() == before
    assert not any(port.opened for port in rig.ports.values())
    writes = {3, 4, 5, 6, 8, 16, 131, 147}  # instructions of 2.0 that change something
    assert not [packet for port in rig.ports.values() for packet in port.sent if packet[7] in writes]
    with refuses(BusError):
        rig.bus.read()
    return str(caught.value)


@pytest.mark.parametrize("case", list(PROBLEMS))
def test_each_problem_is_named_with_its_fix(case: str) -> None:
    rig = BusRig(specs(4))
    spoil, texts = PROBLEMS[case]
    spoil(rig)
    said = refusal(rig)
    mentions(said, *texts)
    assert "main" in said or "servo j" in said


def test_a_slow_adapter_is_named_with_the_command() -> None:
    rig = BusRig(specs(2), timing=LineTiming(latency=0.016))
    shows(refusal(rig), 16, 1, "latency_timer")


def test_wheel_mode_of_protocol_1_is_refused_and_it_is_noted_to_have_no_watchdog() -> None:
    rig = BusRig(specs(2, "AX-12A"), protocol=1)
    rig.put(2, ccw_angle_limit=0)
    before = rig.images()
    with refuses(BusError, "j2", 2):
        rig.bus.open()
    assert rig.images() == before
    rig.put(2, ccw_angle_limit=1023)
    shows(rig.ready().notes, 1)


def test_multi_turn_mode_of_protocol_1_is_refused() -> None:
    rig = BusRig(specs(2, "MX-28"), protocol=1)
    rig.put(2, cw_angle_limit=4095, ccw_angle_limit=4095)
    with refuses(BusError, "j2", 2):
        rig.bus.open()


def test_everything_is_said_at_once_on_all_ports() -> None:
    servos = [*specs(6), spec(7, bus="arms"), spec(8, bus="arms"), spec(9, bus="head")]
    rig = BusRig(servos, unknown_ids=[spec(40)])
    overheated(rig)
    rig.put(1, drive_mode=8, homing_offset=3)
    rig.put(4, model_number=1060)
    rig.lines["main"].faults.add(Fault(FaultKind.MISSING, ids=(6,)), 0.0)
    rig.lines["arms"].faults.add(Fault(FaultKind.UNPLUG), 0.0)
    rig.lines["head"].faults.add(Fault(FaultKind.MISSING), 0.0)
    said = refusal(rig)
    mentions(said, "j1 (id 1) has drive mode", "j1 (id 1) has homing", "OVERHEATING", "j4 (id 4) is XL430")
    mentions(said, "j6 (id 6) did not", "40 (XM430-W350)", "bus arms: emulated arms: there is no such port")
    mentions(said, "bus head", "no servo answers")
    assert said.startswith("the bus cannot be used, for 8 reasons:")
    assert said.count("\n") == 8


def test_a_device_of_the_profile_without_a_joint_must_be_there() -> None:
    servos = specs(2)
    rig = BusRig(servos, buses=[replace(bus_of(servos), ids=(1, 2, 30))])
    shows(refusal(rig), 30)
    assert protocol2.frame(30, 1, b"") in rig.port.sent


@pytest.mark.parametrize("other", ["main", "arms"])
def test_limits_of_coupled_servos_are_held_against_all_angles_of_both_joints(other: str) -> None:
    roll, yaw = [replace(one, mode=ServoMode.POSITION, lower=-0.2, upper=0.2) for one in waist_servos()[1:3]]
    servos = [roll, replace(yaw, bus=other)]
    low, high = needed_ticks(JointMap(servos))["roll"]
    rig = BusRig(servos)
    rig.put(roll.id, min_position_limit=low, max_position_limit=high)
    rig.bus.open()
    rig = BusRig(servos)
    rig.put(roll.id, min_position_limit=low + 1)
    shows(refusal(rig), "roll", 2, low + 1, 4095, low, high)


@pytest.mark.parametrize(("protocol", "model"), [(1, "AX-12A"), (1, "MX-28"), (2, "MX-28"), (2, "XM430-W350")])
def test_all_are_found_and_nothing_comes_afterwards(protocol: int, model: str) -> None:
    others = [spec(0, model), spec(40, model), spec(252, model)]
    rig = BusRig(specs(3, model), protocol=protocol, baud=1_000_000, unknown_ids=others)
    rig.port.open(1_000_000)
    begun = rig.clock.now()
    found, notes = servos_on(*rig.bus.lines)
    assert [one.id for one in found] == [0, 1, 2, 3, 40, 252] and notes == []
    assert len({one.model for one in found}) == 1 and not any(one.clash for one in found)
    assert rig.clock.now() - begun < 1.1
    rig.clock.advance(1.0)
    assert rig.port.read() == b""


def test_a_search_that_would_take_too_long_is_noted() -> None:
    slow = LineTiming(latency=0.016)
    rig = BusRig(specs(2, "AX-12A"), protocol=1, timing=slow, unknown_ids=[spec(9, "AX-12A")])
    rig.port.open(1_000_000)
    found, notes = servos_on(*rig.bus.lines)
    assert [one.id for one in found] == [1, 2]
    assert notes == ["too slow to look for servos that are not in the profile"]
