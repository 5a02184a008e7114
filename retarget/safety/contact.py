"""Contact detection by motor current: a joint whose motor gives more torque than its motion needs presses against
something.

    torque = gravity(q, up) + (inertia of the rotor) ddq + viscous dq + friction,    |friction| <= Coulomb friction

Measured torque and positions pass the same low pass. A residual beyond the errors of friction and of each term is a
contact. Joints that carry a sole or a hook are not watched: currents do not show how legs share the weight.
"""

from dataclasses import dataclass, replace

import numpy as np

from hardware.arrays import BoolArray
from hardware.bus import ServoStates
from hardware.guard import CheckedGoal
from hardware.imu import ImuSample
from hardware.joint_map import JointMap
from hardware.motors import drive_numbers
from hardware.servo import ServoSpec
from retarget.arithmetic import matmul, norm
from retarget.ik.gravity_torque import GRAVITY
from retarget.model.robot import RobotBody
from retarget.rotations import IDENTITY, NO_TURN, Vector, as_quat, as_vector, inverse, product, rotated
from retarget.types import FloatArray, News

FRICTION, PLAY = 2.5, 0.02
"""Multiple of the Coulomb friction, and share of the stall torque, that stay unexplained: a servo holds still at 1.6
times its friction, and servos of a model differ by 30 %."""
GRAVITY_SHARE, INERTIA_SHARE = 0.3, 0.5
"""Relative errors of the known terms: published torque constants differ by 30 %, rotor inertias by a factor of two."""
LOW_PASS_S = 0.02  # [s] time constant of each of two low passes; with less, an encoder step is an acceleration
SLOWEST_HZ = 100.0  # at 50 Hz, free motion of a simulated head left 2.6 times the bound unexplained
SUSTAINED_S = 0.08  # [s] of a residual at its bound until the robot holds; of twice the bound half as long
HARDEST = 2.5  # multiple of the bound that counts at most, so that several readings must agree
BEGUN_S = 0.5  # [s] nothing is judged so long after the first reading, while the joints take up their loads
CLEAR, CLEAR_S = 0.8, 0.5
"""A contact is over after CLEAR_S, s, below this share of the bound."""
STUCK_S, STUCK_RAD = 0.5, 0.1
"""A current that stays equal for STUCK_S, s, while its joint moves by STUCK_RAD, is not measured."""
FULL_SHARE = 0.95  # of its greatest current, from which on a motor is saturated
STILL_PRESSED_S = 0.4  # [s] a limb that still presses then returns to its position at that time
BACK_SHARE, AT_RAD = 0.9, 1e-4  # of the acceleration and speed on the return path; [rad] tolerance of its end
LONGEST_BACK = 200  # [ticks]
SHORTEST_LEVER = 0.02  # [m] a force with a shorter lever is not named
PRESSES = "{} presses against something: {:.1f} N m more than its motion needs (allowed {:.1f}){}"
CLEAR_IT = "holding: {}. Clear the way, or move back"
STUCK = "warning: the current of {} does not change: that it presses against something is not seen"


@dataclass(frozen=True, eq=False)
class Press:
    """A contact. limb (n,): mask of its servos; joints (n,): rad, to which the limb returns."""

    joint: str
    text: str
    limb: BoolArray
    joints: FloatArray


@dataclass(frozen=True)
class Presses:
    """The contacts of a run, and joint, residual torque, N m, and least force, N at frame `at`, of the greatest."""

    times: int
    joint: str
    torque: float
    force: float | None = None
    at: str = ""


def return_path(pressed: Press, last: CheckedGoal, servos: JointMap, *, dt: float) -> FloatArray | None:
    """Postures (k, n) rad, a row per tick, of a robot that stops while the limb in contact returns; None if the stop
    ends there already."""
    rows = last.stop if len(last.stop) else last.posture[None]
    limb = pressed.limb
    goal = np.clip(pressed.joints, servos.lower, servos.upper)[limb]
    if (np.abs(rows[-1][limb] - goal) < AT_RAD).all():
        return None
    at, moved = last.posture[limb], last.displacement[limb]
    fastest = (BACK_SHARE * dt * servos.max_velocity)[limb]  # [rad] in a tick
    most = (BACK_SHARE * dt * dt * servos.max_acceleration)[limb]  # [rad] from one to the next
    path = list[FloatArray]()
    while len(path) < LONGEST_BACK and ((np.abs(goal - at) >= AT_RAD).any() or (np.abs(moved) > most).any()):
        left = goal - at
        # Ticks to rest from a step v, less `most` in each: v + (v - most) + ... = v (v / most + 1) / 2, at most `left`.
        desired = 0.5 * most * (np.sqrt(1.0 + 8.0 * np.abs(left) / most) - 1.0)
        desired = np.copysign(np.minimum(np.minimum(desired, fastest), np.abs(left)), left)
        moved = moved + np.clip(desired - moved, -most, most)
        at = at + moved
        path.append(at)
    whole = np.repeat(rows[-1:], max(len(path) + 1, len(rows)), axis=0)
    whole[: len(rows)] = rows
    whole[:, limb] = goal
    whole[: len(path), limb] = path
    return whole


