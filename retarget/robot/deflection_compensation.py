"""Deflection compensation: goals that hold a robot in its planned posture, on servos that yield under its weight.

A servo with a P gain is a spring between its goal and its shaft: under a torque its shaft deflects from its goal. On
soft servos a standing robot sways 1.4 times as far as planned, and its soles press elsewhere. The torques that a
planned posture needs are known (`GravityTorque`), so each goal is offset from the posture by the deflection of its
servo. Limits of the plan, collisions and the record are checked on the posture in which the robot is held. The goal
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

MOST_RAD = 0.2
"""Greatest offset of a goal from its posture; a servo that deflects by more is overloaded."""
SPEED_SHARE = 0.4
"""Share of a joint's speed at which its goal may move away from its posture. Back to it, any speed is allowed."""
RISE_S = 2.0
"""Time after torque came on in which that share rises linearly from 0, so that nothing moves fast then."""
STILL_RAD = 1e-4
"""An offset that is nearer to its final value, and moves less in a tick, stands still: a fifteenth of a tick of the
encoder. Else a robot that stops would not come to rest for a long time."""
MOST_ACCELERATION = 5.0
"""m/s^2, to which the acceleration of the centre of mass is clipped: half of what would lift the soles off the
ground."""


class HeldPath:
    """A `PathCheck` of the postures in which a robot is held along a path of goals."""

    def __init__(self, path_is_clear: PathCheck) -> None:
        self._path_is_clear = path_is_clear
        self._before, self._after = np.zeros(1), np.zeros(1)

    def expect(self, before: FloatArray, after: FloatArray) -> None:
        """Set the offsets (n,) rad of goals from postures at the beginning of the next path, and from its second row
        on."""
        self._before, self._after = before, after

    def __call__(self, path: FloatArray, instead: FloatArray) -> bool:
        """Whether the postures of a path (k, n) rad of goals are clear; instead (k, n): what is followed if not."""
        held = path - self._after
        held[0] = path[0] - self._before
        return self._path_is_clear(held, instead - self._before)


@dataclass(frozen=True, eq=False)
class _Candidate:
    """The `goal` (n,) for a posture (n,): its offsets are `compensated` (n,) rad, which holds against the load, and
    `behind` (n,) rad, by which it waits for slower joints. Centre of mass and velocity are smoothed."""

    posture: FloatArray
    goal: FloatArray
    compensated: FloatArray
    behind: FloatArray
    com: FloatArray
    velocity: FloatArray


