"""Goals for a robot that stands in what it planned, on servos that give way under its weight.

A servo with a P gain is a spring between its goal and its shaft: under a torque it stands beside its goal. On soft
servos a standing robot sways 1.4 times as far as planned, and its soles press elsewhere. The torques that a planned
posture needs are known (`GravityTorque`), so each goal is set beside the posture by just what its servo gives way. All
that looks at postures - limits of the plan, collisions, the record - looks at where the robot is held; what is sent
passes the gate, and keeps its limits.

Servos of different gains follow at different lags, and a leg whose knee leads its ankle is not where it was planned. So
joints that carry the robot wait for the slowest of them.
"""

from dataclasses import dataclass

import numpy as np

from hardware.arrays import FloatArray
from hardware.servo import loop_lag
from retarget.ik.base_pose import SupportFootBase, plant_root
from retarget.ik.gravity_torque import GravityTorque, joint_compliance
from retarget.ik.support_polygon import Stance
from retarget.model.robot import RobotBody
from retarget.robot.posture_reader import standing_dofs
from retarget.safety.gate import Gate, PathCheck

__all__ = ["CompensatedGoals", "HeldPath"]

MOST_RAD = 0.2
"""Farthest that a goal is beside its posture; a servo that gives way by more is overloaded."""
SPEED_SHARE = 0.4
"""Share of a joint's speed at which its goal may move away from its posture. Back to it, it goes at any."""
RISE_S = 2.0
"""So long after torque came on that share is reached, in line: nothing moves fast then."""
STILL_RAD = 1e-4
"""What is nearer to where it settles, and moves less in a tick, stands: a fifteenth of a tick of the encoder. Else a
robot that stops would not be at rest for long."""
MOST_ACCELERATION = 5.0
"""m/s^2 of the centre of mass that are believed: half of what would lift the soles off the ground."""


class HeldPath:
    """A `PathCheck` that looks at the postures in which a robot is held, on the way of the goals that hold it there."""

    def __init__(self, path_is_clear: PathCheck) -> None:
        self._path_is_clear = path_is_clear
        self._before, self._after = np.zeros(1), np.zeros(1)

    def expect(self, before: FloatArray, after: FloatArray) -> None:
        """How far (n,) rad goals are beside postures at the beginning of the next path, and from its second row on."""
        self._before, self._after = before, after

    def __call__(self, path: FloatArray, instead: FloatArray) -> bool:
        """Whether the postures of a path (k, n) rad of goals are clear; instead (k, n): what is followed if not."""
        held = path - self._after
        held[0] = path[0] - self._before
        return self._path_is_clear(held, instead - self._before)


@dataclass(frozen=True, eq=False)
class _Thought:
    """What a posture (n,) is sent as: `goal` (n,), beside it by what holds against the load, `compensated` (n,) rad,
    and by what it waits for slower joints, `behind` (n,) rad; and centre of mass with velocity, smoothed."""

    posture: FloatArray
    goal: FloatArray
    compensated: FloatArray
    behind: FloatArray
    com: FloatArray
    velocity: FloatArray


