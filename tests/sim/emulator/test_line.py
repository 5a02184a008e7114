"""One segment of wire: pieces of frames, baud rates, both protocols, collisions, a host that never reads."""

from dataclasses import replace

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hardware.clock import VirtualClock
from hardware.dynamixel.codec import protocol1, protocol2
from sim.emulator import line as line_module
from sim.emulator.fault_state import FaultState
from sim.emulator.faults import Fault, FaultKind
from sim.emulator.line import Line, Timing
from sim.emulator.ports import EmulatedPort
from stub_devices import StubDevice

FOREVER = 1e9
STATUS = protocol2.status(1, 0, b"\x06\x04\x26")


def _line(*devices: StubDevice, timing: Timing | None = None, faults: tuple[Fault, ...] = ()) -> Line:
    state = FaultState(devices, faults=faults)
    return Line(devices, timing=timing or Timing.none(), faults=state)


def _ask(line: Line, data: bytes, now: float = 0.0) -> bytes:
    line.receive(data, now)
    return line.take(FOREVER)


def test_a_frame_in_pieces_is_received() -> None:
    line = _line(StubDevice())
    for byte in protocol2.ping(1):
        line.receive(bytes((byte,)), 0.0)
    assert line.take(0.0) == STATUS


def test_a_pause_inside_a_frame_drops_it() -> None:
    ping = protocol2.ping(1)
    line = _line(StubDevice(), timing=Timing())
    line.receive(ping[:5], 0.0)
    line.receive(ping[5:], 0.0014)
    assert line.take(FOREVER) == STATUS
    line.receive(ping[:5], 1.0)
    line.receive(ping[5:], 1.0 + 50 / 57600 + 0.0016)
    assert line.take(FOREVER) == b""
    assert _ask(line, ping, 2.0) == STATUS


def test_garbage_before_a_frame_is_skipped() -> None:
    line = _line(StubDevice())
    assert _ask(line, b"\xff\xff\xfd\x00\x01" + protocol2.ping(1)) == STATUS


def test_several_frames_in_one_write_are_carried_out_in_order() -> None:
    line = _line(StubDevice(id=1), StubDevice(id=2))
    data = protocol2.sync_write(100, 1, [(2, b"\x55")]) + protocol2.sync_read(100, 1, [2, 1])
    assert _ask(line, data) == protocol2.status(2, 0, b"\x55") + protocol2.status(1, 0, b"\0")


def test_only_devices_at_the_hosts_rate_receive_it() -> None:
    slow, fast = StubDevice(id=1), StubDevice(id=2, baud=1_000_000)
    line = _line(slow, fast)
    assert _ask(line, protocol2.ping(2)) == b""
    line.baud = 1_000_000
    assert _ask(line, protocol2.ping(1)) == b""
    assert _ask(line, protocol2.ping(2)) == protocol2.status(2, 0, b"\x06\x04\x26")
    assert (len(slow.heard), len(fast.heard)) == (1, 2)


def test_a_rate_that_is_nearly_right_will_do() -> None:
    line = _line(StubDevice(baud=57142))
    assert _ask(line, protocol2.ping(1)) == STATUS


def test_a_device_that_starts_is_deaf() -> None:
    device = StubDevice(boots=True)
    assert _ask(_line(device), protocol2.ping(1)) == b""
    assert device.heard == []


def test_both_protocols_on_one_line() -> None:
    line = _line(StubDevice(id=1), StubDevice(id=1, protocol=1))
    assert _ask(line, protocol2.ping(1)) == STATUS
    assert _ask(line, protocol1.ping(1), 1.0) == protocol1.status(1)


def test_sending_into_an_answer_spoils_both() -> None:
    device = StubDevice()
    line = _line(device, timing=Timing())
    line.receive(protocol2.ping(1), 0.0)
    line.receive(protocol2.ping(1), 10 * 10 / 57600 + 0.0005)
    assert len(device.done) == 1
    heard = line.take(FOREVER)
    assert len(heard) == len(STATUS)
    assert protocol2.parser().feed(heard) == []
    assert _ask(line, protocol2.ping(1), 1.0) == STATUS


