"""Servos as found, and torque off by broadcasts at unknown speeds."""

import pytest

from bus_rig import BusRig, bus_of, specs
from hardware.dynamixel.control_table import code_of
from hardware.dynamixel.found_servos import (
    as_bus,
    broadcast_torque_off,
)
from hardware.dynamixel.line_scan import Sighting, Speed, all_speeds, scan_line
from hardware.errors import BusError
from messages import refuses


def _rig(model: str = "XM430-W350", protocol: int = 2) -> BusRig:
    servos = specs(3, model)
    rig = BusRig(servos, buses=[bus_of(servos, protocol=protocol, baud=1_000_000)])
    rig.port.open(1_000_000)
    slow = rig.devices[1]
    slow.memory.put("baud_rate", code_of(slow.table, 57_600) or 0)
    slow.tune()
    for one in rig.devices:
        one.memory.put("torque_enable", 1)
    return rig


@pytest.mark.parametrize(
    ("model", "protocol"), [("XM430-W350", 2), ("MX-28", 2), ("XL-320", 2), ("MX-28", 1), ("AX-12A", 1)]
)
def test_all_servos_receive_it_within_a_second_at_any_speed(model: str, protocol: int) -> None:
    rig = _rig(model, protocol)
    begun = rig.clock.now()
    broadcast_torque_off(rig.port, all_speeds(), [rig.devices[0].table])
    assert rig.clock.now() - begun < 1.0
    assert rig.shown("torque_enable") == [0, 0, 0]


def test_servos_at_other_speeds_than_an_impossible_one_receive_it(monkeypatch: pytest.MonkeyPatch) -> None:
    rig = _rig()
    set_baud = rig.port.set_baud

    def limited(baud: int) -> None:
        if baud < 100_000:
            raise BusError("no such baud rate.")
        set_baud(baud)

    monkeypatch.setattr(rig.port, "set_baud", limited)
    broadcast_torque_off(rig.port, all_speeds())
    assert rig.shown("torque_enable") == [0, 1, 0]


SPEED = Speed(2, 2_000_000)


def _sightings(rig: BusRig) -> tuple[Sighting, ...]:
    if not rig.port.opened:
        rig.port.open(SPEED.baud)
    return scan_line(rig.port, [SPEED]).sightings


def test_several_speeds_are_refused_with_what_was_seen() -> None:
    rig = BusRig(specs(2))
    one, two = _sightings(rig)
    with refuses(BusError, "1.0", 57600, "2.0", 2000000):
        as_bus("here", [one, Sighting(two.found, Speed(1, 57_600))])
