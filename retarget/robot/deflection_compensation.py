"""Deflection compensation: goals that hold a robot in its planned posture, on servos that yield under its weight.

A servo with a P gain is a spring, so each goal is offset by its deflection. An I gain compensates by itself within
seconds, and the offset leaves that out. Joints that carry the robot wait for the slowest of them.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from hardware.arrays import FloatArray
from hardware.servo import integral_rate, loop_lag
from retarget.arithmetic import matmul
from retarget.ik.gravity_torque import GravityTorque, LinkMasses, joint_compliance
from retarget.ik.support_polygon import Stance
from retarget.model.robot import RobotBody, plant_root
from retarget.robot.landmarks import standing_dofs

MOST_RAD = 0.2
"""Greatest offset, rad; a servo that deflects further is overloaded."""
SPEED_SHARE = 0.4
"""Greatest speed of an offset's growth, relative to the joint's."""
RISE_S = 2.0
"""Rise time of that speed after torque came on, s."""
STILL_RAD = 1e-4
"""Movement of a resting offset, rad: a fifteenth of a tick of the encoder."""
MOST_ACCELERATION = 5.0
"""Bound of the acceleration of the mass, m/s^2: half of what would lift the soles."""


@dataclass(frozen=True, eq=False)
class Offset:
    """Offset of the goal from a posture (n,) rad.

    compensated: against the load, (n,) rad; moved: by that in the last tick; behind: to wait for slower joints;
    integrated: by I gains. masses, velocities (k, 3): of links, m and m/s. ticks: since torque came on. forced: by the
    gate's limits. walked: of a walking robot.
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
        """True if the offset has its own bounds."""
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
        carrying = standing_dofs(robot)[self._dofs]
        waits = np.where(carrying, self._lag.max(where=carrying, initial=0.0) - self._lag, 0.0)  # (n,) [s]
        self._catch_up = dt / (dt + waits)  # (n,)

    def measure(self, joints: FloatArray, imu: object) -> None:
        """Measurements have no effect on a robot that stands."""

    def begin(self, posture: FloatArray) -> Offset:
        """No offset, at rest in a posture (n,), rad."""
        none, masses = np.zeros_like(posture), self._masses.places(self._standing(posture))
        return Offset(posture, none, none, none, none, masses, np.zeros_like(masses), 0)

    def _standing(self, posture: FloatArray) -> FloatArray:
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
        """Goal (n,) that holds a posture (n,), rad, and its offset. nearest: maps a goal into the gate's limits."""
        q = self._standing(posture)
        # Accelerations of links are filtered, as second differences would be noise.
        velocities = self._settled(last.masses, last.velocities, self._masses.places(q))
        masses = last.masses + self._dt * velocities
        accelerations = (velocities - last.velocities) / self._dt
        acceleration, moment = self._masses.sums(masses, accelerations)
        acceleration = np.clip(acceleration, -MOST_ACCELERATION, MOST_ACCELERATION)
        torque = self._load.torques(q, acceleration, moment=moment)[self._dofs]
        # The I gain has summed up deflection and lag.
        desired = np.clip(matmul(self._compliance, torque) - last.integrated, -MOST_RAD, MOST_RAD)
        lag = self._lag / self._dt * (posture - last.posture)
        integrated = last.integrated + self._integral * self._dt * (desired + lag)
        speed = self._settled(last.compensated, last.moved / self._dt, desired)
        most = min(last.ticks * self._dt / RISE_S, 1.0) * self._most
        moved = np.clip(self._dt * speed, -most, most)
        still = np.maximum(np.abs(moved), np.abs(desired - last.compensated)) < STILL_RAD
        compensated = np.where(still, last.compensated, last.compensated + moved)
        behind = (1.0 - self._catch_up) * (last.posture + last.behind - posture)
        behind[np.abs(behind) < STILL_RAD] = 0.0
        # The gate's bounds may shorten an offset, not move it.
        target = posture + behind
        goal = nearest(target + compensated)
        kept, before = goal - target, last.compensated
        lowest, highest = np.minimum(before, 0.0) - self._most, np.maximum(before, 0.0) + self._most
        forced = bool(((kept < lowest) | (kept > highest)).any())
        moved, ticks = kept - before, last.ticks + 1
        return goal, Offset(posture, kept, moved, behind, integrated, masses, velocities, ticks, forced)

    def _settled(self, at: FloatArray, velocity: FloatArray, target: FloatArray) -> FloatArray:
        # Backward Euler of x'' = r^2 (target - x) - 2 r x'
        gain = self._rate * self._dt
        return np.asarray((velocity + gain * self._rate * (target - at)) / (1.0 + 2.0 * gain + gain * gain))
