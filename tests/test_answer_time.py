"""Whether a cycle would wait long enough for the answers of a line."""

import pytest

from bus_rig import BusRig, bus_of, specs
from hardware.dynamixel.answer_time import LOOKS, too_slow
from sim.emulator.faults import Fault, FaultKind
from sim.emulator.wire import Timing


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
    assert "slower than a cycle allows" in said and "latency timer" in said
    assert "found 7." in said  # ms: turnaround, return delay, latency, bytes
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
