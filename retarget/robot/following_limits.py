"""Limits of a robot that follows: of its servos under load and lag, soft limits, and bent limbs."""

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

SHARE = 0.95
"""Share of the sustained following error that a plan uses without `planned_lag`."""


def followed_speed(robot: RobotBody, limits: JointLimits, *, tracking_delay: float) -> JointLimits:
    """Limits (nv,) with speeds at which servos stay within the profile's `planned_lag`.

    A position loop with a P gain lags by its time constant and a cycle of the bus. tracking_delay: further lag, s.
    """
    safety = robot.profile.safety
    lag = safety.planned_lag
    if lag is None and safety.following_error_sustained is not None:
        lag = SHARE * safety.following_error_sustained
    if lag is None:
        return limits
    speed = limits.max_velocity.copy()
    for servo in robot.joint_map.servos:
        if servo.coupling is not None:
            continue
        behind = loop_lag(servo) + 1.0 / safety.rate_hz + tracking_delay
        dof = robot.body.dof_index(servo.joint)
        speed[dof] = min(speed[dof], lag / behind)
    return replace(limits, max_velocity=speed)


SLOWEST = 0.25
"""Share of its speed that a joint keeps under any load."""


def loaded_speed(robot: RobotBody, limits: JointLimits, *, speed_margin: float) -> JointLimits:
    """Limits (nv,) with the speeds of loaded servos in the lowest posture of a standing robot.

    A DC motor's speed falls linearly from no load to stall. speed_margin: load beyond that at rest, relative to it.
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


MOST_SHARE = 0.25
"""Greatest share of a joint's range that a soft limit takes."""


def soft_limits(robot: RobotBody, limits: JointLimits, *, margin: float) -> JointLimits:
    """Limits (nv,) in which the joints of standing legs keep `margin` rad from their ends, within MOST_SHARE and
    `stand`: a servo that overshoots into a stop would throw the robot over."""
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
"""Middle joint of a limb: frames at its ends."""
BENT = 0.2
"""Least bend of knees and elbows, rad, as straight limbs are singular."""
SAMPLES = 181  # angles at which a joint is tried


def servo_limits(robot: RobotBody) -> JointLimits:
    """Limits (nv,) of a robot's servos, with the profile's cap of speeds."""
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
    """Limits (nv,) of servos, with knees and elbows bent. deflection_compensation: adds soft limits, load and lag."""
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
