"""Every shipped robot stands in physics, with its own gains, in its own posture: OP3 in tests/sim/test_buses.py."""

import numpy as np
import pytest

from hardware.bus import ServoGoals
from hardware.clock import VirtualClock
from retarget.model.robot import load_robot
from sim.buses import physics_bus, simulation_of
from unknown_robots import SHIPPED


@pytest.mark.parametrize("name", [name for name in SHIPPED if name != "op3"])
def test_it_stands(name: str) -> None:
    robot, clock = load_robot(name), VirtualClock()
    if not robot.stands:
        pytest.skip("does not stand on feet")
    start = robot.joint_map.to_ticks(robot.posture(robot.profile.postures.stand)[robot.servo_columns])
    bus = physics_bus(simulation_of(robot, start=start), clock)
    bus.open()
    bus.write(ServoGoals(bus.read().position))
    bus.torque(True)
    dt = 1.0 / robot.profile.safety.rate_hz
    for _ in range(round(2.0 / dt)):
        clock.advance(dt)
        states = bus.read()
        bus.write(ServoGoals(start))
    witness = bus.witness
    assert witness.fall is None and not states.alert.any()
    assert witness.log.slip_m.max() < 5e-4 and np.degrees(witness.log.worst_tilt) < 1.0
    assert np.abs(robot.joint_map.turned(states.position - start)).max() < 0.06
    assert not witness.log.self_contact_ticks
    assert witness.state.load.sum() == pytest.approx(witness.simulation.world.weight, rel=0.05)


@pytest.mark.parametrize("seed", [0, 1, 2])
@pytest.mark.parametrize("name", ["op3", "poppy", "wolfgang"])
def test_at_rest_it_stays_when_its_torque_goes(name: str, seed: int) -> None:
    """ToddlerBot does not: its ankles have no stop within reach, and next to no friction."""
    robot, clock = load_robot(name), VirtualClock()
    start = robot.joint_map.to_ticks(robot.posture(robot.profile.postures.rest)[robot.servo_columns])
    bus = physics_bus(simulation_of(robot, start=start, seed=seed), clock)
    bus.open()
    bus.write(ServoGoals(bus.read().position))
    bus.torque(True)
    for on, seconds in ((True, 1.0), (False, 3.0)):
        if not on:
            bus.torque(False)
        for _ in range(round(seconds / 0.008)):
            clock.advance(0.008)
            bus.read()
            if on:
                bus.write(ServoGoals(start))
    witness = bus.witness
    assert witness.state.tilt.max() < np.radians(1.0)
    assert witness.at_rest and witness.fall is None and witness.toppled is None and not witness.state.touching
