"""How fast joints may be planned that their servos are not taken for stuck: a servo lags behind a goal that moves.

A position loop with a P gain is behind a goal of steady speed by its time constant, and by the time that goal and
reading take on the bus. The guard stops a robot one of whose servos is far from its goal for long; a plan that turns a
joint so fast for so long would stop itself.
"""

from dataclasses import replace

from hardware.servo_lag import loop_lag
from retarget.joint_limits import JointLimits
from retarget.robot_body import RobotBody

__all__ = ["followed_speed"]

SHARE = 0.95
"""Of the error that the guard lets last, what a plan uses."""


def followed_speed(robot: RobotBody, limits: JointLimits, *, late: float) -> JointLimits:
    """Limits (nv,) with speeds at which every servo stays within the `following_error_lasting` of its profile, on a bus
    that takes a cycle, and is `late` s beyond that. A profile that has none keeps its limits."""
    safety = robot.profile.safety
    if safety.following_error_lasting is None:
        return limits
    protocols = {line.name: line.protocol for line in robot.profile.bus_specs()}
    speed = limits.max_velocity.copy()
    for servo in robot.joint_map.servos:
        if servo.coupling is not None:  # its lag is not that of one joint
            continue
        behind = loop_lag(servo, protocol=protocols[servo.bus]) + 1.0 / safety.rate_hz + late
        dof = robot.body.dof_index(servo.joint)
        speed[dof] = min(speed[dof], SHARE * safety.following_error_lasting / behind)
    return replace(limits, max_velocity=speed)
