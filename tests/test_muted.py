"""Servos that answer pings only, told from silent ones, and brought to speak."""

import pytest

from bus_rig import BusRig, bus_of, specs
from hardware.dynamixel.muted import answers_pings_only, unmute
from hardware.dynamixel.one_off import OneOff
from sim.emulator.faults import Fault, FaultKind


def _rig(protocol: int) -> tuple[BusRig, OneOff]:
    servos = specs(3, "MX-28")
    rig = BusRig(servos, buses=[bus_of(servos, protocol=protocol, baud=1_000_000)])
    rig.port.open(1_000_000)
    rig.devices[1].memory.put("status_return_level", 0)
    rig.devices[1].tune()
    rig.fault(Fault(FaultKind.MISSING, ids=(3,)))
    return rig, OneOff(rig.port, protocol)


@pytest.mark.parametrize("protocol", [1, 2])
def test_who_answers_pings_only(protocol: int) -> None:
    _, client = _rig(protocol)
    assert [answers_pings_only(client, device) for device in (1, 2, 3)] == [False, True, False]


@pytest.mark.parametrize("protocol", [1, 2])
def test_it_is_written_without_its_answer(protocol: int) -> None:
    rig, client = _rig(protocol)
    unmute(client, 2)
    assert rig.shown("status_return_level")[1] == 2
    assert not answers_pings_only(client, 2)
