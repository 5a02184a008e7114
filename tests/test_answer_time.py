"""Whether a cycle would wait long enough for the answers of a line."""

import pytest

from bus_rig import BusRig, bus_of, specs
from hardware.dynamixel import protocol2
from hardware.dynamixel.answer_time import LOOKS, too_slow
from hardware.dynamixel.control_table import find_table
from hardware.dynamixel.exchange import Ask, Kind
from scripted_port import ScriptedPort
from sim.emulator.faults import Fault, FaultKind
from sim.emulator.wire import Timing
from support.messages import shows


def _said(protocol: int, turnaround: float, *faults: Fault) -> tuple[str, BusRig]:
    servos = specs(2, "MX-28")
    buses = [bus_of(servos, protocol=protocol, baud=1_000_000)]
    rig = BusRig(servos, buses=buses, timing=Timing(turnaround=turnaround))
    rig.port.open(1_000_000)
    for fault in faults:
        rig.fault(fault)
    return too_slow(rig.port, rig.devices[0].table, 1, 500e-6), rig


@pytest.mark.parametrize("protocol", [1, 2])
def test_a_line_is_held_against_what_a_cycle_waits(protocol: int) -> None:
    assert _said(protocol, 20e-6)[0] == ""
    said, rig = _said(protocol, 0.006)
    shows(said, "7.")
    # ms: turnaround, return delay, latency, bytes
    assert len(rig.port.sent) == LOOKS
    rig.clock.advance(1.0)
    assert rig.port.read() == b""


@pytest.mark.parametrize("protocol", [1, 2])
def test_an_echo_is_no_answer(protocol: int) -> None:
    assert _said(protocol, 0.006, Fault(FaultKind.ECHO))[0]
    assert not _said(protocol, 20e-6, Fault(FaultKind.ECHO))[0]


def test_one_fast_answer_is_enough_and_silence_is_told_elsewhere() -> None:
    assert _said(2, 20e-6, Fault(FaultKind.LATE, value=0.05, end=0.1))[0] == ""
    assert _said(2, 20e-6, Fault(FaultKind.MISSING, ids=(1,)))[0] == ""


@pytest.mark.parametrize("late", [0.004, 0.030])
def test_an_answer_in_pieces_is_no_quick_one(late: float) -> None:
    """The tail of one answer must not be taken for the beginning of the next."""
    table = find_table("XM430-W350", 2)
    status = protocol2.status(1, 0, b"\x00\x08\x00\x00")

    def in_pieces(request: bytes) -> list[tuple[float, bytes]]:
        return [(late, status[:5]), (late + 0.001, status[5:10]), (late + 0.002, status[10:])]

    port = ScriptedPort(in_pieces, baud=57_600)
    told = too_slow(port, table, 1, 0.0)
    allowed = Ask(Kind.SYNC, (1,), 132, 4).timeouts(port, 0.0).first
    assert bool(told) == (late > allowed)
