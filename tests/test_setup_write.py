"""One EEPROM value written, and seen to be kept."""

import pytest

from bus_rig import BusRig, specs
from hardware.dynamixel.baud_codes import code_of
from hardware.dynamixel.line_scan import Speed
from hardware.dynamixel.settings import Setting
from hardware.dynamixel.setup_write import write_setting
from hardware.errors import BusError
from sim.emulator.faults import Direction, Fault, FaultKind
from support.messages import refuses

SPEED = Speed(2, 2_000_000)


def _written(rig: BusRig, name: str, value: int) -> tuple[int, Speed]:
    rig.port.open(SPEED.baud)
    table = rig.devices[1].table
    return write_setting(rig.port, table, 2, SPEED, Setting(table[name], value))


@pytest.mark.parametrize("lost", [(), (Fault(FaultKind.DROP, direction=Direction.TO_HOST, end=0.01),)])
@pytest.mark.parametrize(
    ("name", "value", "after"),
    [("shutdown", 53, (2, SPEED)), ("id", 9, (9, SPEED)), ("baud_rate", 3, (2, Speed(2, 1_000_000)))],
)
def test_where_it_is_afterwards(name: str, value: int, after: tuple[int, Speed], lost: tuple[Fault, ...]) -> None:
    rig = BusRig(specs(3))
    for fault in lost:
        rig.fault(fault)
    assert _written(rig, name, value) == after
    assert rig.devices[1].memory.value(name) == value
    assert rig.port.baud == after[1].baud
    assert rig.shown(name)[0] != value


def test_a_servo_that_vanishes_is_told_with_where_it_was_looked_for() -> None:
    rig = BusRig(specs(2))
    rig.fault(Fault(FaultKind.MISSING, ids=(2,)))
    code = code_of(rig.devices[1].table, 57_600)
    assert code is not None
    with refuses(BusError, "baud_rate", 2, 57600):
        _written(rig, "baud_rate", code)
