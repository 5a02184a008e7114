"""The servos of a robot as MuJoCo actuators, two on each shaft, all in the servo's own sense of rotation:

    drive:  clip(stiffness (goal - angle) - damping speed + fall speed, -stall, stall)   the loop at the present supply
    fall:   -fall speed                                                                  what the turning motor loses

and the joint bounds their sum to what the servo gives (its current limit too). So a loop that is not saturated is a
spring and a damper, one that is gives `stall - fall speed`, the line of torque and speed, at every step of the engine,
and implicitly, which is stable. Stiffness (`hardware.servo`) and line (`motors.yaml`) are identified apart: no motor
with constant torque per ampere has both. Friction, armature and viscous friction are the joint's. A servo without
torque has neither actuator: its motor is open. Coupled servos pull a tendon each.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from hardware.arrays import BoolArray, ByteArray, FloatArray
from hardware.bus import ServoAlert
from hardware.dynamixel.control_table import find_table
from hardware.motors import DriveNumbers
from hardware.servo import (
    FULL_PWM,
    Layout,
    ServoSpec,
    full_drive_error,
    integral_rate,
    p_gain,
)
from retarget.model.body_file import engine
from sim.emulator.power import OVERLOAD_EFFORT, OVERLOAD_TIME
from sim.servo_model import AMBIENT, HEAT_PER_AMPERE2, HEAT_TIME, IDLE_CURRENT, LARGEST_CURRENT, SUPPLY_RESISTANCE

# The position loop of a servo from its gain registers: drive (share of full voltage) per error, speed and time.
#
#     drive = P e + I sum(e) - D w,    |drive| <= 1,    voltage = drive x supply
#
# Source: e-Manual, Position PID Gain (80, 82, 84: units 1/16, 1/65536, 1/128 of a PWM count per tick) and Goal PWM
# (100, full at 885). The units of time that it leaves open are those of `sim.emulator.servo2_registers`, as is the rule
# that the default D gain belongs to the loop that P alone describes. The older layout (MX, 28: P, 32 the default):
# `sim.emulator.servo1`.


@dataclass(frozen=True)
class PositionLoop:
    """proportional 1/rad, derivative s/rad: drive per error and per speed of the shaft. integral: I over P gain,
    1/s."""

    proportional: float
    derivative: float
    integral: float


def position_loop(servo: ServoSpec) -> PositionLoop:
    """The loop of a servo with the profile's gains. A model without a P gain (AX-12A) has its default slope."""
    gains, model = servo.gains, servo.model
    if model.layout_in(servo.protocol) is Layout.OLDER:
        return PositionLoop(1.0 / full_drive_error(p_gain(servo)), 0.0, integral_rate(servo))
    register = gains.position_p
    if not register:
        return PositionLoop(0.0, 0.0, 0.0)
    usual = find_table(model.name, 2)["position_d_gain"].initial or 0
    damping = max((gains.position_d or 0) - usual, 0) / 16.0  # [PWM counts per tick/ms]
    return PositionLoop(
        proportional=1.0 / full_drive_error(float(register)),
        derivative=1e-3 * damping / FULL_PWM / model.tick_rad,
        integral=integral_rate(servo),
    )


def gain_missing(servo: ServoSpec) -> bool:
    """Whether the profile does not have the P gain of this servo."""
    return servo.gains.position_p is None and find_table(servo.model.name, servo.protocol).p_gain is not None


MOTOR, BACK_EMF, SHAFT = "physics_motor_", "physics_emf_", "physics_shaft_"
STRAIN_SHARE = 0.25
"""Share of the most torque at which all of the play of the gears is taken up."""
STRAIN_S = 0.02
"""Time constant with which the gears change sides in their play."""


@dataclass(frozen=True)
class Drive:
    """One servo, its motor and its loop. stiffness: of its shaft, N m/rad. most_torque: that the shaft ever gives, N m,
    with the current limit."""

    servo: ServoSpec
    numbers: DriveNumbers
    loop: PositionLoop
    stiffness: float

    @property
    def spring(self) -> float:
        """Torque of full drive if the loop were a spring until then, N m per V of the supply."""
        gain = self.loop.proportional
        return self.stiffness / (gain * self.servo.model.voltage) if gain else 0.0

    @property
    def damping(self) -> float:
        """N m s/rad of the loop, beside its D gain: with it the shaft follows with the lag of the servo's P gain
        (`loop_lag`), however stiff it is. Identified servos have it, too: XM430-W350, 5.3 N m/rad, 0.23 N m s/rad."""
        lag = 1.0 / (self.loop.proportional * self.servo.model.no_load_speed) if self.loop.proportional else 0.0
        return max(self.stiffness * lag - self.numbers.viscous, 0.0)

    @property
    def most_torque(self) -> float:
        """The smaller of the greatest torque of the motor and of the torque at the current limit, N m."""
        limit = self.servo.current_limit
        allowed = np.inf if limit is None else limit * self.numbers.torque_constant
        return min(self.numbers.most_torque, allowed)

    @property
    def coupled(self) -> bool:
        """Whether the shaft turns two joints together with another servo."""
        return self.servo.coupling is not None

    @property
    def turns(self) -> tuple[tuple[str, float], ...]:
        """Joints that turn the shaft, and its signed turns per turn of each."""
        servo, coupling = self.servo, self.servo.coupling
        if coupling is None:
            return ((servo.joint, servo.direction * servo.gear),)
        shares = coupling.inverse[coupling.joints.index(servo.joint)]
        return tuple((joint, servo.direction * share) for joint, share in zip(coupling.joints, shares, strict=True))


