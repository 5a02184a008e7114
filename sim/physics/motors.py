"""The servos of a robot as MuJoCo actuators, two on each shaft, all in the servo's own sense of rotation:

    drive:  stall torque x clip(P (goal - angle) - D speed, -1, 1)     the position loop at the present supply
    e.m.f.: -(kt^2 / R) speed                                          what the turning motor takes off

and the joint bounds their sum to what the servo gives (its current limit too). So speed and torque are limited by the
supply at every step of the engine, and implicitly, which is stable. Friction, armature and viscous friction are the
joint's. A servo without torque has neither actuator: its motor is open. Coupled servos pull a tendon each.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from hardware.arrays import BoolArray, FloatArray
from hardware.coupling import Coupling
from hardware.servo import ServoSpec
from retarget.body_file import engine
from sim.physics.drive_numbers import DriveNumbers
from sim.physics.position_loop import PositionLoop

__all__ = ["Drive", "Motors", "add_motors"]

MOTOR, BACK_EMF, SHAFT = "physics_motor_", "physics_emf_", "physics_shaft_"
STRAIN_SHARE = 0.25
"""Share of the most torque that takes up all of the play of the gears."""
STRAIN_S = 0.02
"""Time constant with which the gears change sides in their play."""


@dataclass(frozen=True)
class Drive:
    """One servo, its motor and its loop. most_torque: that the shaft ever gives, N m, with the current limit."""

    servo: ServoSpec
    numbers: DriveNumbers
    loop: PositionLoop

    @property
    def most_torque(self) -> float:
        """The smaller of what it can and of what its current limit allows, N m."""
        limit = self.servo.current_limit
        allowed = np.inf if limit is None else limit * self.numbers.torque_constant
        return min(self.numbers.most_torque, allowed)

    @property
    def turns(self) -> float:
        """Signed shaft turns per joint turn of a servo that is not coupled."""
        return self.servo.direction * self.servo.gear


def add_motors(spec: Any, drives: Sequence[Drive]) -> None:
    """Put actuators, armature and friction of these servos into a body. Viscous friction: `Motors`."""
    mujoco = engine()
    for drive in drives:
        numbers, joint = drive.numbers, spec.joint(drive.servo.joint)
        if drive.servo.coupling is None:
            turns = drive.turns
            joint.armature = turns**2 * numbers.armature
            joint.frictionloss = abs(turns) * numbers.friction
            joint.actfrclimited = True
            joint.actfrcrange = abs(turns) * drive.most_torque * np.array([-1.0, 1.0])
            target, kind = drive.servo.joint, mujoco.mjtTrn.mjTRN_JOINT
        else:
            joint.armature = joint.frictionloss = 0.0
            target, kind, turns = _add_shaft(spec, drive), mujoco.mjtTrn.mjTRN_TENDON, 1.0
        _add_actuator(spec, MOTOR + drive.servo.joint, target, kind, turns)
    for drive in drives:
        coupled = drive.servo.coupling is not None
        target = SHAFT + drive.servo.joint if coupled else drive.servo.joint
        kind = mujoco.mjtTrn.mjTRN_TENDON if coupled else mujoco.mjtTrn.mjTRN_JOINT
        _add_actuator(spec, BACK_EMF + drive.servo.joint, target, kind, 1.0 if coupled else drive.turns)


def _shaft_row(coupling: Coupling, drive: Drive) -> tuple[float, float]:
    """Turns of a coupled shaft per turn of each joint of the coupling."""
    first, second = coupling.inverse[coupling.joints.index(drive.servo.joint)]
    return drive.servo.direction * first, drive.servo.direction * second


def _add_shaft(spec: Any, drive: Drive) -> str:
    """A tendon that is as long as a coupled servo's shaft angle. Returns its name."""
    coupling, name = drive.servo.coupling, SHAFT + drive.servo.joint
    assert coupling is not None
    shaft = spec.add_tendon(name=name, armature=drive.numbers.armature, frictionloss=drive.numbers.friction)
    shaft.actfrclimited = True
    shaft.actfrcrange = drive.most_torque * np.array([-1.0, 1.0])
    for joint, turns in zip(coupling.joints, _shaft_row(coupling, drive), strict=True):
        shaft.wrap_joint(joint, turns)
    return name


def _add_actuator(spec: Any, name: str, target: str, kind: Any, turns: float) -> None:
    mujoco = engine()
    actuator = spec.add_actuator(name=name, target=target, trntype=kind)
    actuator.gaintype, actuator.biastype = mujoco.mjtGain.mjGAIN_FIXED, mujoco.mjtBias.mjBIAS_AFFINE
    actuator.dyntype = mujoco.mjtDyn.mjDYN_NONE
    actuator.gainprm[:] = 0.0  # a body file may set defaults
    actuator.biasprm[:] = 0.0
    actuator.gear[:] = [turns, 0.0, 0.0, 0.0, 0.0, 0.0]
    actuator.inheritrange = 0.0
    actuator.ctrllimited = False
    actuator.forcelimited = name.startswith(MOTOR)
    actuator.forcerange = [-1.0, 1.0]


