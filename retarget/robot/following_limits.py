"""The limits within which a robot follows: those of its servos under load and lag, soft limits, and bent limbs."""

from dataclasses import replace

import numpy as np

from hardware.servo import loop_lag
from retarget.arithmetic import norms
from retarget.ik.gravity_torque import GravityTorque
from retarget.ik.support_polygon import Stance, plant
from retarget.model.body import JointLimits
from retarget.model.robot import RobotBody
from retarget.robot.landmarks import standing_dofs
from retarget.schema.priorities import DeflectionCompensationSettings
from retarget.types import FloatArray

# Speeds at which the guard does not take a lagging servo for a stuck one.
#
# A position loop with a P gain is behind a goal of steady speed by its time constant, and by the time that goal and
# reading take on the bus. The guard stops a robot one of whose servos is far from its goal for long. A plan that turns
# a joint so fast for so long would stop the robot.

SHARE = 0.95
"""Share of the sustained following error that a plan uses where the profile gives no `planned_lag`."""


def followed_speed(robot: RobotBody, limits: JointLimits, *, tracking_delay: float) -> JointLimits:
    """Limits (nv,) with speeds at which every servo stays within the `planned_lag` of its profile.

    tracking_delay: s that a servo is late beyond its own lag and the cycle of the bus. A profile with neither that key
    nor `following_error_sustained` keeps its limits.
    """
    safety = robot.profile.safety
    lag = safety.planned_lag
    if lag is None and safety.following_error_sustained is not None:
        lag = SHARE * safety.following_error_sustained
    if lag is None:
        return limits
    speed = limits.max_velocity.copy()
    for servo in robot.joint_map.servos:
        if servo.coupling is not None:  # its lag is not that of one joint
            continue
        behind = loop_lag(servo) + 1.0 / safety.rate_hz + tracking_delay
        dof = robot.body.dof_index(servo.joint)
        speed[dof] = min(speed[dof], lag / behind)
    return replace(limits, max_velocity=speed)


# How fast the joints of a robot turn while they carry it: a motor under load is slower than one that runs free.

SLOWEST = 0.25
"""Share of its speed that a joint keeps, however heavy its load."""


def loaded_speed(robot: RobotBody, limits: JointLimits, *, speed_margin: float) -> JointLimits:
    """Limits (nv,) with the speeds at which servos hold the robot up in its lowest posture, on both soles.

    A DC motor's speed falls in proportion to its torque, from the no-load speed to none at stall. speed_margin: share
    by which the load in motion exceeds the one at rest. A robot that does not stand keeps its limits.
    """
    if not robot.stands:
        return limits
    postures = robot.profile.postures
    loads = []
    for angles in (postures.stand, postures.rest):
        stance = plant(robot, angles)
        loads.append(np.abs(GravityTorque(robot, stance).torques(stance.q, np.zeros(3))))
    load = (1.0 + speed_margin) * np.max(loads, axis=0)  # (nv,) [N m]
    speed = limits.max_velocity.copy()
    for servo in robot.joint_map.servos:
        if servo.coupling is not None:  # two servos share its load
            continue
        dof = robot.body.dof_index(servo.joint)
        share = max(1.0 - float(load[dof]) / (servo.model.stall_torque * servo.gear), SLOWEST)
        speed[dof] = min(speed[dof], share * servo.model.no_load_speed / servo.gear)
    return replace(limits, max_velocity=speed)


# Soft limits: joints that carry a robot keep off the ends of their range. A servo overshoots its goal, and hitting a
# mechanical stop throws the robot off its soles.

MOST_SHARE = 0.25
"""Greatest share of a joint's range that a soft limit takes from an end."""


