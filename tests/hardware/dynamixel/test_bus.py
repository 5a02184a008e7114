"""Watching servos that another process drives: their torque is shown as they report it."""

import numpy as np

from bus_rig import BusRig, specs
from hardware.dynamixel.bus import TORQUE_AGE, Watch
from hardware.dynamixel.readings import Torque
from sim.emulator.faults import Fault, FaultKind


def watched() -> tuple[BusRig, Watch]:
    rig = BusRig(specs(3)).ready(torque=True)
    return rig, Watch(rig.bus.lines)


def test_torque_is_what_the_servos_say() -> None:
    rig, watch = watched()
    assert watch.torque == [Torque.UNKNOWN] * 3
    watch.read()
    assert watch.torque == [Torque.ON] * 3
    rig.device(2).memory.put("torque_enable", 0)
    rig.clock.advance(0.25)
    watch.read()
    assert watch.torque[0] is Torque.HELD  # no instruction for longer than the watchdog's time
    assert watch.torque[1] is Torque.OFF


def test_torque_of_a_silent_servo_is_not_known() -> None:
    rig, watch = watched()
    watch.read()
    rig.fault(Fault(FaultKind.MISSING, ids=(2,)))
    for _ in range(round(1.5 * TORQUE_AGE / 0.05)):
        watch.read()
        rig.clock.advance(0.05)
    assert watch.torque == [Torque.ON, Torque.UNKNOWN, Torque.ON]
    assert watch.losses[1] > 10 and np.count_nonzero(watch.losses) == 1
