"""A limit of the force of the hands, by the currents of the arms' servos.

A joint with torque t presses with t / r at a hand with lever r. Its servo may draw the current of

    t = (largest gravity torque) + (largest r) N

A stretched arm then presses with at most N newtons, and with more where it is bent. The servos keep the limit
themselves (e-Manual, Operating Mode 5 and Goal Current).
"""

from dataclasses import replace
from math import sqrt

import numpy as np

from hardware.joint_map import JointMap
from hardware.motors import drive_numbers
from hardware.servo import ServoMode
from retarget.arithmetic import norms
from retarget.errors import UsageError
from retarget.ik.gravity_torque import GRAVITY
from retarget.model.robot import RobotBody
from retarget.rotations import as_vector
from retarget.safety.contact import FRICTION, link_of, measures_current
from retarget.types import FloatArray

HANDS = ("l_hand", "r_hand")  # landmarks
SAMPLES = 300  # random postures in which the largest torques and levers are found
MOTION_SHARE, BEHIND_RAD = 0.4, 0.15
"""Share of the torque beyond gravity that accelerates an arm. At its greatest speed v it is v^2 / 2 a behind its goal:
at most BEHIND_RAD, less than half of what the guard allows."""
TORQUE_RATIO = 2.0  # least ratio of an arm's torque to its greatest friction
OPTION = "--max-force"


def with_max_force(robot: RobotBody, force: float) -> RobotBody:
    """The robot with limited arms. force: of each hand, N. Raises UsageError if the servos cannot limit a current, or
    the arms could not overcome their friction."""
    columns = _arms(robot)
    gravity, levers = _loads(robot, columns)
    servos = robot.joint_map.servos
    numbers = [drive_numbers(servos[column].model) for column in columns]
    friction = FRICTION * np.array([servos[at].gear * one.friction for at, one in zip(columns, numbers, strict=True)])
    least = TORQUE_RATIO * friction / levers  # [N]
    if force < least.max():
        weakest = servos[columns[int(least.argmax())]].joint
        raise UsageError(
            "the arms could not overcome their friction",
            where=OPTION,
            found=f"{force:g} N",
            allowed=f"{np.ceil(least.max()):g} N or more ({weakest} needs it)",
        )
    changed = list(servos)
    for column, held, pressing, one in zip(columns, gravity, force * levers, numbers, strict=True):
        servo = servos[column]
        most = float(held + pressing) / (servo.gear * one.torque_constant)
        acceleration = MOTION_SHARE * float(pressing) / (servo.gear * servo.gear * one.armature)
        changed[column] = replace(
            servo,
            mode=ServoMode.CURRENT_BASED_POSITION,
            current_limit=most if servo.current_limit is None else min(most, servo.current_limit),
            max_velocity=min(servo.max_velocity, sqrt(2.0 * acceleration * BEHIND_RAD)),
        )
    return replace(robot, joint_map=JointMap(changed))


def _arms(robot: RobotBody) -> list[int]:
    frames = [robot.profile.landmarks[name].frame for name in HANDS if name in robot.profile.landmarks]
    ends = [foot.frame for foot in robot.profile.feet.values()]
    trunk = {link for frame in ends for link in robot.body.chain_to_root(robot.frame(frame).body)}
    arms = {link for frame in frames for link in robot.body.chain_to_root(robot.frame(frame).body)} - trunk
    columns = [column for column, servo in enumerate(robot.joint_map.servos) if link_of(robot, servo) in arms]
    if not columns:
        raise UsageError("the robot has no arms", where=OPTION, found=f"{robot.profile.name}, no l_hand or r_hand")
    unfit = [servo for servo in map(robot.joint_map.servos.__getitem__, columns) if not measures_current(servo)]
    if unfit:
        named = ", ".join(f"{servo.joint} ({servo.model.name})" for servo in unfit)
        raise UsageError(
            "servos that cannot limit their current",
            where=OPTION,
            found=named,
            allowed="models with a current register, on a bus with protocol 2.0, that turn one joint",
            next_step="Leave it out",
        )
    return columns


def _loads(robot: RobotBody, columns: list[int]) -> tuple[FloatArray, FloatArray]:
    """Largest gravity torque (m,) N m and lever (m,) m to a hand, of an upright robot."""
    servos, chance = robot.joint_map, np.random.default_rng(0)
    dofs = [robot.body.dof_index(servos.servos[column].joint) for column in columns]
    hands = [robot.frame(robot.profile.landmarks[name].frame) for name in HANDS if name in robot.profile.landmarks]
    q, gravity, levers = robot.posture(robot.profile.postures.stand), np.zeros(len(dofs)), np.zeros(len(dofs))
    for _ in range(SAMPLES):
        joints = chance.uniform(servos.lower, servos.upper)
        q[robot.servo_columns[columns]] = joints[columns]
        weight = GRAVITY * robot.body.total_mass * robot.kinematics.centre_of_mass_jacobian(q)[2, dofs]
        gravity = np.maximum(gravity, np.abs(weight))
        for hand in hands:
            jacobian = robot.kinematics.frame_jacobian(q, hand.body, as_vector(hand.position))
            levers = np.maximum(levers, norms(np.ascontiguousarray(jacobian[:3, dofs].T)))
    return gravity, levers
