"""The stiffness of a servo, measured: a joint is held at several goals under a known load, and its shaft stays behind.

The load is the weight on the joint, by the body file, and of an object that hangs on the robot. The sign of friction
changes with the side from which the shaft came:

    goal - angle = torque / stiffness + offset + side x friction

Every goal is held from below and from above, and the three unknowns are the least-squares solution.
"""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from hardware.joint_map import JointMap
from hardware.servo import ServoSpec, loop_stiffness
from retarget.errors import UsageError, suggest
from retarget.ik.gravity_torque import GRAVITY
from retarget.model.observers import contacts, robot_observers
from retarget.model.robot import RobotBody
from retarget.types import FloatArray, IntArray

LEVELS = 7
"""Goals at which the joint is held, each from both sides."""
HOLD_S = 2.0
"""Time for which a goal is held, s. The shaft settles in the first half."""
TURN_RAD = 0.8
"""Largest turn to either side of `stand`, rad: the weight of a limb changes most within it."""
STEP_RAD = 0.05
"""Step of the search for contacts, rad."""
CLEAR_M = 0.01
"""Least distance from other links, m, except from those that are nearer in `stand`."""
SHARE = 0.3
"""Share of the approach speed, so that no goal swings the limb."""
LEAST_TICKS = 12.0
"""Least change of deflection that is worth a measurement, ticks: a tenth of it is the rounding of the encoder."""
STANDARD_ERRORS = 2.0
"""Half width of the 95 % interval of the result, in standard errors."""


@dataclass(frozen=True)
class Hung:
    """An object of `mass` kg that hangs at a frame of the profile."""

    mass: float
    frame: str


@dataclass(frozen=True, eq=False)
class HeldGoals:
    """The trajectory of one joint, with all others in `stand`. column, servo: of the joint. goals (T, n): rad, servo
    order. torques: least and largest load, N m."""

    column: int
    servo: ServoSpec
    goals: FloatArray
    torques: tuple[float, float]

    @property
    def range(self) -> tuple[float, float]:
        """Lowest and highest angle of the joint, rad."""
        path = self.goals[:, self.column]
        return float(path.min()), float(path.max())


@dataclass(frozen=True)
class MeasuredStiffness:
    """Stiffness of a shaft, N m/rad, with its 95 % interval `lowest` to `highest`. friction: N m. count: of goals."""

    value: float
    lowest: float
    highest: float
    friction: float
    count: int


def held_goals(robot: RobotBody, joint: str, hung: Hung | None, *, dt: float) -> HeldGoals:
    """The goals of a measurement of one joint, with an upright root. dt: tick, s. Raises UsageError for a joint
    that cannot be measured, or whose load changes too little."""
    column, servo = _column(robot, joint)
    stand = robot.posture(robot.profile.postures.stand)
    low, high = _clear_range(robot, column, stand)
    levels = np.linspace(low, high, LEVELS)
    stops = np.concatenate([levels, levels[-2::-1]])
    speed = SHARE * robot.profile.safety.speed_caps.approach * servo.max_velocity
    parts = [np.full(round(HOLD_S / dt), stops[0])]
    for start, end in pairwise(stops.tolist()):
        # Minimum jerk: at most 15/8 of the mean speed, from rest to rest.
        share = np.linspace(0.0, 1.0, round(15.0 / 8.0 * abs(end - start) / speed / dt) + 2)[1:-1]
        parts += [start + (end - start) * share**3 * (10.0 + share * (6.0 * share - 15.0))]
        parts += [np.full(round(HOLD_S / dt), end)]
    path = np.concatenate(parts)
    goals = np.tile(stand[robot.servo_columns], (len(path), 1))
    goals[:, column] = path
    torque = load_torques(robot, column, goals, hung)
    expected = loop_stiffness(servo)
    ticks = np.ptp(torque) / servo.gear / expected / servo.model.tick_rad
    if ticks < LEAST_TICKS:
        raise UsageError(
            "too little load for a measurement",
            where=f"--joint {joint}",
            found=f"{torque.min():.2f} to {torque.max():.2f} N m: about {ticks:.0f} ticks of the encoder",
            allowed=f"{LEAST_TICKS:.0f} ticks or more",
            next_step="Hang a weight on the limb (--weight KG --at FRAME), or take another joint: a hip's pitch",
        )
    return HeldGoals(column, servo, goals, (float(torque.min()), float(torque.max())))


