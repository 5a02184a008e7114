"""Registers of all servos of a bus at once: a silent servo makes no other one seem silent."""

import pytest

from bus_rig import BusRig, specs
from sim.emulator.faults import Fault, FaultKind


@pytest.mark.parametrize("gone", [(), (1,), (2,), (3,), (5,), (1, 2), (1, 3, 5), (1, 2, 3, 4), (1, 2, 3, 4, 5)])
def test_servos_that_answer_are_read_whichever_is_missing(gone: tuple[int, ...]) -> None:
    rig = BusRig(specs(5)).ready()
    if gone:
        rig.fault(Fault(FaultKind.MISSING, ids=gone))
    (line,) = rig.bus.lines
    register = rig.device(1).table["id"]
    there = [device for device in range(1, 6) if device not in gone]
    assert line.read_all(register, range(1, 6)) == {device: device for device in there}


def test_without_ids_nothing_is_sent() -> None:
    rig = BusRig(specs(2)).ready()
    (line,) = rig.bus.lines
    rig.port.sent.clear()
    register = rig.device(1).table["goal_position"]
    assert line.read_all(register, []) == {}
    line.write_all(register, [])
    assert rig.port.sent == []