def soft_limits(robot: RobotBody, limits: JointLimits, *, margin: float) -> JointLimits:
    """Limits (nv,) with the joints between root and soles kept `margin` rad off both ends of the range of their servos,
    MOST_SHARE of it at most, and as far as `stand` allows. A robot that does not stand keeps its limits."""
    if not robot.stands or margin == 0.0:
        return limits
    lower, upper = limits.lower.copy(), limits.upper.copy()
    stand = robot.posture(robot.profile.postures.stand)[robot.servo_columns]
    dofs = np.array([robot.body.dof_index(joint) for joint in robot.joint_map.joints], dtype=np.intp)
    carrying = standing_dofs(robot)[dofs]
    rows = dofs[carrying]
    first, last = robot.limits.lower[carrying], robot.limits.upper[carrying]
    off = np.minimum(margin, MOST_SHARE * (last - first))
    lowest, highest = first + off, last - off
    stand = stand[carrying]
    lower[rows] = np.maximum(lower[rows], np.minimum(lowest, stand))
    upper[rows] = np.minimum(upper[rows], np.maximum(highest, stand))
    return replace(limits, lower=lower, upper=upper)


LIMBS = {"knee": ("hip", "ankle"), "elbow": ("shoulder", "hand")}
"""Middle joint of a limb, and the frames at its ends."""
BENT = 0.2
"""Bend (rad) that knees and elbows keep, towards where the standing robot bends them.

A straight limb is singular: a straight leg could not move its hip on without turning its knee at once, and an arm that
stretches for something out of reach would swing its elbow from one side to the other. It costs 0.5 % of the reach."""
SAMPLES = 181
"""Angles at which a joint is tried."""


def servo_limits(robot: RobotBody) -> JointLimits:
    """The limits (nv,) of a robot's servos, with speeds capped by the profile's share for following. A free root has
    none."""
    servos, body = robot.limits, robot.body
    dofs = [body.dof_index(joint) for joint in robot.joint_map.joints]
    columns = []
    for values, none in (
        (servos.lower, -np.inf),
        (servos.upper, np.inf),
        (servos.max_velocity * robot.profile.safety.speed_caps.follow, np.inf),
        (servos.max_acceleration, np.inf),
    ):
        whole = np.full(body.nv, none)
        whole[dofs] = values
        columns.append(whole)
    return JointLimits(*columns)


def following_limits(
    robot: RobotBody, stance: Stance, deflection_compensation: DeflectionCompensationSettings | None = None
) -> JointLimits:
    """Limits of every DoF (nv,): those of the servos, with knees and elbows kept bent. deflection_compensation: of a
    robot with mass; adds soft limits, and speeds of loaded and lagging servos."""
    limits = servo_limits(robot)
    for middle, ends in LIMBS.items():
        for side in ("l", "r"):
            limb = [f"{side}_{part}" for part in (ends[0], middle, ends[1])]
            _keep_bent(robot, stance, limb, limits.lower, limits.upper)
    if deflection_compensation is None:
        return limits
    limits = loaded_speed(robot, limits, speed_margin=deflection_compensation.speed_margin)
    limits = followed_speed(robot, limits, tracking_delay=deflection_compensation.tracking_delay)
    return soft_limits(robot, limits, margin=deflection_compensation.soft_limits)


def _keep_bent(robot: RobotBody, stance: Stance, limb: list[str], lower: FloatArray, upper: FloatArray) -> None:
    """Draw in the limit (nv,) of a limb's middle joint on its straight side, if the profile has its frames."""
    body = robot.body
    if not set(limb) <= set(robot.profile.frames):
        return
    start, middle, end = limb
    joints = np.flatnonzero(body.joint_body == robot.frame(middle).body)
    if joints.size != 1:
        return
    dof, column = int(body.joint_dof[joints[0]]), int(body.joint_qpos[joints[0]])
    angles = np.linspace(lower[dof], upper[dof], SAMPLES)
    postures = np.tile(stance.q, (SAMPLES, 1))
    postures[:, column] = angles
    near, far = np.moveaxis(robot.points(postures, (start, end)), 1, 0)
    straight = float(angles[np.argmax(norms(near - far))])
    standing = float(stance.q[column])
    if standing > straight:
        lower[dof] = max(lower[dof], min(straight + BENT, standing))
    else:
        upper[dof] = min(upper[dof], max(straight - BENT, standing))
