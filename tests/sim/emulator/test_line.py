"""One segment of wire: pieces of frames, baud rates, both protocols, collisions, a host that never reads."""

from dataclasses import replace

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hardware.clock import VirtualClock
from hardware.dynamixel.codec import protocol2
from sim.emulator import line as line_module
from sim.emulator.fault_state import FaultState
from sim.emulator.faults import Fault, FaultKind
from sim.emulator.line import Line, Timing
from sim.emulator.ports import EmulatedPort
from stub_devices import StubDevice

FOREVER = 1e9
PING, STATUS = protocol2.ping(1), protocol2.status(1, 0, b"\x06\x04\x26")


def _line(*devices: StubDevice, timing: Timing | None = None, faults: tuple[Fault, ...] = ()) -> Line:
    state = FaultState(devices, faults=faults)
    return Line(devices, timing=timing or Timing.none(), faults=state)


def _ask(line: Line, data: bytes, now: float = 0.0) -> bytes:
    line.receive(data, now)
    return line.take(FOREVER)


def test_a_frame_in_pieces_is_received_behind_garbage_and_dropped_after_a_pause() -> None:
    line = _line(StubDevice())
    for byte in b"\xff\xff\xfd\x00\x01" + PING:
        line.receive(bytes((byte,)), 0.0)
    assert line.take(0.0) == STATUS
    line = _line(StubDevice(), timing=Timing())
    line.receive(PING[:5], 0.0)
    assert _ask(line, PING[5:], 0.0014) == STATUS
    line.receive(PING[:5], 1.0)
    assert _ask(line, PING[5:], 1.0 + 50 / 57600 + 0.0016) == b""
    assert _ask(line, PING, 2.0) == STATUS


def test_only_devices_at_about_the_hosts_rate_that_have_started_receive_it() -> None:
    slow, fast, nearly = StubDevice(id=1), StubDevice(id=2, baud=1_000_000), StubDevice(id=3, baud=57142)
    starts = StubDevice(id=4, boots=True)
    line = _line(slow, fast, nearly, starts)
    replies = [_ask(line, protocol2.ping(device)) for device in (1, 2, 3, 4)]
    assert [bool(reply) for reply in replies] == [True, False, True, False] and starts.heard == []
    line.baud = 1_000_000
    assert _ask(line, PING) == b"" and _ask(line, protocol2.ping(2)) == protocol2.status(2, 0, b"\x06\x04\x26")
    assert (len(slow.heard), len(fast.heard)) == (4, 2)


def test_sending_into_an_answer_spoils_both() -> None:
    device = StubDevice()
    line = _line(device, timing=Timing())
    line.receive(PING, 0.0)
    heard = _ask(line, PING, 10 * 10 / 57600 + 0.0005)
    assert len(device.done) == 1
    assert len(heard) == len(STATUS) and protocol2.parser().feed(heard) == []
    assert _ask(line, PING, 1.0) == STATUS


def test_a_host_that_never_reads_costs_no_memory() -> None:
    line = _line(StubDevice())
    for index in range(line_module.MAX_WAITING // len(STATUS) + 10):
        line.receive(PING, float(index))
    assert line.lost >= 9 * len(STATUS) and len(line.take(FOREVER)) <= line_module.MAX_WAITING


@settings(max_examples=100)
@given(st.lists(st.binary(max_size=40), max_size=6))
def test_noise_harms_no_device_and_the_next_frame_is_received(noise: list[bytes]) -> None:
    line = _line(StubDevice(id=1, store=bytearray(70000)), StubDevice(id=1, protocol=1), timing=Timing())
    for index, data in enumerate(noise):
        line.receive(data, float(index))
    line.take(FOREVER)
    assert STATUS in _ask(line, PING, 1000.0)


def test_a_dead_line_an_echo_and_a_lost_adapter() -> None:
    line = _line(
        StubDevice(),
        faults=(
            Fault(FaultKind.SHORT, start=1.0, end=2.0, value=4.0),
            Fault(FaultKind.ECHO, start=2.0, end=3.0),
            Fault(FaultKind.UNPLUG, start=3.0, end=4.0),
        ),
    )
    assert _ask(line, PING, 0.5) == STATUS
    assert len(_ask(line, PING, 1.5)) == 4
    assert _ask(line, PING, 2.5) == PING + STATUS
    line.receive(PING, 2.9)
    assert line.unplugged(3.5) and line.take(FOREVER) == b""
    assert not line.unplugged(4.5) and _ask(line, PING, 4.6) == STATUS


def test_what_comes_together_ends_at_its_last_byte() -> None:
    line = _line(*(StubDevice(id=index) for index in (1, 2, 3)), timing=Timing())
    assert line.last_due_within(1.0) is None
    line.receive(protocol2.sync_read(0, 1, [1, 2, 3]), 0.0)
    first = line.next_due
    assert first is not None
    one = 120 / 57600 + 20e-6  # a status of 12 bytes
    due = [line.last_due_within(span) for span in (0.0, 1.5 * one, 1.0)]
    assert due == pytest.approx([first, first + one, first + 2 * one])


BAUDS = (1_000_000, 2_000_000, 3_000_000, 4_000_000, 4_500_000)
USUAL, WIRE_ONLY = Timing(), Timing(turnaround=0.0, latency=0.0)


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
        (Timing(latency=16e-3), 20, 10, False, 0.0, (22.1, 19.2, 18.3, 17.8, 17.7)),
        (Timing.none(), 20, 10, False, 500e-6, (0.0,)),
        (replace(Timing.none(), return_delay=0.5), 1, 10, False, 500e-6, (0.25,)),
    ],
)
def test_cycle_times_are_those_of_the_table(
    timing: Timing, count: int, length: int, fast: bool, return_delay: float, each_ms: tuple[float, ...]
) -> None:
    """At each of BAUDS: a sync write of 4 bytes, then a plain or fast sync read of `length` bytes, first byte out to
    last byte in."""
    ids = range(1, count + 1)
    found = []
    for baud in BAUDS[: len(each_ms)]:
        clock = VirtualClock(3.0)
        devices = [StubDevice(id=index, baud=baud, return_delay=return_delay) for index in ids]
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
