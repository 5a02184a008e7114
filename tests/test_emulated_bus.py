"""A robot's own driver above its emulated servos."""

import numpy as np

from hardware.bus import ServoGoals
from hardware.clock import VirtualClock
from retarget.cli.buses import make_bus, standing_ticks
from retarget.robot_body import load_robot
from sim.emulated_bus import emulated_bus


def test_the_servos_of_op3_stand_and_follow() -> None:
    robot, clock = load_robot("op3"), VirtualClock()
    start = standing_ticks(robot)
    bus = emulated_bus(robot, clock, start=start)
    bus.open()
    assert np.array_equal(bus.read().position, start)
    bus.write(ServoGoals(start))
    bus.torque(True)
    for _ in range(60):
        states = bus.read()
        bus.write(ServoGoals(start + 20))
        clock.advance(0.008)
    assert states.valid.all() and states.driven.all()
    assert np.abs(states.position - start - 20).max() <= 1
    bus.close()


def test_by_name_it_is_the_same() -> None:
    robot = load_robot("op3")
    bus = make_bus("emulator", robot, VirtualClock())
    bus.open()
    assert np.array_equal(bus.read().position, standing_ticks(robot))
    bus.close()
