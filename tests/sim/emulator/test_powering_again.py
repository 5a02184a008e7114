"""Torque for robots that are not as they were left: turns of driven servos, slow buses, noise."""

from dataclasses import replace

import pytest

from bus_rig import BusRig, bus_of, specs
from hardware.bus import ServoGoals
from hardware.dynamixel.codec import Instruction
from hardware.errors import BusError
from hardware.servo import ServoMode
from messages import refuses
from powering_helpers import FAR, of_many_turns
from sim.emulator.faults import Fault, FaultKind


@pytest.mark.parametrize("fault", ["silent", "beyond"])
def test_turns_of_a_servo_that_has_torque_are_counted_before_it_is_driven(fault: str) -> None:
    """A run was killed. The next one finds torque on, and at first another servo does not answer."""
    rig = of_many_turns().ready()
    rig.bus.close()
    two = rig.device(2)
    two.reboot(rig.clock.now())
    rig.clock.advance(1.0)
    two.execute(Instruction.WRITE, b"\x40\x00\x01", rig.clock.now(), broadcast=False)
    assert two.memory.value("torque_enable") == 1
    rig.bus = rig.another()
    if fault == "beyond":
        rig.servos[0] = replace(rig.servos[0], mode=ServoMode.EXTENDED_POSITION, lower=1.0, upper=1.4)
        rig.bus = rig.another()
    begin = rig.bus._begin

    def without_answer() -> None:
        if fault == "silent":
            rig.fault(Fault(FaultKind.MISSING, ids=(1,)))
        begin()
        rig.clear_faults()

    rig.bus._begin = without_answer  # type: ignore[method-assign]
    rig.bus.open()
    for _ in range(5):
        rig.clock.advance(0.05)
        states = rig.bus.read()
    assert int(states.position[1]) == FAR
    rig.bus.write(ServoGoals(states.position))
    if fault == "beyond":
        with refuses(BusError, "j1", 1):
            rig.bus.torque(True)


def test_two_slow_buses_are_armed_before_a_watchdog_runs_out() -> None:
    servos = [*specs(20), *(replace(one, joint=f"k{one.id}", bus="two") for one in specs(20))]
    buses = [bus_of(servos, baud=57_600), bus_of(servos, name="two", baud=57_600)]
    rig = BusRig(servos, buses=buses).ready(torque=True)
    assert rig.shown("torque_enable") == [1] * 40