def felt_servos(robot: RobotBody) -> BoolArray:
    """Mask (n,), servo order, of the servos whose contacts are detected."""
    if robot.profile.safety.rate_hz < SLOWEST_HZ:
        return np.zeros(len(robot.joint_map), dtype=np.bool_)
    held = [foot.frame for foot in robot.profile.feet.values()] if robot.stands else []
    held += ["hook"] if robot.profile.root == "suspended" and "hook" in robot.profile.frames else []
    carrying = {link for frame in held for link in robot.body.chain_to_root(robot.frame(frame).body)}
    return np.array(
        [measures_current(servo) and link_of(robot, servo) not in carrying for servo in robot.joint_map.servos]
    )


def measures_current(servo: ServoSpec) -> bool:
    """True if a servo measures and limits its current, and turns one joint alone."""
    return servo.model.current_unit is not None and servo.protocol == 2 and servo.coupling is None


def link_of(robot: RobotBody, servo: ServoSpec) -> int:
    """The link that a servo moves."""
    return int(robot.body.joint_body[robot.body.joint_index(servo.joint)])


class _Upright:
    """The weight of a robot as a force upwards, N, along the axes of its root."""

    def __init__(self, robot: RobotBody) -> None:
        body = robot.body
        self._up = (0.0, 0.0, body.total_mass * GRAVITY)
        root = int(np.flatnonzero(body.parent == 0)[1])  # link 0 is the world
        turns = robot.kinematics.forward(robot.posture({}))[1]
        self._free, self._root = robot.profile.root == "free", NO_TURN
        self._of_imu = None
        """Orientation of the IMU's link, if it moves with the root."""
        if not self._free:
            self._root = as_quat(turns[root])
        if robot.profile.imu is not None:
            link = body.body_index(robot.profile.imu.link)
            if body.moved_with(link) == body.moved_with(root):
                in_root = product(inverse(as_quat(turns[root])), as_quat(turns[link]))
                self._of_imu = product(self._root, in_root)

    def force(self, imu: ImuSample | None, q: FloatArray) -> Vector:
        if self._of_imu is not None and imu is not None and imu.valid and imu.orientation is not None:
            return rotated(product(self._of_imu, inverse(as_quat(imu.orientation))), self._up)
        return rotated(inverse(as_quat(q[3:7])), self._up) if self._free else self._up


