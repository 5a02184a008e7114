"""An adapter that gives back what is sent: opening says so, once."""

import pytest

from bus_rig import BusRig, bus_of, specs
from hardware.dynamixel.echo import ECHOES
from hardware.dynamixel.one_off import OneOff
from hardware.dynamixel.opening import examine
from sim.emulator.faults import Fault, FaultKind


@pytest.mark.parametrize(("model", "protocol"), [("XM430-W350", 2), ("MX-28", 1), ("AX-12A", 1)])
@pytest.mark.parametrize("echo", [False, True])
@pytest.mark.parametrize("silent", [False, True])
def test_opening_tells_of_it_once(model: str, protocol: int, echo: bool, silent: bool) -> None:
    servos = specs(2, model)
    rig = BusRig(servos, buses=[bus_of(servos, protocol=protocol, baud=1_000_000)])
    rig.port.open(1_000_000)
    if echo:
        rig.fault(Fault(FaultKind.ECHO))
    if silent:
        rig.fault(Fault(FaultKind.MISSING))
    bus = rig.buses[0]
    opening = examine(rig.port, OneOff(rig.port, protocol), bus, servos)
    told = sum(ECHOES in note for note in opening.notes)
    assert told == (1 if echo else 0) or (silent and protocol == 1)
    assert bool(opening.problems) is silent


def test_a_ping_of_1_0_proves_no_echo() -> None:
    servos = specs(1, "AX-12A")
    rig = BusRig(servos, buses=[bus_of(servos, protocol=1, baud=1_000_000)])
    rig.port.open(1_000_000)
    rig.fault(Fault(FaultKind.OVER_TEMPERATURE))
    client = OneOff(rig.port, 1)
    assert client.ping(1) is not None and client.scan([1]) and not client.echoes