def load_torques(robot: RobotBody, column: int, joints: FloatArray, hung: Hung | None) -> FloatArray:
    """The torque (T,), N m, that holds the weight on a joint in postures `joints` (T, n), rad, servo order, with
    the root upright. column: of the joint."""
    body, solver = robot.body, robot.body.solver_body()
    dof = body.dof_index(robot.joint_map.joints[column])
    frame = None if hung is None else robot.frame(hung.frame)
    torques = np.zeros(len(joints))
    q = robot.body.qpos0.copy()
    for row, angles in enumerate(joints):
        q[robot.servo_columns] = angles
        torques[row] = body.total_mass * solver.centre_of_mass_jacobian(q)[2, dof]
        if hung is not None and frame is not None:
            x, y, z = frame.position.tolist()
            torques[row] += hung.mass * solver.frame_jacobian(q, frame.body, (x, y, z))[2, dof]
    return GRAVITY * torques


def fit(torque: FloatArray, deflection: FloatArray, side: IntArray, *, resolution: float) -> MeasuredStiffness | None:
    """Fit the stiffness to torques (k,), N m, deflections (k,), rad, and sides (k,) from which the goals came, 1 or -1.
    resolution: of the encoder, rad. Returns None if the compliance is not above its error."""
    known = np.column_stack([torque, np.ones_like(torque), side])
    found, *_ = np.linalg.lstsq(known, deflection)
    rest = deflection - known @ found
    variance = max(float(rest @ rest) / max(len(torque) - 3, 1), resolution**2 / 12.0)
    compliance, _, friction = found.tolist()
    error = STANDARD_ERRORS * float(np.sqrt(variance * np.linalg.inv(known.T @ known)[0, 0]))
    if compliance <= error:
        return None
    return MeasuredStiffness(
        1.0 / compliance,
        1.0 / (compliance + error),
        1.0 / (compliance - error),
        abs(friction) / compliance,
        len(torque),
    )


def measured(
    robot: RobotBody, held: HeldGoals, goals: FloatArray, present: FloatArray, hung: Hung | None, *, dt: float
) -> MeasuredStiffness | None:
    """The stiffness from sent goals and measured angles `present`, (T, n) each, rad; None if it cannot be
    determined."""
    column, gear = held.column, held.servo.gear
    settle = round(0.5 * HOLD_S / dt)
    sent = goals[:, column]
    moves = np.flatnonzero(np.diff(sent)) + 1  # the first rows of new goals
    rows: list[tuple[FloatArray, float, int]] = []
    for first, last in zip(moves, [*moves[1:], len(sent)], strict=True):
        if last - first > settle:
            seen = present[first + settle : last].mean(axis=0)
            rows.append((seen, float(sent[first] - seen[column]), 1 if sent[first] > sent[first - 1] else -1))
    if len(rows) <= LEVELS:
        return None
    postures, deflections, sides = zip(*rows, strict=True)
    torque = load_torques(robot, column, np.array(postures), hung)
    # The shaft turns gear times as far as the joint, with a gear-th of its torque.
    return fit(torque / gear, gear * np.array(deflections), np.array(sides), resolution=held.servo.model.tick_rad)


def _column(robot: RobotBody, joint: str) -> tuple[int, ServoSpec]:
    joints: JointMap = robot.joint_map
    if joint not in joints.joints:
        allowed, step = ", ".join(joints.joints), suggest(joint, joints.joints)
        raise UsageError("no such joint", where="--joint", found=repr(joint[:80]), allowed=allowed, next_step=step)
    column = joints.joints.index(joint)
    servo = joints.servos[column]
    if servo.coupling is not None:
        raise UsageError("two servos share the load of this joint", where="--joint", found=joint, allowed="another one")
    if servo.gains.position_i:
        raise UsageError(
            "an I gain takes every deflection away",
            where=f"--joint {joint}",
            found=f"gains: i {servo.gains.position_i}",
            next_step="Write i: 0 for this servo into the profile, measure, and write the I gain back",
        )
    return column, servo


def _clear_range(robot: RobotBody, column: int, stand: FloatArray) -> tuple[float, float]:
    """Range of a joint around `stand` (nq,), rad, within its limits and clear of the robot."""
    observers, place = robot_observers(robot), robot.servo_columns[column]
    servo, q = robot.joint_map.servos[column], stand.copy()

    def near() -> set[tuple[str, str]]:
        return {(one.part, one.other) for one in contacts(robot.body, observers, None, q, deeper_than=-CLEAR_M)}

    usual, ends = near(), []
    for step in (-STEP_RAD, STEP_RAD):
        q[place] = end = float(stand[place])
        while abs(end + step - stand[place]) <= TURN_RAD and servo.lower < end + 2.0 * step < servo.upper:
            q[place] = end + step
            if near() - usual:
                break
            end += step
        ends.append(end)
    return ends[0], ends[1]
