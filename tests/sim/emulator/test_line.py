"""One segment of wire: pieces of frames, baud rates, both protocols, collisions, a host that never reads."""

import random
from collections.abc import Sequence
from dataclasses import replace

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import more_frames
from emulated import PING, STATUS, numbered, servo1
from hardware.clock import VirtualClock
from hardware.dynamixel.codec import BROADCAST, CODECS, Instruction, protocol1, protocol2
from sim.emulator import line as line_module
from sim.emulator.conversation import Conduct, Conversation, Gaps, Reply, reads1, reads2, writes1, writes2
from sim.emulator.device import Device
from sim.emulator.fault_state import FaultState
from sim.emulator.faults import Fault, FaultKind
from sim.emulator.line import Line, LineTiming
from sim.emulator.ports import EmulatedPort

FOREVER = 1e9


def _line(*devices: Device, timing: LineTiming | None = None, faults: tuple[Fault, ...] = ()) -> Line:
    state = FaultState(devices, faults=faults)
    return Line(devices, timing=timing or LineTiming.none(), faults=state)


def _answer(line: Line, data: bytes, now: float = 0.0) -> bytes:
    line.receive(data, now)
    return line.take(FOREVER)


def test_a_frame_in_pieces_is_received_behind_garbage_and_dropped_after_a_pause() -> None:
    line = _line(numbered())
    for byte in b"\xff\xff\xfd\x00\x01" + PING:
        line.receive(bytes((byte,)), 0.0)
    assert line.take(0.0) == STATUS
    line = _line(numbered(), timing=LineTiming())
    line.receive(PING[:5], 0.0)
    assert _answer(line, PING[5:], 0.0014) == STATUS
    line.receive(PING[:5], 1.0)
    assert _answer(line, PING[5:], 1.0 + 50 / 57600 + 0.0016) == b""
    assert _answer(line, PING, 2.0) == STATUS


def test_only_devices_at_about_the_hosts_rate_that_have_started_receive_it() -> None:
    starts = numbered(3)
    starts.power_cut(0.0)
    line = _line(numbered(1), numbered(2, baud=1_000_000), starts)
    at = {57600: [True, False, False], 57142: [True, False, False], 1_000_000: [False, True, False]}
    for line.baud, answers in at.items():
        assert [bool(_answer(line, protocol2.ping(device))) for device in (1, 2, 3)] == answers


def test_sending_into_an_answer_spoils_both() -> None:
    device = numbered()
    line = _line(device, timing=LineTiming())
    line.receive(PING, 0.0)
    answer = _answer(line, protocol2.write(1, 65, b"\1"), 10 * 10 / 57600 + 0.0005)
    assert device.memory.value("led") == 0
    assert len(answer) == len(STATUS) and protocol2.parser().feed(answer) == []
    assert _answer(line, PING, 1.0) == STATUS


