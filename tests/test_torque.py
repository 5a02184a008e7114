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
        assert torque.disable(line) == []
    assert rig.shown("torque_enable") == [int(on)] * 4


def test_who_does_not_take_its_torque_is_named() -> None:
    rig = BusRig(specs(3)).ready()
    (line,) = rig.bus.lines
    rig.fault(Fault(FaultKind.MISSING, ids=(1,)))
    with pytest.raises(BusError, match=r"found j1 \(id 1\) does not answer\."):
        torque.enable(line, [1, 2, 3])


def test_the_drive_is_a_share_of_the_full_one_and_never_nothing() -> None:
    rig = BusRig(specs(2)).ready()
    (line,) = rig.bus.lines
    for share, counts in ((0.5, 442), (1.0, 885), (0.0, 1)):
        torque.confirm_drive(line, [1, 2], share)
        assert rig.shown("goal_pwm") == [counts] * 2