class CompensatedGoals:
    """A `hardware.guard_state.GoalFilter` in front of the gate: postures (n,) rad go in, goals come out.

    `position` is the posture, not the goal. A stop keeps goals as far beside postures as they were.
    """

    def __init__(
        self,
        gate: Gate,
        robot: RobotBody,
        stance: Stance,
        *,
        dt: float,
        settle: float,
        held: HeldPath | None = None,
        steps: bool = False,
    ) -> None:
        """settle: time constant, s, of the load. held: what `gate` asks about collision. steps: whether the robot may
        stand on either sole alone."""
        self._gate, self._robot, self._held, self._dt = gate, robot, held, dt
        self._stance = stance
        self._load, self._either = GravityTorque(robot, stance), SupportFootBase(robot, stance) if steps else None
        self._body = robot.body.solver_body()
        self._dofs = [robot.body.dof_index(joint) for joint in robot.joint_map.joints]
        self._give = joint_compliance(robot)
        self._most = SPEED_SHARE * robot.joint_map.max_velocity * dt  # (n,) [rad]
        self._rate = 1.0 / settle
        self._catch_up = dt / (dt + _waits(robot))  # (n,) share of its lead that a joint loses in a tick
        self._position, self._compensated, self._behind, self._moved = (gate.position for _ in range(4))
        self._com: FloatArray | None = None
        self._velocity = np.zeros(3)
        self._thought: _Thought | None = None
        self._ticks = 0  # since torque came on
        self._start(gate.position)

    @property
    def position(self) -> FloatArray:
        """Posture in which the robot is held by what was returned last, rad (n,); a copy."""
        return self._position.copy()

    @property
    def sent(self) -> FloatArray:
        """Goal that was returned last, rad (n,); a copy."""
        return self._gate.position

    @property
    def at_rest(self) -> bool:
        """Whether nothing is left to brake."""
        return self._gate.at_rest

    @property
    def beside(self) -> FloatArray:
        """How far goals are beside postures, rad (n,); a copy."""
        return self._compensated + self._behind

    def seed(self, position: FloatArray) -> None:
        """Start at rest at `position`, rad (n,), with goals that hold nothing yet. Raises HardwareError if not
        finite."""
        self._gate.seed(position)
        self._start(self._gate.position)

    def passes(self, goal: FloatArray) -> bool:
        """Whether `admit` would hold the robot in just this posture, rad (n,), now."""
        if not np.isfinite(goal).all():
            return False
        return self._gate.passes(self._think(goal).goal)

    def admit(self, goal: FloatArray) -> FloatArray:
        """Return what to send for a posture `goal`, rad (n,): what holds the robot there or, refused, the next goal of
        the braking trajectory."""
        if goal.shape != self._position.shape or not np.isfinite(goal).all():
            return self.brake()
        thought = self._think(goal)
        sent = self._gate.admit(thought.goal)
        if not np.array_equal(sent, thought.goal):
            self._stopped(sent)
            return sent
        self._moved = thought.compensated - self._compensated
        self._compensated, self._behind, self._position = thought.compensated, thought.behind, thought.posture
        self._com, self._velocity = thought.com, thought.velocity
        self._thought = None
        self._ticks += 1
        return sent

    def brake(self) -> FloatArray:
        """Return the next goal of the last verified braking trajectory, rad (n,)."""
        sent = self._gate.brake()
        self._stopped(sent)
        return sent

    def _start(self, position: FloatArray) -> None:
        self._compensated, self._behind, self._moved = (np.zeros_like(position) for _ in range(3))
        self._position = position
        self._ticks = 0
        self._forget()

    def _stopped(self, sent: FloatArray) -> None:
        """Something else was sent: goals stay as far beside postures as they are."""
        self._position = sent - self.beside
        self._moved = np.zeros_like(self._moved)
        self._forget()

    def _forget(self) -> None:
        """What comes next begins at rest."""
        self._com, self._velocity, self._thought = None, np.zeros(3), None

    def _think(self, posture: FloatArray) -> _Thought:
        """What to send for a posture (n,): asked twice in a tick, found once."""
        thought = self._thought
        if thought is None or not np.array_equal(thought.posture, posture):
            self._thought = thought = self._thought_of(np.array(posture, dtype=np.float64))
        if self._held is not None:
            self._held.expect(self.beside, thought.compensated + thought.behind)
        return thought

    def _thought_of(self, posture: FloatArray) -> _Thought:
        q = self._stance.q.copy()
        q[self._robot.servo_columns] = posture
        heights = None
        if self._either is None:
            plant_root(self._robot, self._stance.q, q)
        else:
            heights = self._either.plant(q)
        now = self._body.centre_of_mass(q[None])[0]
        com, velocity = (now, self._velocity) if self._com is None else (self._com, self._velocity)
        then = self._settled(com, velocity, now)
        acceleration = np.clip((then - velocity) / self._dt, -MOST_ACCELERATION, MOST_ACCELERATION)
        torque = self._load.torques(q, acceleration, heights=heights)[self._dofs]
        wanted = np.clip(self._give @ torque, -MOST_RAD, MOST_RAD)
        speed = self._settled(self._compensated, self._moved / self._dt, wanted)
        most = min(self._ticks * self._dt / RISE_S, 1.0) * self._most
        moved = np.clip(self._dt * speed, -most, most)
        still = np.maximum(np.abs(moved), np.abs(wanted - self._compensated)) < STILL_RAD
        compensated = np.where(still, self._compensated, self._compensated + moved)
        behind = (1.0 - self._catch_up) * (self._position + self._behind - posture)
        behind[np.abs(behind) < STILL_RAD] = 0.0
        goal, compensated = self._within(posture + behind, compensated)
        return _Thought(posture, goal, compensated, behind, com + self._dt * then, then)

    def _settled(self, at: FloatArray, velocity: FloatArray, wanted: FloatArray) -> FloatArray:
        """Velocity after a tick of what settles at `wanted` without overshoot, implicit in time."""
        gain = self._rate * self._dt
        return np.asarray((velocity + gain * self._rate * (wanted - at)) / (1.0 + 2.0 * gain + gain * gain))

    def _within(self, target: FloatArray, compensated: FloatArray) -> tuple[FloatArray, FloatArray]:
        """The goal that is beside a target (n,) by `compensated` (n,) rad, and by how much it is: within the gate's
        limits, if it need not be pushed away from the target for that. Else it is for the gate to refuse."""
        goal = self._gate.nearest(target + compensated)
        kept = goal - target
        lowest, highest = (
            np.minimum(self._compensated, 0.0) - self._most,
            np.maximum(self._compensated, 0.0) + self._most,
        )
        if ((kept < lowest) | (kept > highest)).any():
            return target + compensated, compensated
        return goal, kept


def _waits(robot: RobotBody) -> FloatArray:
    """How long (n,) s each joint that carries the robot waits for the slowest servo among them; 0 for all others."""
    protocols = {line.name: line.protocol for line in robot.profile.bus_specs()}
    lags = np.array([loop_lag(servo, protocol=protocols[servo.bus]) for servo in robot.joint_map.servos])
    dofs = [robot.body.dof_index(joint) for joint in robot.joint_map.joints]
    carrying = standing_dofs(robot)[dofs]
    return np.where(carrying, lags.max(where=carrying, initial=0.0) - lags, 0.0)
