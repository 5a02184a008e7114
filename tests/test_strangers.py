"""Everybody who answers on a bus, whether the profile knows them or not."""

import pytest

from bus_rig import BusRig, bus_of, spec, specs
from hardware.dynamixel.one_off import OneOff
from hardware.dynamixel.strangers import everybody
from sim.emulator.faults import Fault, FaultKind
from sim.emulator.wire import Timing


@pytest.mark.parametrize(("protocol", "model"), [(1, "AX-12A"), (1, "MX-28"), (2, "MX-28"), (2, "XM430-W350")])
def test_all_are_found_and_nothing_comes_afterwards(protocol: int, model: str) -> None:
    servos = specs(3, model)
    buses = [bus_of(servos, protocol=protocol, baud=1_000_000)]
    rig = BusRig(servos, buses=buses, strangers=[spec(0, model), spec(40, model), spec(252, model)])
    rig.port.open(1_000_000)
    begun = rig.clock.now()
    found, told = everybody(rig.port, OneOff(rig.port, protocol), rig.buses[0])
    assert [one.id for one in found] == [0, 1, 2, 3, 40, 252] and told == []
    assert len({one.model for one in found}) == 1 and not any(one.clash for one in found)
    assert rig.clock.now() - begun < 1.1
    rig.clock.advance(1.0)
    assert rig.port.read() == b""


def test_noise_is_no_stranger() -> None:
    rig = BusRig(specs(2))
    rig.port.open(2_000_000)
    rig.fault(Fault(FaultKind.SHORT, value=40))
    found, _ = everybody(rig.port, OneOff(rig.port, 2), rig.buses[0])
    assert {one.id for one in found} <= {1, 2}


def test_where_it_would_take_too_long_it_is_told() -> None:
    servos = specs(2, "AX-12A")
    slow = Timing(latency=0.016)
    buses = [bus_of(servos, protocol=1, baud=1_000_000)]
    rig = BusRig(servos, buses=buses, timing=slow, strangers=[spec(9, "AX-12A")])
    rig.port.open(1_000_000)
    found, told = everybody(rig.port, OneOff(rig.port, 1), rig.buses[0])
    assert [one.id for one in found] == [1, 2]
    assert told == ["bus main: too slow to look for servos that the profile does not know"]
