"""Deflection compensation: goals that hold a robot in its planned posture, on servos that yield under its weight.

A servo with a P gain is a spring between its goal and its shaft: under a torque its shaft deflects from its goal. On
soft servos a standing robot sways 1.4 times as far as planned, and its soles press elsewhere. The torques that a
planned posture needs are known (`GravityTorque`), so each goal is offset from the posture by the deflection of its
servo. Limits of the plan, collisions and the record are checked on the posture in which the robot is held. The goal
passes the gate, and keeps its limits. An I gain makes up for deflections by itself, but late, within seconds: what it
has added by then is left out of the offset.

Servos of different gains follow at different lags, and a leg whose knee leads its ankle is not where it was planned. So
joints that carry the robot wait for the slowest of them.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from hardware.arrays import FloatArray
from hardware.servo import integral_rate, loop_lag
from retarget.arithmetic import matmul
from retarget.ik.base_pose import plant_root
from retarget.ik.gravity_torque import GravityTorque, LinkMasses, joint_compliance
from retarget.ik.support_polygon import Stance
from retarget.model.robot import RobotBody
from retarget.robot.landmarks import standing_dofs

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


@dataclass(frozen=True, eq=False)
class Offset:
    """For a posture (n,) rad: its offsets are `compensated` (n,) rad, which holds against the load and has moved by
    `moved` (n,) in the last tick, and `behind` (n,) rad, by which it waits for slower joints. integrated (n,): rad that
    the servos' I gains have added to the goal. masses, velocities (k, 3): of the links' masses, m and m/s, smoothed.
    ticks: since torque came on. forced: the gate's limits have made of the offset a motion of its own. walked: of a
    robot that walks, what its offset is made of instead."""

    posture: FloatArray
    compensated: FloatArray
    moved: FloatArray
    behind: FloatArray
    integrated: FloatArray
    masses: FloatArray
    velocities: FloatArray
    ticks: int
    forced: bool = False
    walked: Any = None

    @property
    def free(self) -> bool:
        """Whether the offset has bounds of its own, so that the limits are those of the posture alone."""
        return self.walked is not None


class DeflectionCompensation:
    """A `retarget.safety.gate.Compensation`."""

    def __init__(self, robot: RobotBody, stance: Stance, *, dt: float, settle: float) -> None:
        """settle: time constant, s, of the load."""
        self._robot, self._dt, self._stance = robot, dt, stance
        self._load = GravityTorque(robot, stance)
        self._masses = LinkMasses(robot)
        self._dofs = [robot.body.dof_index(joint) for joint in robot.joint_map.joints]
        self._most = SPEED_SHARE * robot.joint_map.max_velocity * dt  # (n,) [rad]
        self._rate = 1.0 / settle
        servos = robot.joint_map.servos
        self._compliance = joint_compliance(robot)  # (n, n) [rad/(N m)]
        self._lag = np.array([loop_lag(servo) for servo in servos])  # (n,) [s]
        self._integral = np.array([integral_rate(servo) for servo in servos])  # (n,) [1/s] rate of the I gain
        # Only joints between the root and the soles move the whole body when one of them is late: they wait for the
        # slowest servo among them.
        carrying = standing_dofs(robot)[self._dofs]
        waits = np.where(carrying, self._lag.max(where=carrying, initial=0.0) - self._lag, 0.0)  # (n,) [s]
        self._catch_up = dt / (dt + waits)  # (n,) share of its lead that a joint loses in a tick

    def measure(self, joints: FloatArray, imu: object) -> None:
        """What servos and IMU say makes no difference to a robot that stands."""

    def begin(self, posture: FloatArray) -> Offset:
        """No offset, at rest in a posture, rad (n,)."""
        none, masses = np.zeros_like(posture), self._masses.places(self._standing(posture))
        return Offset(posture, none, none, none, none, masses, np.zeros_like(masses), 0)

    def _standing(self, posture: FloatArray) -> FloatArray:
        """A posture (n,) as the robot stands in it (nq,)."""
        q = self._stance.q.copy()
        q[self._robot.servo_columns] = posture
        plant_root(self._robot, self._stance.q, q)
        return q

    def _smoothed(self, last: Offset, q: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Places (k, 3) m, velocities (k, 3) m/s and accelerations (k, 3) m/s^2 of the links' masses in a posture (nq,)
        that comes next. Second differences of a posture would be noise."""
        velocities = self._settled(last.masses, last.velocities, self._masses.places(q))
        return last.masses + self._dt * velocities, velocities, (velocities - last.velocities) / self._dt

    def propose(
        self,
        last: Offset,
        posture: FloatArray,
        nearest: Callable[[FloatArray], FloatArray],
        *,
        ahead: FloatArray | None = None,
        walks: bool | None = False,
    ) -> tuple[FloatArray, Offset]:
        """The goal (n,) that holds the robot in a posture (n,), rad. nearest: the goal within the gate's limits that is
        nearest to one. ahead, walks: make no difference to a robot that stands."""
        q = self._standing(posture)
        # Accelerations of the links load the legs as gravity does: that of the whole mass, and the rate of its angular
        # momentum, as of arms that swing or a trunk that bends.
        masses, velocities, accelerations = self._smoothed(last, q)
        acceleration, moment = self._masses.sums(masses, accelerations)
        acceleration = np.clip(acceleration, -MOST_ACCELERATION, MOST_ACCELERATION)
        torque = self._load.torques(q, acceleration, moment=moment)[self._dofs]
        # A servo with a P gain is a spring: it deflects by compliance * torque, and its goal is set beyond by as much.
        # What an I gain has added is not asked for again. It sums up the same error: the deflection and the lag.
        wanted = np.clip(matmul(self._compliance, torque) - last.integrated, -MOST_RAD, MOST_RAD)
        lag = self._lag / self._dt * (posture - last.posture)
        integrated = last.integrated + self._integral * self._dt * (wanted + lag)
        speed = self._settled(last.compensated, last.moved / self._dt, wanted)
        most = min(last.ticks * self._dt / RISE_S, 1.0) * self._most
        moved = np.clip(self._dt * speed, -most, most)
        # The offset follows as a second-order filter, with a limited speed that rises from 0 after torque came on.
        still = np.maximum(np.abs(moved), np.abs(wanted - last.compensated)) < STILL_RAD
        compensated = np.where(still, last.compensated, last.compensated + moved)
        # A fast servo waits for the slowest one of its chain: a first-order lag of its goal, with the difference of
        # both.
        behind = (1.0 - self._catch_up) * (last.posture + last.behind - posture)
        behind[np.abs(behind) < STILL_RAD] = 0.0
        # The gate's bounds may shorten the offset, but not turn it into a motion of its own: then the gate refuses the
        # goal, if it can.
        target = posture + behind
        goal = nearest(target + compensated)
        kept, before = goal - target, last.compensated
        lowest, highest = np.minimum(before, 0.0) - self._most, np.maximum(before, 0.0) + self._most
        forced = bool(((kept < lowest) | (kept > highest)).any())
        moved, ticks = kept - before, last.ticks + 1
        return goal, Offset(posture, kept, moved, behind, integrated, masses, velocities, ticks, forced)

    def _settled(self, at: FloatArray, velocity: FloatArray, wanted: FloatArray) -> FloatArray:
        """Velocity after a tick of a critically damped second-order filter towards `wanted`, implicit in time."""
        # Backward Euler of x'' = r^2 (wanted - x) - 2 r x': stable for any r dt.
        gain = self._rate * self._dt
        return np.asarray((velocity + gain * self._rate * (wanted - at)) / (1.0 + 2.0 * gain + gain * gain))
