"""Torque of servos without a table: one place for each protocol."""

import pytest

from bus_rig import BusRig, bus_of, specs
from hardware.dynamixel.bus_line import BusLine
from hardware.dynamixel.control_table import tables
from hardware.dynamixel.discovery import Found
from hardware.dynamixel.unread import TORQUE_ENABLE, is_controller, not_limp, tell_off
from sim.emulator.faults import Fault, FaultKind


def test_every_known_model_has_its_torque_there() -> None:
    for table in tables():
        known = table["torque_enable"]
        assert (known.address, known.size) == (TORQUE_ENABLE[table.protocol].address, 1), table.model


@pytest.mark.parametrize("protocol", [1, 2])
def test_a_line_that_knows_nobody_switches_them_off_and_asks(protocol: int) -> None:
    servos = specs(4, "MX-28")
    rig = BusRig(servos, buses=[bus_of(servos, protocol=protocol, baud=1_000_000)])
    rig.port.open(1_000_000)
    line = BusLine(rig.buses[0], rig.port, [])
    for one in rig.devices[:3]:
        one.memory.put("torque_enable", 1)
    rig.fault(Fault(FaultKind.MISSING, ids=(3,)))
    assert not_limp(line, [1, 2, 3, 4]) == [1, 2, 3]
    tell_off(line, [1, 3])
    assert rig.shown("torque_enable") == [0, 1, 1, 0]
    assert not_limp(line, [1, 2, 3, 4]) == [2, 3]


def test_a_controller_has_none() -> None:
    assert is_controller(Found(200, 2, 0x7400)) and not is_controller(Found(1, 2, 1120))
