"""Deflection compensation: goals that hold a robot in its planned posture, on servos that yield under its weight.

A servo with a P gain is a spring between goal and shaft. The torques of a planned posture are known (`GravityTorque`),
so each goal is offset by the deflection of its servo. Limits and collisions are checked on the posture, and the gate
also checks the goal. An I gain compensates within seconds by itself: the offset leaves out what it has added.

Servos with different gains lag differently, so joints that carry the robot wait for the slowest of them.
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
"""Greatest offset of a goal from its posture, rad; a servo that deflects further is overloaded."""
SPEED_SHARE = 0.4
"""Greatest speed of a goal away from its posture, relative to the joint's. Its return is not limited."""
RISE_S = 2.0
"""Time in which that speed rises from 0 after torque came on, s."""
STILL_RAD = 1e-4
"""An offset so near to its final value that moves less in a tick stands still, rad: a fifteenth of a tick of the
encoder."""
MOST_ACCELERATION = 5.0
"""Bound of the acceleration of the centre of mass, m/s^2: half of what would lift the soles."""


@dataclass(frozen=True, eq=False)
class Offset:
    """The goal's offset from a posture (n,) rad.

    compensated (n,): against the load, rad, which moved by `moved` (n,) in the last tick; behind (n,): to wait for
    slower joints; integrated (n,): added by the servos' I gains. masses, velocities (k, 3): of the links' masses, m and
    m/s, smoothed. ticks: since torque came on. forced: the gate's limits moved the offset by themselves. walked: offset
    of a walking robot.
    """

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
        """True if the offset has its own bounds, so that limits apply to the posture alone."""
        return self.walked is not None


class DeflectionCompensation:
    """A `retarget.safety.gate.Compensation`."""

    def __init__(self, robot: RobotBody, stance: Stance, *, dt: float, settle: float) -> None:
        """settle: time constant of the load, s."""
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
        # Only joints between root and soles move the whole body when one of them lags.
        carrying = standing_dofs(robot)[self._dofs]
        waits = np.where(carrying, self._lag.max(where=carrying, initial=0.0) - self._lag, 0.0)  # (n,) [s]
        self._catch_up = dt / (dt + waits)  # (n,) share of its waiting that ends in a tick

    def measure(self, joints: FloatArray, imu: object) -> None:
        """Measurements have no effect on a robot that stands."""

    def begin(self, posture: FloatArray) -> Offset:
        """Return no offset, at rest in a posture (n,), rad."""
        none, masses = np.zeros_like(posture), self._masses.places(self._standing(posture))
        return Offset(posture, none, none, none, none, masses, np.zeros_like(masses), 0)

    def _standing(self, posture: FloatArray) -> FloatArray:
        """Return the posture (nq,) with joints (n,) on planted soles."""
        q = self._stance.q.copy()
        q[self._robot.servo_columns] = posture
        plant_root(self._robot, self._stance.q, q)
        return q

    def propose(
        self,
        last: Offset,
        posture: FloatArray,
        nearest: Callable[[FloatArray], FloatArray],
        *,
        ahead: FloatArray | None = None,
        walks: bool | None = False,
    ) -> tuple[FloatArray, Offset]:
        """Return the goal (n,) that holds the robot in a posture (n,), rad, and its offset. nearest: maps a goal to the
        nearest one within the gate's limits. ahead, walks: without effect."""
        q = self._standing(posture)
        # Accelerations of links load the legs, too. They are filtered, as second differences would be noise.
        velocities = self._settled(last.masses, last.velocities, self._masses.places(q))
        masses = last.masses + self._dt * velocities
        accelerations = (velocities - last.velocities) / self._dt
        acceleration, moment = self._masses.sums(masses, accelerations)
        acceleration = np.clip(acceleration, -MOST_ACCELERATION, MOST_ACCELERATION)
        torque = self._load.torques(q, acceleration, moment=moment)[self._dofs]
        # The goal is beyond the posture by compliance * torque, less what the I gain has added by summing up deflection
        # and lag.
        desired = np.clip(matmul(self._compliance, torque) - last.integrated, -MOST_RAD, MOST_RAD)
        lag = self._lag / self._dt * (posture - last.posture)
        integrated = last.integrated + self._integral * self._dt * (desired + lag)
        speed = self._settled(last.compensated, last.moved / self._dt, desired)
        most = min(last.ticks * self._dt / RISE_S, 1.0) * self._most
        moved = np.clip(self._dt * speed, -most, most)
        still = np.maximum(np.abs(moved), np.abs(desired - last.compensated)) < STILL_RAD
        compensated = np.where(still, last.compensated, last.compensated + moved)
        # A fast servo waits for the slowest of its chain by a first-order lag.
        behind = (1.0 - self._catch_up) * (last.posture + last.behind - posture)
        behind[np.abs(behind) < STILL_RAD] = 0.0
        # The gate's bounds may shorten the offset, but not move it by themselves; then the gate refuses the goal.
        target = posture + behind
        goal = nearest(target + compensated)
        kept, before = goal - target, last.compensated
        lowest, highest = np.minimum(before, 0.0) - self._most, np.maximum(before, 0.0) + self._most
        forced = bool(((kept < lowest) | (kept > highest)).any())
        moved, ticks = kept - before, last.ticks + 1
        return goal, Offset(posture, kept, moved, behind, integrated, masses, velocities, ticks, forced)

    def _settled(self, at: FloatArray, velocity: FloatArray, target: FloatArray) -> FloatArray:
        """Velocity after a tick of a critically damped second-order filter."""
        # Backward Euler of x'' = r^2 (target - x) - 2 r x' is stable for any r dt.
        gain = self._rate * self._dt
        return np.asarray((velocity + gain * self._rate * (target - at)) / (1.0 + 2.0 * gain + gain * gain))
