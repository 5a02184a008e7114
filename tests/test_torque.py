"""Torque of a whole bus: everything is confirmed, and what was lost once is sent again."""

import pytest

from bus_rig import BusRig, specs
from hardware.dynamixel import torque
from hardware.errors import BusError
from sim.emulator.faults import Direction, Fault, FaultKind


def test_who_is_limp_is_told() -> None:
    rig = BusRig(specs(4)).ready(torque=True)
    rig.device(3).reboot(rig.clock.now())
    rig.clock.advance(0.3)
    (line,) = rig.bus.lines
    assert torque.limp(line) == [3]


@pytest.mark.parametrize("on", [True, False])
def test_a_lost_packet_is_sent_again(on: bool) -> None:
    rig = BusRig(specs(4)).ready(torque=not on)
    (line,) = rig.bus.lines
    # The broadcast write, and nothing else: it is the first packet from here on.
    rig.fault(Fault(FaultKind.DROP, direction=Direction.TO_SERVOS, end=1e-6))
    if on:
        torque.enable(line, [1, 2, 3, 4])
    else:
        assert torque.off_everywhere([line]) == []
    assert rig.shown("torque_enable") == [int(on)] * 4


def test_who_does_not_take_its_torque_is_named() -> None:
    rig = BusRig(specs(3)).ready()
    (line,) = rig.bus.lines
    rig.fault(Fault(FaultKind.MISSING, ids=(1,)))
    with pytest.raises(BusError, match=r"found j1 \(id 1\) does not answer\."):
        torque.enable(line, [1, 2, 3])