class CompensatedGoals:
    """A `hardware.guard_state.GoalFilter` in front of the gate: postures (n,) rad go in, goals come out.

    `position` is the posture, not the goal. A stop keeps the offsets of goals from postures as they were.
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
        """settle: time constant, s, of the load. held: the `PathCheck` of `gate`. steps: whether the robot may stand on
        either sole alone."""
        self._gate, self._robot, self._held, self._dt = gate, robot, held, dt
        self._stance = stance
        self._load, self._either = GravityTorque(robot, stance), SupportFootBase(robot, stance) if steps else None
        self._body = robot.body.solver_body()
        self._dofs = [robot.body.dof_index(joint) for joint in robot.joint_map.joints]
        self._compliance = joint_compliance(robot)
        self._most = SPEED_SHARE * robot.joint_map.max_velocity * dt  # (n,) [rad]
        self._rate = 1.0 / settle
        self._catch_up = dt / (dt + _waits(robot))  # (n,) share of its lead that a joint loses in a tick
        self._position, self._compensated, self._behind, self._moved = (gate.position for _ in range(4))
        self._com: FloatArray | None = None
        self._velocity = np.zeros(3)
        self._candidate: _Candidate | None = None
        self._ticks = 0  # since torque came on
        self._start(gate.position)

    @property
    def position(self) -> FloatArray:
        """Posture in which the last returned goal holds the robot, rad (n,); a copy."""
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
    def offset(self) -> FloatArray:
        """Offset of goals from postures, rad (n,); a copy."""
        return self._compensated + self._behind

    def seed(self, position: FloatArray) -> None:
        """Start at rest at `position`, rad (n,), with no offset. Raises HardwareError if not finite."""
        self._gate.seed(position)
        self._start(self._gate.position)

    def passes(self, goal: FloatArray) -> bool:
        """Whether `admit` would hold the robot in just this posture, rad (n,), now."""
        if not np.isfinite(goal).all():
            return False
        return self._gate.passes(self._candidate_for(goal).goal)

    def admit(self, goal: FloatArray) -> FloatArray:
        """Return the goal to send for a posture `goal`, rad (n,): the one that holds the robot there or, if the gate
        refuses it, the next goal of the braking trajectory."""
        if goal.shape != self._position.shape or not np.isfinite(goal).all():
            return self.brake()
        candidate = self._candidate_for(goal)
        sent = self._gate.admit(candidate.goal)
        if not np.array_equal(sent, candidate.goal):
            self._stopped(sent)
            return sent
        self._moved = candidate.compensated - self._compensated
        self._compensated, self._behind, self._position = candidate.compensated, candidate.behind, candidate.posture
        self._com, self._velocity = candidate.com, candidate.velocity
        self._candidate = None
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
        """Something else was sent: keep the offsets as they are."""
        self._position = sent - self.offset
        self._moved = np.zeros_like(self._moved)
        self._forget()

    def _forget(self) -> None:
        """Let the next posture begin at rest."""
        self._com, self._velocity, self._candidate = None, np.zeros(3), None

    def _candidate_for(self, posture: FloatArray) -> _Candidate:
        """The candidate for a posture (n,): called twice in a tick, computed once."""
        candidate = self._candidate
        if candidate is None or not np.array_equal(candidate.posture, posture):
            self._candidate = candidate = self._compute(np.array(posture, dtype=np.float64))
        if self._held is not None:
            self._held.expect(self.offset, candidate.compensated + candidate.behind)
        return candidate

    def _compute(self, posture: FloatArray) -> _Candidate:
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
        wanted = np.clip(self._compliance @ torque, -MOST_RAD, MOST_RAD)
        speed = self._settled(self._compensated, self._moved / self._dt, wanted)
        most = min(self._ticks * self._dt / RISE_S, 1.0) * self._most
        moved = np.clip(self._dt * speed, -most, most)
        still = np.maximum(np.abs(moved), np.abs(wanted - self._compensated)) < STILL_RAD
        compensated = np.where(still, self._compensated, self._compensated + moved)
        behind = (1.0 - self._catch_up) * (self._position + self._behind - posture)
        behind[np.abs(behind) < STILL_RAD] = 0.0
        goal, compensated = self._within(posture + behind, compensated)
        return _Candidate(posture, goal, compensated, behind, com + self._dt * then, then)

    def _settled(self, at: FloatArray, velocity: FloatArray, wanted: FloatArray) -> FloatArray:
        """Velocity after a tick of a critically damped second-order filter towards `wanted`, implicit in time."""
        gain = self._rate * self._dt
        return np.asarray((velocity + gain * self._rate * (wanted - at)) / (1.0 + 2.0 * gain + gain * gain))

    def _within(self, target: FloatArray, compensated: FloatArray) -> tuple[FloatArray, FloatArray]:
        """The goal with the offset `compensated` (n,) rad from a target (n,), and its real offset: within the gate's
        limits, if that does not push it away from the target. Else the gate is to refuse it."""
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
    """Time (n,) s that each joint that carries the robot waits for the slowest servo among them; 0 for all others."""
    protocols = {line.name: line.protocol for line in robot.profile.bus_specs()}
    lags = np.array([loop_lag(servo, protocol=protocols[servo.bus]) for servo in robot.joint_map.servos])
    dofs = [robot.body.dof_index(joint) for joint in robot.joint_map.joints]
    carrying = standing_dofs(robot)[dofs]
    return np.where(carrying, lags.max(where=carrying, initial=0.0) - lags, 0.0)
