"""The exchange of every cycle: whole with any models, whole but for the missing, never wrong."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

import more_frames
from bus_rig import CYCLE, BusRig, Tapped, bus_of, spec, specs
from hardware.arrays import BoolArray, TickArray
from hardware.bus import ServoAlert, ServoStates
from hardware.dynamixel import single_requests
from hardware.dynamixel.bus import TORQUE_AGE, BusWatch
from hardware.dynamixel.codec import Instruction, Status, protocol1, protocol2, side_by_side
from hardware.dynamixel.control_table import find_table
from hardware.dynamixel.cyclic import (
    FEWEST,
    PROBE_PERIOD,
    RETRIES,
    WINDOW_S,
    ErrorRate,
    ReadKind,
    ReadRequest,
    Wired,
    collect,
    goal_packets,
    kind_of,
)
from hardware.dynamixel.readings import ReportedTorque
from packet_vectors import ScriptedPort, always
from sim.emulator.conversation import Gaps
from sim.emulator.fault_state import FaultState
from sim.emulator.faults import Direction, Fault, FaultKind, Unit

STEP = 3  # ticks by which every goal moves in a cycle
WORST = 0.006  # [s] that a missing servo may cost in one cycle
USED = 1e-9


def codes(packets: list[bytes]) -> list[int]:
    """Instructions of 2.0 packets."""
    return [packet[7] for packet in packets]


def whole(states: ServoStates, missing: tuple[int, ...] = ()) -> bool:
    """Whether everyone (ids from 1) has answered, but for the missing."""
    return bool((states.valid == [number not in missing for number in range(1, len(states.valid) + 1)]).all())


@pytest.mark.parametrize("echo", [False, True])
def test_a_cycle_is_one_goal_packet_and_one_fast_read_whether_or_not_the_adapter_echoes(echo: bool) -> None:
    rig = BusRig()
    if echo:
        rig.fault(Fault(FaultKind.ECHO))
    rig.ready(torque=True)
    for _ in range(10):
        rig.tick()
    rig.port.sent.clear()
    goals = np.arange(20) + 2040
    states = rig.tick(goals).states
    rig.tick(goals)
    rig.tick(goals)
    asked = [code for code in codes(rig.port.sent) if code != Instruction.SYNC_READ]  # one servo's status
    assert asked == [Instruction.FAST_SYNC_READ, Instruction.SYNC_WRITE] * 3
    assert whole(states) and states.driven.all() and not states.alert.any()
    rig.port.waits = 0
    for _ in range(30):
        states = rig.tick(goals).states
    assert whole(states) and states.driven.all() and rig.port.waits <= (5 if echo else 4) * 30
    assert np.abs(states.position - goals).max() <= 1
    assert np.isfinite(states.voltage).all() and np.isfinite(states.temperature).all()
    assert ((states.voltage > 11) & (states.voltage < 13) & (states.temperature > 20)).all()
    assert rig.bus.retries == 0


MODELS = ("XM430-W350", "2XL430-W250", "XL430-W250", "MX-28", "XH540-W270", "XC330-T288", "2XC430-W250")


def test_models_that_differ_share_a_line() -> None:
    servos = [spec(number, model) for number, model in enumerate(MODELS, 1)]
    rig = BusRig(servos, baud=1_000_000).ready(torque=True)
    rig.port.sent.clear()
    goals = np.arange(len(servos)) * 7 + 2040
    for _ in range(60):
        states = rig.tick(goals).states
        assert whole(states) and states.driven.all()
    assert np.abs(states.position - rig.shafts()).max() <= 1
    assert {Instruction.FAST_SYNC_READ, Instruction.SYNC_READ} <= set(codes(rig.port.sent))
    assert np.isnan(states.current).tolist() == [servo.model.current_unit is None for servo in servos]


def test_protocol_1_is_read_in_bulk_or_one_by_one() -> None:
    servos = [spec(1, "MX-28"), spec(2, "MX-64"), spec(3, "AX-12A"), spec(4, "AX-12A")]
    rig = BusRig(servos, protocol=1).ready(torque=True)
    tables = [one.table for one in rig.devices]
    assert [kind_of(table) for table in tables] == [ReadKind.BULK1, ReadKind.BULK1, ReadKind.SINGLE1, ReadKind.SINGLE1]
    goals = np.array([2100, 2000, 530, 500])
    for _ in range(40):
        rig.port.sent.clear()
        states = rig.tick(goals).states
        assert whole(states) and states.driven.all()
    assert np.abs(states.position - goals).max() <= 2
    bulk = [packet for packet in rig.port.sent if packet[4] == Instruction.BULK_READ]
    assert len(bulk) == 1
    assert {packet[2] for packet in rig.port.sent if packet[4] == Instruction.READ} >= {3, 4}
    assert np.isfinite(states.voltage).all() and np.isnan(states.current).all()


@pytest.mark.parametrize("gaps", list(Gaps))
@pytest.mark.parametrize("gone", [1, 10, 20])
def test_a_missing_servo_costs_little_and_the_others_nothing(gone: int, gaps: Gaps) -> None:
    rig = BusRig(gaps=gaps).ready(torque=True)
    goals = np.full(20, 2048)
    usual = max(rig.tick(goals).took for _ in range(40))
    rig.fault(Fault(FaultKind.MISSING, ids=(gone,)))
    costs, others = [], np.arange(1, 21) != gone
    for cycle in range(1, 101):
        goals = goals + STEP
        states, took = rig.tick(goals)
        costs.append(took - usual)
        assert whole(states, (gone,))
        assert (states.age[others] == 0).all()
        # It goes on falling behind its age; the others are where their shafts are now.
        assert states.age[gone - 1] >= (cycle - 1) * CYCLE
        assert np.abs(states.position - rig.shafts())[others].max() <= STEP
    assert max(costs) <= WORST
    assert np.median(costs[3:]) <= USED
    looks = sum(cost > USED for cost in costs[3:])
    assert looks <= 97 * CYCLE / PROBE_PERIOD + 1
    rig.clear_faults()
    back = [bool(rig.tick(goals).states.valid.all()) for _ in range(round(PROBE_PERIOD / CYCLE) + 3)]
    assert back[-1] and back == sorted(back)


@pytest.mark.parametrize("count", [2, 4, 20])
@pytest.mark.parametrize("cycles", [1, 2, 5])
def test_a_silent_line_costs_little_and_is_read_whole_when_it_is_back(count: int, cycles: int) -> None:
    """Some cycles of silence on the whole line, as of a USB hub that hiccups: nothing raises, nobody is given up."""
    rig = BusRig(specs(count)).ready(torque=True)
    goals = np.full(count, 2048)
    before = rig.tick(goals).states
    rig.fault(Fault(FaultKind.SHORT))
    for cycle in range(1, cycles + 1):
        states, took = rig.tick(goals)
        assert not states.valid.any() and (states.age >= (cycle - 1) * CYCLE).all()
        assert (states.position == before.position).all() and states.error_rate == 0.0
        assert took < CYCLE
    rig.clear_faults()
    states, took = rig.tick(goals)
    assert whole(states) and states.driven.all() and took < 1.25 * CYCLE


DAMAGE = {
    "flip": Fault(FaultKind.FLIP, rate=0.01),
    "drop": Fault(FaultKind.DROP, rate=0.01),
    "duplicate": Fault(FaultKind.DUPLICATE, rate=0.01),
    "noise": Fault(FaultKind.NOISE, rate=0.01),
    "late": Fault(FaultKind.LATE, rate=0.01, value=0.003),
    "bytes": Fault(FaultKind.FLIP, rate=0.001, of=Unit.BYTES),
    "to host": Fault(FaultKind.FLIP, rate=0.03, direction=Direction.TO_HOST),
}


@pytest.mark.parametrize("case", list(DAMAGE))
def test_damage_is_asked_again_and_never_believed(case: str) -> None:
    """What came is held against the truth. A packet that comes late may cost a whole cycle: one seed says little."""
    cycles, lost = 100, 0
    for seed in range(2):
        rig = BusRig()
        rig.line.faults = FaultState(rig.line.devices, seed=seed)
        rig.ready(torque=True)
        rig.fault(DAMAGE[case])
        for cycle in range(cycles):
            states, took = rig.tick(np.arange(20) * 5 + 2048 + STEP * cycle % 200)
            lost += int((~states.valid).sum())
            # What is valid was so during the cycle: shafts move a few ticks in it.
            truth = rig.shafts()
            speed = np.abs(states.velocity) / rig.servos[0].model.tick_rad
            assert (np.abs(states.position - truth)[states.valid] <= (speed * (took + CYCLE) + 12)[states.valid]).all()
            assert not states.alert.any() and states.driven.all()
        assert case == "duplicate" or rig.bus.retries > 0
        assert rig.bus.retries <= RETRIES * cycles
    assert lost <= 2 * cycles * 20 * 0.002


def test_which_error_it_is_is_known_within_two_cycles() -> None:
    rig = BusRig().ready(torque=True)
    rig.tick()
    rig.fault(Fault(FaultKind.OVER_TEMPERATURE, ids=(4,)))
    rig.tick()
    states = rig.tick().states
    expected = np.zeros(20, dtype=int)
    expected[3] = ServoAlert.OVERHEATING
    assert states.alert.tolist() == expected.tolist()
    assert ((states.error & 0x80) > 0).tolist() == (expected > 0).tolist()
    assert whole(states)
    for _ in range(90):  # it has switched its own torque off, and says so when asked in its turn
        states = rig.tick().states
    assert states.driven.tolist() == (expected == 0).tolist()


def test_a_start_too_short_to_be_missed_is_seen_all_the_same() -> None:
    rig = BusRig(specs(4)).ready(torque=True)
    one = rig.device(3)
    one.boot_time = 0.0
    one.reboot(rig.clock.now())
    for _ in range(20):
        states = rig.tick().states
    assert states.driven.tolist() == [True, True, False, True]


@pytest.mark.parametrize("baud", [57_600, 1_000_000, 2_000_000, 4_000_000])
@pytest.mark.parametrize("model", ["XM430-W350", "2XL430-W250"])
def test_a_slow_wire_is_not_taken_for_silence(baud: int, model: str) -> None:
    servos = specs(20, model)
    rig = BusRig(servos, buses=[replace(bus_of(servos, baud=baud), watchdog=0.3)]).ready(torque=True)
    for _ in range(8):
        assert whole(rig.tick(np.full(20, 2050)).states)
    assert rig.bus.retries == 0


def test_an_adapter_that_is_slower_than_it_says_is_noted_once(monkeypatch: pytest.MonkeyPatch) -> None:
    rig = BusRig(specs(3)).ready(torque=True)
    monkeypatch.setattr(Tapped, "latency", 1e-3)
    rig.line.timing = replace(rig.line.timing, latency=4e-3)
    for _ in range(200):
        rig.tick()
    assert sum("had to be repeated" in note for note in rig.notes) == 1


def test_temperatures_that_are_not_received_are_forgotten() -> None:
    rig = BusRig(specs(3)).ready(torque=True)
    two, read = rig.device(2), rig.device(2).read
    two.read = lambda address, length, now: (  # type: ignore[method-assign]
        read(address, length, now) if length < 20 else two.answer(7)
    )
    for _ in range(40):
        assert rig.tick().states.temperature[1] > 0
    for _ in range(400):
        states = rig.tick().states
    assert np.isnan(states.temperature[1]) and np.isnan(states.voltage[1]) and states.valid.all()
    assert np.isfinite(states.temperature[[0, 2]]).all()
    two.read = read  # type: ignore[method-assign]
    for _ in range(30):
        states = rig.tick().states
    assert np.isfinite(states.temperature).all()


def test_on_a_noisy_line_goals_are_sent_twice_and_on_a_quiet_one_once() -> None:
    rig = BusRig(specs(3)).ready(torque=True)

    def goals_sent() -> int:
        rig.port.sent.clear()
        rig.tick()
        return codes([one for one in rig.port.sent if len(one) > 7]).count(Instruction.SYNC_WRITE)

    assert [goals_sent() for _ in range(10)] == [1] * 10
    rig.fault(Fault(FaultKind.CRC_STORM, direction=Direction.TO_HOST, end=0.02))
    rig.tick()
    rig.tick()
    assert [goals_sent() for _ in range(10)] == [2] * 10
    for _ in range(150):
        rig.tick()
    assert goals_sent() == 1


def wired(model: str, protocol: int, count: int = 3) -> list[Wired]:
    return [Wired(index, index + 1, find_table(model, protocol)) for index in range(count)]


def sent(servos: list[Wired], goals: TickArray, driven: BoolArray) -> list[bytes]:
    """The packets for goals that are not empty."""
    return [packet for one in goal_packets(servos) if (packet := one.packet(goals, driven))]


def test_the_bytes_of_goals() -> None:
    """By hand from the layout of a sync write: address 116, 4 bytes each; CRC by long division; 1.0: address 30."""
    (packet,) = sent(wired("XM430-W350", 2), np.array([2048, 2049, 2047]), np.full(3, True))
    assert packet.hex(" ") == "ff ff fd 00 fe 16 00 83 74 00 04 00 01 00 08 00 00 02 01 08 00 00 03 ff 07 00 00 ff c1"
    (packet,) = sent(wired("AX-12A", 1), np.array([512, 513, 511]), np.full(3, True))
    assert packet.hex(" ") == "ff ff fe 0d 83 1e 02 01 00 02 02 01 02 03 ff 01 46"
    (frame,) = protocol1.parser().feed(packet)
    assert frame.code == Instruction.SYNC_WRITE
    mixed = [*wired("MX-28", 1, 2), Wired(2, 3, find_table("XM430-W350", 2))]
    packets = sent(mixed, np.array([1, 2, 3]), np.full(3, True))
    assert [packet[:4] for packet in packets] == [b"\xff\xff\xfe\x0a", b"\xff\xff\xfd\x00"]


def test_a_header_among_the_goals_is_stuffed() -> None:
    goals = np.array([0xFDFFFF, -0x020001, 0xFDFFFF - 2**24])
    (packet,) = sent(wired("XM430-W350", 2), goals, np.full(3, True))
    assert packet.count(protocol2.HEADER) == 1
    assert packet.count(b"\xff\xff\xfd\xfd") >= 1
    (frame,) = protocol2.parser().feed(packet)
    rows = np.frombuffer(frame.params[4:], dtype=[("id", "u1"), ("goal", "<i4")])
    assert rows["id"].tolist() == [1, 2, 3]
    assert rows["goal"].tolist() == goals.tolist()


def test_a_limp_servo_of_protocol_1_is_sent_no_goal() -> None:
    (packet,) = sent(wired("AX-12A", 1), np.array([512, 513, 511]), np.array([True, False, True]))
    (frame,) = protocol1.parser().feed(packet)
    assert len(frame.params) == 2 + 2 * 3
    assert sent(wired("AX-12A", 1), np.array([512, 513, 511]), np.full(3, False)) == []
    (packet,) = sent(wired("XM430-W350", 2), np.array([1, 2, 3]), np.full(3, False))
    assert len(packet) == 10 + 4 + 3 * 5


def test_the_share_is_of_the_last_cycles_only() -> None:
    error_rate = ErrorRate()

    def noted(now: float, retries: int, spoiled: int) -> float:
        error_rate.retries += retries
        error_rate.spoiled += spoiled
        assert error_rate.note(now) == retries
        return error_rate.share

    assert [noted(0.01 * cycle, RETRIES, 1) * FEWEST for cycle in range(FEWEST)] == [*range(1, FEWEST + 1)]
    assert [noted(1.0 + 0.01 * cycle, 0, 0) for cycle in range(100)][-1] == 0.0
    assert 0.0 < noted(2.0, RETRIES, 1) <= 1.0 / (WINDOW_S / 0.01 - 1.0)


# Group reads, registers side by side, and pings.

SLACK = 0.004


def test_a_line_that_never_falls_silent_is_left() -> None:
    port = ScriptedPort(lambda request: [(1e-5 * at, bytes(1000)) for at in range(200)])
    received = single_requests.broadcast_ping(port, 252, SLACK)
    assert received.damaged <= single_requests.MAX_RECEIVED + 1000
    assert port.now() < 0.1


SIZE = 10
BYTE = 10 / 1_000_000
IDS = tuple(range(1, 21))
REPLY = more_frames.fast_status([Status(device, 0, bytes(range(device, device + SIZE))) for device in IDS])


def listened(reply: bytes, *, pause: float = 0.0) -> tuple[int, float, float, int]:
    """Of a reply that comes in parts from 1 ms on, with a pause in the middle: how many answers there are, when it is
    known that there are no more, the silence that ends it, s, and how often was waited."""
    port = ScriptedPort(always())
    cuts = [0, *range(8 + SIZE + 4, len(reply), SIZE + 4), len(reply)]
    for place, (begin, end) in enumerate(pairwise(cuts)):
        port.feed(reply[begin:end], 1e-3 + BYTE * end + (pause if place >= 7 else 0.0))
    request = ReadRequest(ReadKind.FAST, IDS, 126, SIZE)
    timeouts = request.timeouts(port, 0.0)
    found = collect(port, request, 0.0, timeouts)
    return len(found.answers), port.now(), timeouts.idle, port.waits


@pytest.mark.parametrize("pause", [0.0, 0.2e-3, 0.8e-3])
def test_a_whole_reply_is_there_with_its_last_byte_and_a_pause_in_the_middle_is_waited_for(pause: float) -> None:
    answers, known, _, waits = listened(REPLY, pause=pause)
    assert answers == 20 and (pause or waits <= 2)
    assert known == pytest.approx(1e-3 + BYTE * len(REPLY) + pause, abs=2 * (SIZE + 4) * BYTE if pause else 1e-9)


@pytest.mark.parametrize("count", [1, 2, 10, 19])
def test_silence_is_counted_from_the_last_byte_and_not_from_the_read(count: int) -> None:
    end = 8 + (SIZE + 4) * count
    answers, known, idle, _ = listened(REPLY[:end])
    assert answers == count and known <= 1e-3 + BYTE * end + idle + 1e-9


def test_an_answer_to_the_same_request_in_another_order_is_taken() -> None:
    """A request is repeated in another order; the answer to the first one may still come."""
    parts = [Status(device, 0, bytes((device, 0, 0, 0))) for device in (1, 2, 3)]
    found = ReadRequest(ReadKind.FAST, (3, 2, 1), 132, 4).answers(more_frames.fast_status(parts))
    assert found == side_by_side(parts)
    assert not ReadRequest(ReadKind.FAST, (3, 2, 4), 132, 4).answers(more_frames.fast_status(parts[:2])).ids


# Watching servos that another process drives: their torque is shown as they report it.


def test_torque_is_what_the_servos_say_and_not_known_of_a_silent_one() -> None:
    rig = BusRig(specs(3)).ready(torque=True)
    watch = BusWatch(rig.bus.lines)
    assert watch.torque == [ReportedTorque.UNKNOWN] * 3
    watch.read()
    assert watch.torque == [ReportedTorque.ON] * 3
    rig.fault(Fault(FaultKind.MISSING, ids=(2,)))
    for _ in range(round(1.5 * TORQUE_AGE / 0.05)):
        watch.read()
        rig.clock.advance(0.05)
    assert watch.torque == [ReportedTorque.ON, ReportedTorque.UNKNOWN, ReportedTorque.ON]
    assert watch.losses[1] > 10 and np.count_nonzero(watch.losses) == 1
    rig.clear_faults()
    rig.device(2).memory.put("torque_enable", 0)
    rig.clock.advance(0.25)
    watch.read()
    assert watch.torque[0] is ReportedTorque.HELD  # no instruction for longer than the watchdog's time
    assert watch.torque[1] is ReportedTorque.OFF


# Registers of all servos of a bus at once: a silent servo makes no other one seem silent.


@pytest.mark.parametrize("gone", [(), (1,), (2,), (3,), (5,), (1, 2), (1, 3, 5), (1, 2, 3, 4), (1, 2, 3, 4, 5)])
def test_servos_that_answer_are_read_whichever_is_missing(gone: tuple[int, ...]) -> None:
    rig = BusRig(specs(5)).ready()
    if gone:
        rig.fault(Fault(FaultKind.MISSING, ids=gone))
    (line,) = rig.bus.lines
    table = rig.device(1).table
    there = [device for device in range(1, 6) if device not in gone]
    assert line.read_all(table["id"], range(1, 6)) == {device: device for device in there}
    rig.port.sent.clear()
    assert line.read_all(table["id"], []) == {}
    line.write_all(table["goal_position"], [])
    assert rig.port.sent == []