def add_motors(spec: Any, drives: Sequence[Drive]) -> None:
    """Add actuators, armature and friction of these servos to a body. Viscous friction: `Motors`."""
    for drive in drives:
        numbers, joint = drive.numbers, spec.joint(drive.servo.joint)
        if drive.coupled:
            joint.armature = joint.frictionloss = 0.0
            # A tendon is as long as the shaft's angle.
            name, armature, friction = SHAFT + drive.servo.joint, numbers.armature, numbers.friction
            shaft = spec.add_tendon(name=name, armature=armature, frictionloss=friction)
            shaft.actfrclimited = True
            shaft.actfrcrange = drive.most_torque * np.array([-1.0, 1.0])
            for part, turns in drive.turns:
                shaft.wrap_joint(part, turns)
        else:
            ((_, turns),) = drive.turns
            joint.armature = turns**2 * numbers.armature
            joint.frictionloss = abs(turns) * numbers.friction
            joint.actfrclimited = True
            joint.actfrcrange = abs(turns) * drive.most_torque * np.array([-1.0, 1.0])
        _add_actuator(spec, drive, MOTOR)
    for drive in drives:
        _add_actuator(spec, drive, BACK_EMF)


def _add_actuator(spec: Any, drive: Drive, part: str) -> None:
    mujoco = engine()
    name = drive.servo.joint
    target, kind, turns = name, mujoco.mjtTrn.mjTRN_JOINT, drive.turns[0][1]
    if drive.coupled:
        target, kind, turns = SHAFT + name, mujoco.mjtTrn.mjTRN_TENDON, 1.0
    actuator = spec.add_actuator(name=part + name, target=target, trntype=kind)
    actuator.gaintype, actuator.biastype = mujoco.mjtGain.mjGAIN_FIXED, mujoco.mjtBias.mjBIAS_AFFINE
    actuator.dyntype = mujoco.mjtDyn.mjDYN_NONE
    actuator.gainprm[:] = 0.0  # a body file may set defaults
    actuator.biasprm[:] = 0.0
    actuator.gear[:] = [turns, 0.0, 0.0, 0.0, 0.0, 0.0]
    actuator.inheritrange = 0.0
    actuator.ctrllimited = False
    actuator.forcelimited = part == MOTOR
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
        self._limit = np.ones(len(names))  # of the drive
        self._most = np.array([drive.most_torque for drive in drives])
        self._proportional, self._derivative, self._integral = np.array(
            [(drive.loop.proportional, drive.loop.derivative, drive.loop.integral) for drive in drives]
        ).T
        self._per_volt, self._fall, self._play = np.array(
            [(one.stall_torque(1.0), one.back_emf, 0.5 * one.backlash) for one in (drive.numbers for drive in drives)]
        ).T
        self._spring, self._damping = np.array([(drive.spring, drive.damping) for drive in drives]).T
        self._side = np.zeros(len(names))  # of the play, -1 to 1
        self._sum: FloatArray = np.zeros(len(names))  # [rad] of the I gain
        self._integrates = bool(self._integral.any())
        self.goal = np.zeros(len(names))
        """Goal angles, rad."""
        self.driven: BoolArray = np.zeros(len(names), dtype=np.bool_)
        """Which servos have torque."""
        # Viscous friction is set in the compiled model, whose arrays have one meaning in every version of the engine.
        for drive in drives:
            viscous, dof = drive.numbers.viscous, model.joint(drive.servo.joint).dofadr[0]
            if drive.coupled:
                model.dof_damping[dof] = 0.0
                model.tendon_damping[model.tendon(SHAFT + drive.servo.joint).id] = viscous
            else:
                model.dof_damping[dof] = drive.turns[0][1] ** 2 * viscous

    def power(self, driven: BoolArray, voltage: FloatArray) -> None:
        """Give torque to the servos `driven` (n,), at supplies `voltage` (n,) V."""
        model = self._model
        on = driven.astype(np.float64)
        stall = self._per_volt * voltage
        full = self._spring * voltage
        self.driven = driven.copy()
        self._sum[~driven] = 0.0
        model.actuator_gainprm[self._motor, 0] = on * full * self._proportional
        model.actuator_biasprm[self._motor, 1] = -on * full * self._proportional
        model.actuator_biasprm[self._motor, 2] = on * (self._fall - self._damping - full * self._derivative)
        model.actuator_forcerange[self._motor, 0] = -stall * self._limit
        model.actuator_forcerange[self._motor, 1] = stall * self._limit
        model.actuator_biasprm[self._emf, 2] = -on * self._fall

    def tune(self, *, limit: FloatArray, proportional: FloatArray | None = None) -> None:
        """Set most drives (n,), and P gains (n,) 1/rad; None: those before. They hold from the next `power` on."""
        self._limit = limit
        self._proportional = self._proportional if proportional is None else proportional

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
        return np.asarray(self._of_shafts(data.qpos[self._qpos]) + self._play * self._side)

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
        for joint, share in drive.turns:
            turns[row, column[joint]] = share
    return turns


