"""The force of the hands is limited by the currents of the arms; what cannot be limited is refused."""

from dataclasses import replace

import numpy as np
import pytest

from followers import op3
from hardware.motors import drive_numbers
from hardware.servo import ServoMode
from messages import refuses
from retarget.cli.buses import posture_ticks
from retarget.errors import UsageError
from retarget.model.robot import load_robot
from retarget.run.options import RunOptions
from retarget.safety.force_limit import with_max_force
from sim.buses import simulation_of
from sim.physics.mount import Mount, Support
from sim.physics.perturbation import Push

ARMS = {"r_sho_pitch", "l_sho_pitch", "r_sho_roll", "l_sho_roll", "r_el", "l_el"}


def test_the_arms_alone_draw_less_and_are_slower() -> None:
    limited = with_max_force(op3(), 6.0)
    for before, servo in zip(op3().joint_map.servos, limited.joint_map.servos, strict=True):
        if servo.joint not in ARMS:
            assert servo == before
            continue
        assert servo.mode is ServoMode.CURRENT_BASED_POSITION and servo.current_limit is not None
        torque = servo.current_limit * drive_numbers(servo.model).torque_constant
        assert 6.0 * 0.1 < torque < 6.0 * 0.3 + 0.5, "N m: levers of 0.15 to 0.25 m, and the weight of an arm"
        assert servo.max_velocity < before.max_velocity and servo.max_acceleration == before.max_acceleration
    more = with_max_force(op3(), 12.0).joint_map.servos[0]
    assert (more.current_limit or 0.0) > (limited.joint_map.servos[0].current_limit or 0.0)


def test_a_current_of_the_profile_stays_the_greatest() -> None:
    servos = [replace(servo, current_limit=0.3) for servo in op3().joint_map.servos]
    limited = with_max_force(replace(op3(), joint_map=type(op3().joint_map)(servos)), 100.0)
    assert {servo.current_limit for servo in limited.joint_map.servos} == {0.3}


def test_what_cannot_be_limited_is_refused() -> None:
    with refuses(UsageError, "--max-force", "friction", "4 N", "r_el"):
        with_max_force(op3(), 1.0)
    with refuses(UsageError, "--max-force", "current", "MX-28"):
        with_max_force(load_robot("poppy"), 10.0)
    with refuses(UsageError, "--max-force", "-1"):
        RunOptions(robot="op3", max_force=-1.0)
    with refuses(UsageError, "--max-force", "human"):
        RunOptions(robot="human", bus="none", max_force=5.0)


@pytest.mark.parametrize(("force", "yields"), [(4.0, True), (None, False)])
def test_in_physics_a_limited_arm_yields_to_a_push(force: float | None, yields: bool) -> None:
    """OP3 on a stand; 10 N are more than the force, 1 N of weight, and the friction of the shoulder, 0.1 N m, twice."""
    stand = load_robot("op3", root="fixed")
    robot = stand if force is None else with_max_force(stand, force)
    simulation = simulation_of(robot, start=posture_ticks(robot), mount=Mount(Support.STAND))
    simulation.switch(np.ones(20, dtype=np.bool_))
    simulation.advance(1.0)
    before = simulation.motors.angle(simulation.data).copy()
    simulation.push(Push((10.0, 0.0, 0.0), simulation.time, 1.0, "l_hand"))
    simulation.advance(2.0)
    moved = np.abs(simulation.motors.angle(simulation.data) - before).max()
    assert bool(moved > 0.2) is yields, moved
