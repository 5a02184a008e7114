"""Everybody on one port, at whatever speed; nothing is written."""

import pytest

from bus_rig import BusRig, spec, specs
from hardware.dynamixel.control_table import code_of
from hardware.dynamixel.line_scan import Speed, all_speeds, likely_speeds, scan_likely, scan_line, write_setting
from hardware.dynamixel.settings import Setting
from hardware.errors import BusError
from messages import refuses, shows
from sim.emulator.faults import Direction, Fault, FaultKind


def _rig(**bauds: int) -> BusRig:
    """Three servos at 2 Mbps, but for s<id>=baud; the port is open."""
    rig = BusRig(specs(3))
    for name, baud in bauds.items():
        rig.put(int(name[1:]), baud_rate=code_of(rig.devices[0].table, baud) or 0)
    rig.port.open(2_000_000)
    return rig


def test_a_quick_look_finds_servos_at_usual_speeds_in_seconds() -> None:
    rig = _rig(s2=57_600, s3=4_500_000)
    begun = rig.port.now()
    seen = scan_likely(rig.port, likely_speeds(all_speeds()))
    assert {one.found.id: one.speed.baud for one in seen.sightings} == {1: 2_000_000, 2: 57_600}
    assert rig.port.now() - begun < 10.0
    own = Speed(2, 4_500_000)
    assert likely_speeds(all_speeds(first=own))[0] == own


@pytest.mark.parametrize(("ids", "found"), [((), [1]), ((100,), [1, 100])])
def test_a_quick_look_in_protocol_1_is_for_usual_ids_and_those_expected(ids: tuple[int, ...], found: list[int]) -> None:
    rig = BusRig([spec(number, "MX-28") for number in (1, 100)], protocol=1)
    rig.port.open(1_000_000)
    seen = scan_likely(rig.port, [Speed(1, 1_000_000)], ids=ids)
    assert [one.found.id for one in seen.sightings] == found


def test_an_impossible_speed_is_reported_and_a_port_that_is_gone_ends_it(monkeypatch: pytest.MonkeyPatch) -> None:
    rig = _rig()
    set_baud = rig.port.set_baud

    def limited(baud: int) -> None:
        if baud > 3_000_000:
            raise BusError("no such baud rate.")
        set_baud(baud)

    monkeypatch.setattr(rig.port, "set_baud", limited)
    seen = scan_line(rig.port, all_speeds((2,)))
    assert len(seen.sightings) == 3 and len(seen.skipped) == 2
    shows(seen.skipped[-1], "2.0", 4500000)
    rig.fault(Fault(FaultKind.UNPLUG))
    with refuses(BusError):
        scan_line(rig.port, all_speeds((2,)))


SPEED = Speed(2, 2_000_000)


@pytest.mark.parametrize("lost", [False, True])
@pytest.mark.parametrize(
    ("name", "value", "after"),
    [("shutdown", 53, (2, SPEED)), ("id", 9, (9, SPEED)), ("baud_rate", 3, (2, Speed(2, 1_000_000)))],
)
def test_where_it_is_afterwards(name: str, value: int, after: tuple[int, Speed], lost: bool) -> None:
    rig = _rig()
    if lost:
        rig.fault(Fault(FaultKind.DROP, direction=Direction.TO_HOST, end=0.01))
    table = rig.devices[1].table
    assert write_setting(rig.port, table, 2, SPEED, Setting(table[name], value)) == after
    assert rig.devices[1].memory.value(name) == value
    assert rig.port.baud == after[1].baud
    assert rig.shown(name)[0] != value


def test_a_servo_that_vanishes_is_reported_with_where_it_was_looked_for() -> None:
    rig = _rig()
    rig.fault(Fault(FaultKind.MISSING, ids=(2,)))
    table = rig.devices[1].table
    with refuses(BusError, "baud_rate", 2, 57600):
        write_setting(rig.port, table, 2, SPEED, Setting(table["baud_rate"], code_of(table, 57_600) or 0))
