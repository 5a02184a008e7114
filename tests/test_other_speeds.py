"""Servos at another speed than their bus."""

import pytest

from bus_rig import BusRig, specs
from hardware.dynamixel.baud_codes import code_of
from hardware.dynamixel.other_speeds import MOST, heard_elsewhere
from hardware.errors import BusError


def _rig(*elsewhere: int) -> BusRig:
    rig = BusRig(specs(6))
    for device in elsewhere:
        one = rig.device(device)
        one.memory.put("baud_rate", code_of(one.table, 115_200) or 0)
        one.tune()
    rig.port.open(2_000_000)
    return rig


def test_who_is_heard_and_where() -> None:
    rig = _rig(2, 5)
    assert heard_elsewhere(rig.port, rig.buses[0], [2, 5, 9]) == {2: [115_200], 5: [115_200]}
    assert rig.port.baud == 2_000_000


def test_a_few_only_are_looked_for() -> None:
    rig = _rig(1, 2, 3, 4, 5)
    begun = rig.clock.now()
    assert sorted(heard_elsewhere(rig.port, rig.buses[0], [1, 2, 3, 4, 5])) == [1, 2, 3][:MOST]
    assert rig.clock.now() - begun < 1.0


def test_a_speed_that_the_adapter_lacks_is_left_out(monkeypatch: pytest.MonkeyPatch) -> None:
    rig = _rig(2)
    set_baud = rig.port.set_baud

    def limited(baud: int) -> None:
        if baud < 100_000:
            raise BusError("no such baud rate.")
        set_baud(baud)

    monkeypatch.setattr(rig.port, "set_baud", limited)
    assert heard_elsewhere(rig.port, rig.buses[0], [2]) == {2: [115_200]}