# Current, supply and heat of simulated servos: a stated model, calibrated on no hardware.
#
# Current is torque / kt. The supply is the nominal voltage of each model less what the power of all servos, mechanical
# and lost in their windings, costs in battery and wires. A servo warms as a first-order lag: its final rise is
# HEAT_PER_WATT times the loss R i^2 in its windings (the thermal resistance of `sim.servo_model`, whose servo has
# 12 V / 2.3 A = 5.2 ohm), reached with HEAT_TIME.

HEAT_PER_WATT = HEAT_PER_AMPERE2 / (12.0 / LARGEST_CURRENT)
"""Final rise of temperature per loss, K/W."""
_OVERLOAD, _OVERHEATING = np.uint8(ServoAlert.OVERLOAD), np.uint8(ServoAlert.OVERHEATING)
NOTICED_V = 0.05
"""Change of the supply after which the motors are updated, V."""


class Electrics:
    """Electrical state of n servos, arrays (n,): voltage V, temperature degrees Celsius, alert bits."""

    def __init__(self, drives: Sequence[Drive]) -> None:
        numbers = [drive.numbers for drive in drives]
        self._nominal = np.array([drive.servo.model.voltage for drive in drives])
        self._constant = np.array([one.torque_constant for one in numbers])
        self._resistance = np.array([one.resistance for one in numbers])
        self._hottest = np.array([one.temperature_limit for one in numbers])
        self._strain = OVERLOAD_EFFORT * np.array([drive.most_torque for drive in drives])
        self._strained = np.zeros(len(drives))  # [s]
        self.voltage: FloatArray = self._nominal.copy()
        self.temperature: FloatArray = np.full(len(drives), AMBIENT)
        self.alert: ByteArray = np.zeros(len(drives), dtype=np.uint8)
        self.trips = True
        """Whether overload and overheating become alerts."""

    def current(self, torque: FloatArray, driven: BoolArray) -> FloatArray:
        """Return the current of motors (n,) that give `torque` N m, A."""
        return np.asarray(driven * torque / self._constant)

    def advance(self, torque: FloatArray, speed: FloatArray, driven: BoolArray, elapsed: float) -> bool:
        """Go on by `elapsed` s in which the motors gave `torque` (n,) N m at `speed` (n,) rad/s. Return whether the
        motors need an update: the supply has changed by more than NOTICED_V, or an alert is new."""
        size = self.current(torque, driven)
        loss = self._resistance * size * size  # [W]
        final = AMBIENT + HEAT_PER_WATT * loss
        self.temperature = self.temperature - (final - self.temperature) * np.expm1(-elapsed / HEAT_TIME)
        strained = driven & (np.abs(torque) > self._strain)
        self._strained = (self._strained + elapsed) * strained
        overloaded, hot = self._strained >= OVERLOAD_TIME, self.temperature > self._hottest
        alert = self.alert | _OVERLOAD * overloaded | _OVERHEATING * hot
        fresh = self.trips and bool((alert != self.alert).any())
        if fresh:
            self.alert = alert
        drawn = float(np.maximum(loss + driven * torque * speed, 0.0).sum())  # [W] a motor that brakes gives none back
        voltage = self._nominal - SUPPLY_RESISTANCE * (IDLE_CURRENT * size.size + drawn / self._nominal[0])
        changed = abs(float(voltage[0] - self.voltage[0])) > NOTICED_V
        if changed:
            self.voltage = voltage
        return changed or fresh
