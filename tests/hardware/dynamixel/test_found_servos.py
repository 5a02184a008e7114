"""Servos as found, and torque off by broadcasts at unknown speeds."""

import pytest

from bus_rig import BusRig, specs
from hardware.dynamixel.control_table import code_of
from hardware.dynamixel.found_servos import as_bus, broadcast_torque_off
from hardware.dynamixel.line_scan import Sighting, Speed, all_speeds, scan_line
from hardware.errors import BusError
from messages import refuses


@pytest.mark.parametrize(
    ("model", "protocol"), [("XM430-W350", 2), ("MX-28", 2), ("XL-320", 2), ("MX-28", 1), ("AX-12A", 1)]
)
@pytest.mark.parametrize("slowest", [0, 100_000])
def test_all_servos_at_any_possible_speed_receive_it_within_a_second(
    model: str, protocol: int, slowest: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    rig = BusRig(specs(3, model), protocol=protocol, baud=1_000_000)
    rig.port.open(1_000_000)
    table = rig.devices[1].table
    rig.put(2, baud_rate=code_of(table, 57_600) or 0)
    rig.put(torque_enable=1)
    set_baud = rig.port.set_baud

    def limited(baud: int) -> None:
        if baud < slowest:
            raise BusError("no such baud rate.")
        set_baud(baud)

    monkeypatch.setattr(rig.port, "set_baud", limited)
    begun = rig.clock.now()
    broadcast_torque_off(rig.port, all_speeds(), [table])
    assert rig.clock.now() - begun < 1.0
    assert rig.shown("torque_enable") == [0, int(slowest > 0), 0]


def test_several_speeds_are_refused_with_what_was_seen() -> None:
    rig = BusRig(specs(2))
    rig.port.open(2_000_000)
    one, two = scan_line(rig.port, [Speed(2, 2_000_000)]).sightings
    with refuses(BusError, "1.0", 57600, "2.0", 2000000):
        as_bus("here", [one, Sighting(two.found, Speed(1, 57_600))])