class _InverseDynamics:
    """Currents (m,) A, residual torques (m,) N m and their bounds (m,) of the watched joints."""

    def __init__(self, robot: RobotBody, *, dt: float) -> None:
        self.columns = np.flatnonzero(felt_servos(robot))
        servos = [robot.joint_map.servos[column] for column in self.columns]
        turns = np.array([servo.direction * servo.gear for servo in servos])  # shaft turns per joint turn
        numbers = [drive_numbers(servo.model) for servo in servos]
        self.constant = turns * np.array([one.torque_constant for one in numbers])  # [N m/A]
        self._armature = turns * turns * np.array([one.armature for one in numbers])  # [kg m^2]
        self._viscous = turns * turns * np.array([one.viscous for one in numbers])  # [N m s/rad]
        stall = np.array([servo.model.stall_torque for servo in servos])
        limits = [np.inf if servo.current_limit is None else servo.current_limit for servo in servos]
        most = np.array([one.most_torque / one.torque_constant for one in numbers])
        self.full = FULL_SHARE * np.minimum(limits, most)  # [A]
        self.base = np.abs(turns) * (FRICTION * np.array([one.friction for one in numbers]) + PLAY * stall)  # [N m]
        self._robot, self._dt = robot, dt
        self._dofs = np.array([robot.body.dof_index(servo.joint) for servo in servos], dtype=np.intp)
        self.q, self._upright = robot.posture({}), _Upright(robot)
        """(nq,) Measured joints, along the axes of the root."""
        if robot.profile.root == "free":
            self.q[3:7] = IDENTITY
        self._one = self._two = np.zeros((2, len(servos)))  # low passes of positions and torques
        self._velocity = np.zeros(len(servos))  # [rad/s]
        self.ticks = 0

    def look(
        self, states: ServoStates, joints: FloatArray, q: FloatArray
    ) -> tuple[FloatArray, FloatArray, FloatArray] | None:
        """None until a current is known. joints (n,): rad; q (nq,): as commanded."""
        columns, dt, gain = self.columns, self._dt, self._dt / (LOW_PASS_S + self._dt)
        force = np.array(self._upright.force(states.imu, q))
        self.q[self._robot.servo_columns] = joints
        # Gravity torque of a joint that carries only its own links: m g up . J_com with the root fixed.
        jacobian = self._robot.kinematics.centre_of_mass_jacobian(self.q)
        gravity = matmul(force, jacobian)[self._dofs]
        current = states.current[columns]
        known = np.isfinite(current)
        seen = np.array([joints[columns], np.where(known, self.constant * current - gravity, 0.0)])
        if not self.ticks:
            self._one, self._two, self._velocity = seen.copy(), seen.copy(), np.zeros(len(columns))
            self.ticks = int(known.any())
            return None
        self._one += gain * (seen - self._one)
        moved = gain * (self._one - self._two)
        self._two += moved
        velocity = moved[0] / dt
        inertial = self._armature / dt * (velocity - self._velocity)
        self._velocity = velocity
        self.ticks += 1
        rest = np.where(known, self._two[1] - self._viscous * velocity - inertial, 0.0)
        return current, rest, self.base + GRAVITY_SHARE * np.abs(gravity) + INERTIA_SHARE * np.abs(inertial)


class _Readings:
    """Detects currents (m,) that do not change, and so are not measured. full (m,): A, saturated ones."""

    def __init__(self, full: FloatArray) -> None:
        self._full, self._onset = full, np.zeros(len(full))
        self.changed = self.stuck = np.zeros(len(full), dtype=np.bool_)
        self._same, self._since = np.zeros(len(full), dtype=np.bool_), np.zeros((2, len(full)))

    def look(self, current: FloatArray) -> None:
        self._same &= current == self._since[1]

    def unmoved(self, joints: FloatArray, current: FloatArray) -> BoolArray:
        stuck = self._same & (np.abs(joints - self._since[0]) > STUCK_RAD)
        self._same, self._since = np.ones(len(current), dtype=np.bool_), np.array([joints, current])
        self._onset = np.where(stuck, current, self._onset)
        return self.give_up(stuck)

    def judge(self, current: FloatArray, begins: BoolArray) -> None:
        """Note which currents have changed. begins: torques that exceed their bounds from now on."""
        self._onset = np.where(begins, current, self._onset)
        self.changed = (self.changed & ~begins) | (current != self._onset)
        self.stuck = self.stuck & ~self.changed

    def give_up(self, stuck: BoolArray) -> BoolArray:
        """Ignore these currents until they change; return those that were in use."""
        stuck = stuck & (np.abs(self._onset) < self._full)
        fresh = stuck & ~self.stuck
        self.changed, self.stuck = self.changed & ~stuck, self.stuck | stuck
        return fresh