class Motors:
    """The motors of a compiled model, arrays (n,) in servo order; angles of shafts from their zero ticks, rad."""

    def __init__(self, model: Any, drives: Sequence[Drive]) -> None:
        self._model = model
        names = [drive.servo.joint for drive in drives]
        self._motor = np.array([model.actuator(MOTOR + name).id for name in names], dtype=np.intp)
        self._emf = np.array([model.actuator(BACK_EMF + name).id for name in names], dtype=np.intp)
        self._qpos = np.array([model.joint(name).qposadr[0] for name in names], dtype=np.intp)
        self._dof = np.array([model.joint(name).dofadr[0] for name in names], dtype=np.intp)
        self._turns = _transmission(drives)  # (n, n) shaft angles = it @ joint angles
        self._plain = np.diag(self._turns).copy() if np.count_nonzero(self._turns) <= len(names) else None
        self._most = np.array([drive.most_torque for drive in drives])
        self._proportional = np.array([drive.loop.proportional for drive in drives])
        self._limit = np.ones(len(names))  # of the drive
        self._derivative = np.array([drive.loop.derivative for drive in drives])
        self._integral = np.array([drive.loop.integral for drive in drives])
        self._per_volt = np.array([drive.numbers.stall_torque(1.0) for drive in drives])
        self._back_emf = np.array([drive.numbers.back_emf for drive in drives])
        self._play = np.array([0.5 * drive.numbers.backlash for drive in drives])
        self._side = np.zeros(len(names))  # of the play, -1 to 1
        self._sum: FloatArray = np.zeros(len(names))  # [rad] of the I gain
        self._integrates = bool(self._integral.any())
        self.goal = np.zeros(len(names))
        """Goal angles, rad."""
        self.driven: BoolArray = np.zeros(len(names), dtype=np.bool_)
        """Which servos have torque."""
        _set_viscous(model, drives)

    def power(self, driven: BoolArray, voltage: FloatArray) -> None:
        """Give torque to the servos `driven` (n,), at supplies `voltage` (n,) V."""
        model = self._model
        on = driven.astype(np.float64)
        stall = self._per_volt * voltage
        self.driven = driven.copy()
        self._sum[~driven] = 0.0
        model.actuator_gainprm[self._motor, 0] = on * stall * self._proportional
        model.actuator_biasprm[self._motor, 1] = -on * stall * self._proportional
        model.actuator_biasprm[self._motor, 2] = -on * stall * self._derivative
        model.actuator_forcerange[self._motor, 0] = -stall * self._limit
        model.actuator_forcerange[self._motor, 1] = stall * self._limit
        model.actuator_biasprm[self._emf, 2] = -on * self._back_emf

    def tune(self, *, proportional: FloatArray, limit: FloatArray) -> None:
        """Set P gains (n,) 1/rad and most drives (n,); they hold from the next `power` on."""
        self._proportional, self._limit = proportional, limit

    def command(self, data: Any, elapsed: float) -> None:
        """Hand the goals to the engine for the next `elapsed` s; the play of the gears and the I gain move on."""
        strain = np.clip(self.torque(data) / (STRAIN_SHARE * self._most), -1.0, 1.0)
        self._side += (strain - self._side) * min(elapsed / STRAIN_S, 1.0)
        asked = self.goal - self._play * self._side
        if self._integrates:
            error = self.goal - self.angle(data)
            most = 1.0 / np.maximum(self._proportional, 1e-9)
            self._sum += self._integral * error * elapsed
            self._sum = np.asarray(self.driven * np.clip(self._sum, -most, most))
            asked = asked + self._sum
        data.ctrl[self._motor] = asked

    def angle(self, data: Any) -> FloatArray:
        """Shaft angles (n,) rad as the encoders see them, on the servo's side of the play."""
        return self._of_shafts(data.qpos[self._qpos]) + self._play * self._side

    def shaft(self, data: Any, row: int) -> tuple[float, float]:
        """Angle rad and speed rad/s of one shaft."""
        if self._plain is None:
            return float(self.angle(data)[row]), float(self.speed(data)[row])
        turns = float(self._plain[row])
        angle = turns * float(data.qpos[self._qpos[row]]) + float(self._play[row]) * float(self._side[row])
        return angle, turns * float(data.qvel[self._dof[row]])

    def speed(self, data: Any) -> FloatArray:
        """Shaft speeds (n,) rad/s."""
        return self._of_shafts(data.qvel[self._dof])

    def torque(self, data: Any) -> FloatArray:
        """Torques (n,) of the motors at their shafts over the last step, N m."""
        force = data.actuator_force
        return np.asarray(np.minimum(np.maximum(force[self._motor] + force[self._emf], -self._most), self._most))

    def _of_shafts(self, joints: FloatArray) -> FloatArray:
        return np.asarray(joints * self._plain if self._plain is not None else self._turns @ joints)


def _transmission(drives: Sequence[Drive]) -> FloatArray:
    """Shaft turns per joint turn (n, n), in servo order."""
    column = {drive.servo.joint: index for index, drive in enumerate(drives)}
    turns = np.zeros((len(drives), len(drives)))
    for row, drive in enumerate(drives):
        coupling = drive.servo.coupling
        if coupling is None:
            turns[row, row] = drive.turns
            continue
        for joint, share in zip(coupling.joints, _shaft_row(coupling, drive), strict=True):
            turns[row, column[joint]] = share
    return turns


def _set_viscous(model: Any, drives: Sequence[Drive]) -> None:
    """Set viscous friction in the compiled model, whose arrays have one meaning in every version of the engine."""
    for drive in drives:
        viscous = drive.numbers.viscous
        coupled = drive.servo.coupling is not None
        dof = model.joint(drive.servo.joint).dofadr[0]
        model.dof_damping[dof] = 0.0 if coupled else drive.turns**2 * viscous
        if coupled:
            model.tendon_damping[model.tendon(SHAFT + drive.servo.joint).id] = viscous
