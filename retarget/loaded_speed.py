"""How fast the joints of a robot turn while they carry it: a motor under load is slower than one that runs free."""

from dataclasses import replace

import numpy as np

from retarget.carried_load import CarriedLoad
from retarget.joint_limits import JointLimits
from retarget.robot_body import RobotBody
from retarget.stance import plant

__all__ = ["loaded_speed"]

SLOWEST = 0.25
"""Share of its speed that a joint keeps, however heavy its load."""


def loaded_speed(robot: RobotBody, limits: JointLimits, *, reserve: float) -> JointLimits:
    """Limits (nv,) with the speeds at which servos hold the robot up in its lowest posture, on both soles.

    A DC motor's speed falls in proportion to its torque, from the no-load speed to none at stall. reserve: share by
    which the load in motion exceeds the one at rest. A robot that does not stand keeps its limits.
    """
    if not robot.stands:
        return limits
    postures = robot.profile.postures
    loads = []
    for angles in (postures.stand, postures.rest):
        stance = plant(robot, angles)
        loads.append(np.abs(CarriedLoad(robot, stance).torques(stance.q, np.zeros(3))))
    load = (1.0 + reserve) * np.max(loads, axis=0)  # (nv,) [N m]
    speed = limits.max_velocity.copy()
    for servo in robot.joint_map.servos:
        if servo.coupling is not None:  # two servos share its load
            continue
        dof = robot.body.dof_index(servo.joint)
        share = max(1.0 - float(load[dof]) / (servo.model.stall_torque * servo.gear), SLOWEST)
        speed[dof] = min(speed[dof], share * servo.model.no_load_speed / servo.gear)
    return replace(limits, max_velocity=speed)