class ContactDetector:
    """Detects contacts. unexplained (n,): residual torques, N m, servo order; NaN if not known."""

    def __init__(self, robot: RobotBody, *, dt: float) -> None:
        self._robot, self._dt, self._dynamics = robot, dt, _InverseDynamics(robot, dt=dt)
        self._servos = [robot.joint_map.servos[column] for column in self._dynamics.columns]
        none = np.zeros(len(self._servos))
        self._beyond = none  # (m,) [s] beyond the bound without a break, times the share of it
        self._readings = _Readings(self._dynamics.full)
        self._clear = self._pressing = 0  # ticks
        self._busy = False  # something is beyond its bound, or was
        self._news: list[str] = []
        self.unexplained = np.full(len(robot.joint_map), np.nan)
        self.pressed: Press | None = None
        self.presses: Presses | None = None

    @property
    def joints(self) -> tuple[str, ...]:
        """The watched joints."""
        return tuple(servo.joint for servo in self._servos)

    def take_news(self) -> tuple[str, ...]:
        """Messages since the last call."""
        news, self._news = tuple(self._news), []
        return news

    def look(self, states: ServoStates, joints: FloatArray, q: FloatArray, *, moves: bool = True) -> None:
        """Look at a tick. joints (n,): measured, rad; q (nq,): as commanded. moves: else nothing is judged."""
        if not self._servos:
            return
        seen = self._dynamics.look(states, joints, q)
        self.unexplained[self._dynamics.columns] = np.nan if seen is None else seen[1]
        if not moves:
            self.pressed, self._beyond, self._busy = None, np.zeros(len(self._servos)), False
            return
        if seen is None or self._dynamics.ticks * self._dt < BEGUN_S:
            return
        current, rest, most = seen
        self._readings.look(current)
        if self._dynamics.ticks % max(round(STUCK_S / self._dt), 1) == 0:
            self._give_up(self._readings.unmoved(joints[self._dynamics.columns], current))
        share = np.abs(rest) / most
        if self._busy or share.max() > CLEAR:
            self._judge(joints, current, rest, most, share)

    def _give_up(self, stuck: BoolArray) -> None:
        if stuck.any():
            names = ", ".join(self._servos[row].joint for row in np.flatnonzero(stuck))
            self._news.append(News(STUCK.format(names), kind=STUCK))
            self._busy = True

    def _judge(
        self, joints: FloatArray, current: FloatArray, rest: FloatArray, most: FloatArray, share: FloatArray
    ) -> None:
        beyond = share > 1.0
        begins = beyond & (self._beyond == 0.0)
        self._readings.judge(current, begins)
        self._beyond = np.where(beyond, self._beyond + self._dt * np.minimum(share, HARDEST), 0.0)
        sustained = self._beyond >= SUSTAINED_S
        # A register that has not changed by one step since then is no measurement: a contact is never so even.
        self._give_up(self._readings.give_up(sustained & ~self._readings.changed))
        stuck = self._readings.stuck
        pressing = sustained & ~stuck
        if self.pressed is None and pressing.any():
            self._press(int(np.where(pressing, share, 0.0).argmax()), joints, rest, most)
        self._clear = 0 if (share * ~stuck > CLEAR).any() else self._clear + 1
        self._pressing = 0 if self._clear or self.pressed is None else self._pressing + 1
        if self.pressed is not None and self._pressing * self._dt >= STILL_PRESSED_S:  # the robot has moved, too
            self.pressed, self._pressing = replace(self.pressed, joints=joints.copy()), 0
        if self.pressed is not None and self._clear * self._dt >= CLEAR_S:
            self.pressed = None
        self._busy = self.pressed is not None or bool(self._beyond.any() or stuck.any())

    def _press(self, row: int, joints: FloatArray, rest: FloatArray, most: FloatArray) -> None:
        joint, torque = self._servos[row].joint, abs(float(rest[row]))
        force, at = self._force(row, torque)
        words = "" if force is None else f", at least {force:.0f} N at {at}"
        text = PRESSES.format(joint, torque, float(most[row]), words)
        news, before = CLEAR_IT.format(text), self.presses
        self._news.append(news if before is None else News(news, kind=CLEAR_IT))
        times = 1 if before is None else before.times + 1
        if before is None or torque > before.torque:
            self.presses = Presses(times, joint, torque, force, at)
        else:
            self.presses = replace(before, times=times)
        links = [link_of(self._robot, servo) for servo in self._servos]
        carry = [set(self._robot.body.chain_to_root(link)) for link in links]
        first = min((other for other in links if other in carry[row]), key=lambda link: len(carry[links.index(link)]))
        limb = np.zeros(len(joints), dtype=np.bool_)
        limb[[column for column, chain in zip(self._dynamics.columns, carry, strict=True) if first in chain]] = True
        self.pressed = Press(joint, text, limb, joints.copy())
        self._clear = self._pressing = 0

    def _force(self, row: int, torque: float) -> tuple[float | None, str]:
        """Least force of a torque, N: at the landmark with the longest lever."""
        robot, link = self._robot, link_of(self._robot, self._servos[row])
        dof = robot.body.dof_index(self._servos[row].joint)
        levers = {}
        for landmark in robot.profile.landmarks.values():
            frame = robot.frame(landmark.frame)
            if link in robot.body.chain_to_root(frame.body):
                jacobian = robot.kinematics.frame_jacobian(self._dynamics.q, frame.body, as_vector(frame.position))
                levers[landmark.frame] = norm(np.ascontiguousarray(jacobian[:3, dof]))
        name = max(levers, key=levers.__getitem__, default="")
        if not name or levers[name] < SHORTEST_LEVER:
            return None, ""
        return torque / levers[name], name
