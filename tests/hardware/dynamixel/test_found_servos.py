"""Servos as found, and torque off by broadcasts at unknown speeds."""

import pytest

from bus_rig import BusRig, bus_of, spec, specs
from hardware.dynamixel.control_table import code_of
from hardware.dynamixel.cyclic import BusLine
from hardware.dynamixel.found_servos import (
    as_bus,
    broadcast_torque_off,
    look,
)
from hardware.dynamixel.line_scan import Sighting, Speed, all_speeds, scan_line
from hardware.errors import BusError
from messages import refuses
from sim.emulator.faults import Fault, FaultKind


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


@pytest.mark.parametrize(("model", "protocol"), [("XM430-W350", 2), ("MX-28", 2), ("MX-28", 1), ("AX-12A", 1)])
def test_all_servos_receive_it_within_a_second_at_any_speed(model: str, protocol: int) -> None:
    rig = _rig(model, protocol)
    begun = rig.clock.now()
    broadcast_torque_off(rig.port, all_speeds())
    assert rig.clock.now() - begun < 1.0
    assert rig.shown("torque_enable") == [0, 0, 0]


def test_an_impossible_speed_is_left_out_and_a_port_that_is_gone_is_reported(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    rig = _rig()
    set_baud = rig.port.set_baud

    def limited(baud: int) -> None:
        if baud < 100_000:
            raise BusError("no such baud rate.")
        set_baud(baud)

    monkeypatch.setattr(rig.port, "set_baud", limited)
    broadcast_torque_off(rig.port, all_speeds())
    assert rig.shown("torque_enable") == [0, 1, 0]
    monkeypatch.undo()
    rig.fault(Fault(FaultKind.UNPLUG))
    with refuses(BusError):
        broadcast_torque_off(rig.port, all_speeds())


SPEED = Speed(2, 2_000_000)


def _sightings(rig: BusRig) -> tuple[Sighting, ...]:
    if not rig.port.opened:
        rig.port.open(SPEED.baud)
    return scan_line(rig.port, [SPEED]).sightings


def test_read_missing_and_unknown_servos() -> None:
    rig = BusRig(specs(5), unknown_ids=[spec(40)])
    rig.device(2).memory.put("model_number", 1120)
    rig.device(3).memory.put("model_number", 1060)
    rig.fault(Fault(FaultKind.MISSING, ids=(4,)))
    placed = [(7 + at, servo) for at, servo in enumerate(rig.servos)]
    seen = look(BusLine(rig.buses[0], rig.port, placed), _sightings(rig))
    assert list(seen.line.images) == [1, 3, 5] and seen.missing == (4,)
    assert [one.found.id for one in seen.unknown] == [2, 40]
    assert seen.line.index_of[5] == 11
    notes = "\n".join(seen.wrong)
    for text in ("j2 (id 2) is a model that is not known here: number 1120", "j3 (id 3) is XL430-W250", "40 (XM430"):
        assert text in notes


def test_a_controller_is_no_servo() -> None:
    rig = BusRig(specs(2))
    rig.device(2).memory.put("model_number", 0x7400)
    bus, placed = as_bus("here", _sightings(rig))
    assert look(BusLine(bus, rig.port, placed), _sightings(rig)).unknown == ()


def test_several_speeds_are_refused_with_what_was_seen() -> None:
    rig = BusRig(specs(2))
    one, two = _sightings(rig)
    with refuses(BusError, "1.0", 57600, "2.0", 2000000):
        as_bus("here", [one, Sighting(two.found, Speed(1, 57_600))])