def test_a_host_that_never_reads_costs_no_memory() -> None:
    line = _line(numbered())
    for index in range(line_module.MAX_WAITING // len(STATUS) + 10):
        line.receive(PING, float(index))
    assert line.lost >= 9 * len(STATUS) and len(line.take(FOREVER)) <= line_module.MAX_WAITING


@settings(max_examples=100)
@given(st.lists(st.binary(max_size=40), max_size=6))
def test_noise_harms_no_device_and_the_next_frame_is_received(noise: list[bytes]) -> None:
    line = _line(numbered(), servo1(), timing=LineTiming())
    for index, data in enumerate(noise):
        line.receive(data, float(index))
    line.take(FOREVER)
    assert STATUS in _answer(line, PING, 1000.0)


def test_a_dead_line_an_echo_and_a_lost_adapter() -> None:
    short = Fault(FaultKind.SHORT, start=1.0, end=2.0, value=4.0)
    echo, unplug = Fault(FaultKind.ECHO, start=2.0, end=3.0), Fault(FaultKind.UNPLUG, start=3.0, end=4.0)
    line = _line(numbered(), faults=(short, echo, unplug))
    assert _answer(line, PING, 0.5) == STATUS
    assert len(_answer(line, PING, 1.5)) == 4
    assert _answer(line, PING, 2.5) == PING + STATUS
    line.receive(PING, 2.9)
    assert line.unplugged(3.5) and line.take(FOREVER) == b""
    assert not line.unplugged(4.5) and _answer(line, PING, 4.6) == STATUS


def test_what_comes_together_ends_at_its_last_byte() -> None:
    line = _line(*map(numbered, (1, 2, 3)), timing=LineTiming())
    assert line.last_due_within(1.0) is None
    line.receive(protocol2.sync_read(0, 1, [1, 2, 3]), 0.0)
    first = line.next_due
    assert first is not None
    one = 120 / 57600 + 20e-6  # a status of 12 bytes
    due = [line.last_due_within(span) for span in (0.0, 1.5 * one, 1.0)]
    assert due == pytest.approx([first, first + one, first + 2 * one])


BAUDS = (1_000_000, 2_000_000, 3_000_000, 4_000_000, 4_500_000)
USUAL, WIRE_ONLY = LineTiming(), LineTiming(turnaround=0.0, latency=0.0)


@pytest.mark.parametrize(
    ("timing", "count", "length", "fast", "return_delay", "each_ms"),
    [
        (USUAL, 20, 10, False, 0.0, (7.08, 4.24, 3.29, 2.82, 2.66)),
        (USUAL, 20, 10, True, 0.0, (5.38, 3.20, 2.47, 2.11, 1.99)),
        (USUAL, 20, 10, False, 500e-6, (17.1, 14.2, 13.3, 12.8, 12.7)),
        (USUAL, 30, 10, False, 0.0, (9.98, 5.79, 4.39, 3.70, 3.46)),
        (USUAL, 30, 10, True, 0.0, (7.38, 4.20, 3.14, 2.61, 2.43)),
        (USUAL, 30, 10, False, 500e-6, (25.0, 20.8, 19.4, 18.7, 18.5)),
        (USUAL, 20, 4, False, 0.0, (5.88, 3.64, 2.89, 2.52, 2.40)),
        (USUAL, 20, 4, True, 0.0, (4.18, 2.60, 2.07, 1.81, 1.72)),
        (USUAL, 10, 10, False, 0.0, (4.18, 2.69, 2.19, 1.95)),
        (USUAL, 10, 10, True, 0.0, (3.38, 2.20, 1.81, 1.61)),
        (WIRE_ONLY, 20, 10, False, 0.0, (5.68, 2.84, 1.89, 1.42, 1.26)),
        (WIRE_ONLY, 20, 10, True, 0.0, (4.36, 2.18, 1.45, 1.09, 0.97)),
        (WIRE_ONLY, 30, 10, True, 0.0, (6.36, 3.18, 2.12, 1.59, 1.41)),
        (LineTiming(latency=16e-3), 20, 10, False, 0.0, (22.1, 19.2, 18.3, 17.8, 17.7)),
        (LineTiming.none(), 20, 10, False, 500e-6, (0.0,)),
        (replace(LineTiming.none(), return_delay=0.5), 1, 10, False, 500e-6, (0.25,)),
    ],
)
def test_cycle_times_are_those_of_the_table(
    timing: LineTiming, count: int, length: int, fast: bool, return_delay: float, each_ms: tuple[float, ...]
) -> None:
    """At each of BAUDS: a sync write of 4 bytes, then a plain or fast sync read of `length` bytes, first byte out to
    last byte in."""
    ids = range(1, count + 1)
    found = []
    for baud in BAUDS[: len(each_ms)]:
        clock = VirtualClock(3.0)
        devices = [numbered(index, baud=baud, return_delay=return_delay) for index in ids]
        port = EmulatedPort(Line(devices, timing=timing), clock)
        port.open(baud)
        port.write(protocol2.sync_write(116, 4, [(index, bytes(4)) for index in ids]))
        port.write(protocol2.sync_read(126, length, ids, fast=fast))
        left = 8 + count * (length + 4) if fast else count * (11 + length)
        while left > 0:
            assert port.wait(4.0)
            left -= len(port.read())
        assert left == 0
        found.append(1e3 * (clock.now() - 3.0))
    assert found == pytest.approx(each_ms, rel=0.01)


# Replies of devices: addresses, order, gaps, fast replies, two devices of one id, damaged instructions.


def _replies(
    data: bytes, devices: Sequence[Device], gaps: Gaps = Gaps.SILENCE, silent: tuple[int, ...] = ()
) -> list[Reply]:
    (frame,) = CODECS[devices[0].protocol].parser().feed(data)
    return Conversation(conduct=Conduct(gaps=gaps), noise=random.Random(0)).answers(frame, devices, 1.0, silent=silent)


def _ids(replies: Sequence[Reply]) -> list[int]:
    return [reply.id for reply in replies]


def _joined(replies: Sequence[Reply]) -> bytes:
    return b"".join(reply.data for reply in replies)


def test_a_broadcast_ping_is_answered_in_order_of_ids_and_the_rest_is_obeyed_in_silence() -> None:
    assert _ids(_replies(protocol2.ping(BROADCAST), [*map(numbered, (7, 3, 5))])) == [3, 5, 7]
    devices = numbered(1), numbered(2)
    assert _replies(protocol2.write(BROADCAST, 64, b"\x01"), devices) == []
    assert [device.memory.value("torque_enable") for device in devices] == [1, 1]
    assert _replies(more_frames.reboot(BROADCAST), devices) == []
    assert all(device.booting(1.0) for device in devices)


@pytest.mark.parametrize(
    ("request_", "ids"),
    [
        (protocol2.sync_read(132, 4, [1, 9, 2]), (1, 2)),  # 9 is missing
        (protocol2.sync_read(132, 4, [1, 3, 2]), (1, 2, 3)),  # 3 is silent in group reads
        (more_frames.bulk_read([(1, 132, 4), (1, 126, 2), (2, 132, 4)]), (1, 2)),  # an id counts once
        (protocol2.sync_read(132, 4, [1, 9, 2], fast=True), (1, 2)),
    ],
)
def test_a_gap_silences_those_behind_it_or_is_skipped(request_: bytes, ids: tuple[int, ...]) -> None:
    devices = [*map(numbered, ids)]
    assert _ids(_replies(request_, devices, silent=(3,))) == [1]
    assert _ids(_replies(request_, devices, Gaps.SKIP, silent=(3,))) == [1, 2]
    assert _ids(_replies(protocol2.ping(ids[-1]), devices, silent=(3,))) == [ids[-1]]


def test_the_fast_reply_of_the_manual() -> None:
    devices = [numbered(own, position=at) for own, at in ((3, 166.0), (4, 1023.0), (7, 2079.0))]
    replies = _replies(protocol2.sync_read(132, 4, [3, 7, 4], fast=True), devices)
    expected = "FFFFFD00FE1900550003A6000000840800071F08000016CA0004FF030000D19E"
    assert _joined(replies) == bytes.fromhex(expected)
    assert [reply.return_delay for reply in replies] == [0.0, None, None]


def test_protocol_1_has_bulk_read_and_sync_write() -> None:
    first, second, old = servo1(position=0.0), servo1(position=9.0), servo1("AX-12A", position=0.0)
    second.id = 2
    request = protocol1.bulk_read([(2, 36, 2), (1, 36, 1)])
    both = protocol1.status(2, 0, b"\x09\0") + protocol1.status(1, 0, b"\0")
    assert _joined(_replies(request, [first, second])) == both
    assert _replies(protocol1.sync_write(25, 1, [(1, b"\1")]), [first, second]) == []
    assert (first.memory.value("led"), second.memory.value("led")) == (1, 0)
    assert _ids(_replies(request, [old, second])) == [2]  # an AX knows no bulk read


@settings(max_examples=100)
@given(st.binary(max_size=30))
def test_any_parameters_are_read_without_an_error(params: bytes) -> None:
    for code in Instruction:
        for item in writes2(code, params):
            assert len(item.data) <= len(params)
        reads2(code, params)
    reads1(params)
    writes1(params)
