"""Servos that were found, as a line that can be read."""

from bus_rig import BusRig, spec, specs
from hardware.dynamixel.line_scan import Sighting, Speed, scan_line
from hardware.dynamixel.looking import as_bus, look
from hardware.errors import BusError
from sim.emulator.faults import Fault, FaultKind
from support.messages import refuses, shows

SPEED = Speed(2, 2_000_000)


def _sightings(rig: BusRig) -> tuple[Sighting, ...]:
    if not rig.port.opened:
        rig.port.open(SPEED.baud)
    return scan_line(rig.port, [SPEED]).sightings


def test_who_is_read_who_is_missing_and_who_is_strange() -> None:
    rig = BusRig(specs(5), strangers=[spec(40)])
    rig.device(2).memory.put("model_number", 1120)
    rig.device(3).memory.put("model_number", 1060)
    rig.fault(Fault(FaultKind.MISSING, ids=(4,)))
    placed = [(7 + at, servo) for at, servo in enumerate(rig.servos)]
    seen = look(rig.port, rig.buses[0], placed, _sightings(rig))
    assert list(seen.line.images) == [1, 3, 5] and seen.missing == (4,)
    assert [one.found.id for one in seen.strange] == [2, 40]
    assert seen.line.index_of[5] == 11
    told = "\n".join(seen.notes)
    for text in ("j2 (id 2) is a model that is not known here: number 1120", "j3 (id 3) is XL430-W250", "40 (XM430"):
        assert text in told


def test_a_bus_of_what_answers_holds_every_known_servo_in_order() -> None:
    rig = BusRig(specs(4))
    rig.device(3).memory.put("model_number", 1120)
    bus, placed = as_bus("here", _sightings(rig), first=5)
    assert [(place, servo.id) for place, servo in placed] == [(5, 1), (6, 2), (7, 4)]
    assert (bus.baud, bus.protocol, bus.ids) == (2_000_000, 2, (1, 2, 4))
    seen = look(rig.port, bus, placed, _sightings(rig))
    assert not seen.missing and [one.found.id for one in seen.strange] == [3]
    shows(seen.notes, 3, 1120)


def test_a_mute_servo_is_told_from_a_silent_one() -> None:
    rig = BusRig(specs(3))
    rig.device(2).memory.put("status_return_level", 0)
    rig.device(2).tune()
    rig.fault(Fault(FaultKind.MISSING, ids=(3,)))
    seen = look(rig.port, rig.buses[0], list(enumerate(rig.servos)), _sightings(rig))
    (note,) = seen.notes
    assert seen.missing == (2, 3) and note.startswith("j2 (id 2) answers pings only (status return level 0): `retarget")
    shows(note, "--id", 2, "--register", "status_return_level=2`")


def test_a_controller_is_no_servo() -> None:
    rig = BusRig(specs(2))
    rig.device(2).memory.put("model_number", 0x7400)
    bus, placed = as_bus("here", _sightings(rig))
    assert look(rig.port, bus, placed, _sightings(rig)).strange == ()


def test_several_speeds_are_refused_with_what_was_seen() -> None:
    rig = BusRig(specs(2))
    one, two = _sightings(rig)
    with refuses(BusError, "1.0", 57600, "2.0", 2000000):
        as_bus("here", [one, Sighting(two.found, Speed(1, 57_600))])
