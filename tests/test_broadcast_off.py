"""Torque off by broadcasts at speeds that nobody knows."""

import pytest

from bus_rig import BusRig, bus_of, specs
from hardware.dynamixel.baud_codes import code_of
from hardware.dynamixel.broadcast_off import tell_everybody_off
from hardware.dynamixel.line_scan import Speed, all_speeds
from hardware.errors import BusError
from sim.emulator.faults import Fault, FaultKind
from support.messages import refuses


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
def test_everybody_hears_within_a_second_at_any_speed(model: str, protocol: int) -> None:
    rig = _rig(model, protocol)
    begun = rig.clock.now()
    tell_everybody_off(rig.port, all_speeds())
    assert rig.clock.now() - begun < 1.0
    assert rig.shown("torque_enable") == [0, 0, 0]


def test_only_the_speeds_named() -> None:
    rig = _rig()
    tell_everybody_off(rig.port, [Speed(2, 1_000_000)])
    assert rig.shown("torque_enable") == [0, 1, 0] and rig.port.baud == 1_000_000


def test_a_speed_that_the_adapter_lacks_is_left_out_and_a_port_that_is_gone_is_told(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    rig = _rig()
    set_baud = rig.port.set_baud

    def limited(baud: int) -> None:
        if baud < 100_000:
            raise BusError("no such baud rate.")
        set_baud(baud)

    monkeypatch.setattr(rig.port, "set_baud", limited)
    tell_everybody_off(rig.port, all_speeds())
    assert rig.shown("torque_enable") == [0, 1, 0]
    monkeypatch.undo()
    rig.fault(Fault(FaultKind.UNPLUG))
    with refuses(BusError):
        tell_everybody_off(rig.port, all_speeds())