def test_bytes_come_at_their_time() -> None:
    line = _line(StubDevice(), timing=Timing())
    line.receive(protocol2.ping(1), 0.0)
    due = line.next_due
    assert due is not None
    assert line.take(due - 1e-9) == b""
    assert line.take(due) == STATUS
    assert line.next_due is None


def test_a_host_that_never_reads_costs_no_memory() -> None:
    line = _line(StubDevice())
    for index in range(line_module.MAX_WAITING // len(STATUS) + 10):
        line.receive(protocol2.ping(1), float(index))
    assert line.lost >= 9 * len(STATUS)
    assert len(line.take(FOREVER)) <= line_module.MAX_WAITING


@settings(max_examples=100)
@given(st.lists(st.binary(max_size=40), max_size=6))
def test_noise_harms_no_device_and_the_next_frame_is_received(noise: list[bytes]) -> None:
    line = _line(StubDevice(id=1, store=bytearray(70000)), StubDevice(id=1, protocol=1), timing=Timing())
    for index, data in enumerate(noise):
        line.receive(data, float(index))
    line.take(FOREVER)
    assert STATUS in _ask(line, protocol2.ping(1), 1000.0)


def test_a_dead_line_an_echo_and_a_lost_adapter() -> None:
    ping = protocol2.ping(1)
    line = _line(
        StubDevice(),
        faults=(
            Fault(FaultKind.SHORT, start=1.0, end=2.0, value=4.0),
            Fault(FaultKind.ECHO, start=2.0, end=3.0),
            Fault(FaultKind.UNPLUG, start=3.0, end=4.0),
        ),
    )
    assert _ask(line, ping, 0.5) == STATUS
    assert len(_ask(line, ping, 1.5)) == 4
    assert _ask(line, ping, 2.5) == ping + STATUS
    line.receive(ping, 2.9)
    assert line.unplugged(3.5)
    assert line.take(FOREVER) == b""
    assert not line.unplugged(4.5)
    assert _ask(line, ping, 4.6) == STATUS


def test_missing_and_silent_devices() -> None:
    request = protocol2.sync_read(0, 1, [1, 2, 3])
    line = _line(
        *(StubDevice(id=index) for index in (1, 2, 3)),
        faults=(Fault(FaultKind.MISSING, ids=(2,), end=1.0), Fault(FaultKind.SILENT_TAIL, ids=(3,), start=1.0)),
    )
    one = len(protocol2.status(1, 0, b"\0"))
    assert len(_ask(line, request, 0.5)) == one
    assert _ask(line, protocol2.ping(2), 0.6) == b""
    assert len(_ask(line, request, 1.5)) == 2 * one
    assert _ask(line, protocol2.ping(3), 1.6) != b""


def test_faults_by_cycle_count_group_reads() -> None:
    line = _line(StubDevice(), faults=(Fault(FaultKind.MISSING, from_cycle=1, to_cycle=2),))
    seen = []
    for index in range(4):
        line.receive(protocol2.ping(0xFE), index - 0.5)
        line.take(FOREVER)
        seen.append(bool(_ask(line, protocol2.sync_read(0, 1, [1]), float(index))))
    assert seen == [True, False, True, True]


def test_a_late_answer_holds_up_what_follows() -> None:
    line = _line(StubDevice(id=1), StubDevice(id=2), faults=(Fault(FaultKind.LATE, ids=(1,), value=0.25),))
    line.receive(protocol2.sync_read(0, 1, [1, 2]), 1.0)
    assert line.last_due_within(1.0) == 1.25
    assert line.take(1.2499) == b""
    assert line.take(1.25) == protocol2.status(1, 0, b"\0") + protocol2.status(2, 0, b"\0")


def test_what_comes_together_ends_at_its_last_byte() -> None:
    line = _line(*(StubDevice(id=index) for index in (1, 2, 3)), timing=Timing())
    assert line.last_due_within(1.0) is None
    line.receive(protocol2.sync_read(0, 1, [1, 2, 3]), 0.0)
    first = line.next_due
    assert first is not None
    one = 120 / 57600 + 20e-6  # a status of 12 bytes
    assert line.last_due_within(0.0) == first
    assert line.last_due_within(1.5 * one) == pytest.approx(first + one)
    assert line.last_due_within(1.0) == pytest.approx(first + 2 * one)


BAUDS = (1_000_000, 2_000_000, 3_000_000, 4_000_000, 4_500_000)
# Cycle in ms: sync write of 4 bytes, then a read of `length` bytes, by plain or fast sync read, at BAUDS.
TABLE = [
    (20, 10, False, 0.0, (7.08, 4.24, 3.29, 2.82, 2.66)),
    (20, 10, True, 0.0, (5.38, 3.20, 2.47, 2.11, 1.99)),
    (20, 10, False, 500e-6, (17.1, 14.2, 13.3, 12.8, 12.7)),
    (30, 10, False, 0.0, (9.98, 5.79, 4.39, 3.70, 3.46)),
    (30, 10, True, 0.0, (7.38, 4.20, 3.14, 2.61, 2.43)),
    (30, 10, False, 500e-6, (25.0, 20.8, 19.4, 18.7, 18.5)),
    (20, 4, False, 0.0, (5.88, 3.64, 2.89, 2.52, 2.40)),
    (20, 4, True, 0.0, (4.18, 2.60, 2.07, 1.81, 1.72)),
    (10, 10, False, 0.0, (4.18, 2.69, 2.19, 1.95)),
    (10, 10, True, 0.0, (3.38, 2.20, 1.81, 1.61)),
]
WIRE_ONLY = [
    (20, 10, False, 0.0, (5.68, 2.84, 1.89, 1.42, 1.26)),
    (20, 10, True, 0.0, (4.36, 2.18, 1.45, 1.09, 0.97)),
    (30, 10, True, 0.0, (6.36, 3.18, 2.12, 1.59, 1.41)),
]
ROWS = [(Timing(), *row) for row in TABLE]
ROWS += [(Timing(turnaround=0.0, latency=0.0), *row) for row in WIRE_ONLY]
ROWS += [(Timing(latency=16e-3), 20, 10, False, 0.0, (22.1, 19.2, 18.3, 17.8, 17.7))]
EACH = [(*row[:-1], baud, ms) for row in ROWS for baud, ms in zip(BAUDS, row[-1], strict=False)]


def _cycle(timing: Timing, count: int, length: int, fast: bool, return_delay: float, baud: int) -> float:
    """Time in s from the first byte out to the last byte in."""
    clock = VirtualClock(3.0)
    devices = [StubDevice(id=index, baud=baud, return_delay=return_delay) for index in range(1, count + 1)]
    port = EmulatedPort(Line(devices, timing=timing), clock)
    port.open(baud)
    ids = range(1, count + 1)
    port.write(protocol2.sync_write(116, 4, [(index, bytes(4)) for index in ids]))
    port.write(protocol2.sync_read(126, length, ids, fast=fast))
    wanted = 8 + count * (length + 4) if fast else count * (11 + length)
    got = 0
    while got < wanted:
        assert port.wait(4.0)
        got += len(port.read())
    assert got == wanted
    return clock.now() - 3.0


@pytest.mark.parametrize(("timing", "count", "length", "fast", "delay", "baud", "ms"), EACH)
def test_cycle_times_are_those_of_the_table(
    timing: Timing, count: int, length: int, fast: bool, delay: float, baud: int, ms: float
) -> None:
    assert _cycle(timing, count, length, fast, delay, baud) * 1e3 == pytest.approx(ms, rel=0.01)


def test_without_delays_nothing_takes_time() -> None:
    assert _cycle(Timing.none(), 20, 10, False, 500e-6, 57600) == 0.0


def test_a_share_of_the_return_delay() -> None:
    assert replace(Timing(), return_delay=0.5).before_status(1e-3) == pytest.approx(0.5e-3 + 20e-6)
