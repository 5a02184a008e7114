"""The servos of a robot as MuJoCo actuators, two on each shaft, in the servo's own direction of rotation:

    drive:  clip(stiffness (goal - angle) - damping speed + fall speed, -stall, stall)   the loop at the present supply
    fall:   -fall speed                                                                  back-EMF

The joint bounds their sum to the greatest torque of the servo. A loop that is not saturated is a spring and a damper. A
saturated one gives `stall - fall speed`, the torque-speed line, implicitly and so stably. Stiffness (`hardware.servo`)
and line (`motors.yaml`) are identified separately. The motor of a servo without torque is open. Coupled servos pull a
tendon each.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from hardware.arrays import BoolArray, ByteArray, FloatArray
from hardware.bus import ServoAlert
from hardware.dynamixel.control_table import find_table
from hardware.motors import DriveNumbers
from hardware.servo import FULL_PWM, Layout, ServoSpec, full_drive_error, integral_rate, p_gain
from retarget.model.body_file import engine
from sim.emulator.power import OVERLOAD_EFFORT, OVERLOAD_TIME
from sim.servo_model import AMBIENT, HEAT_PER_AMPERE2, HEAT_TIME, IDLE_CURRENT, LARGEST_CURRENT, SUPPLY_RESISTANCE


@dataclass(frozen=True)
class PositionLoop:
    """Gains of drive = P e + I sum(e) - D w, |drive| <= 1, voltage = drive x supply.

    proportional 1/rad, derivative s/rad; integral: I over P gain, 1/s. Source: e-Manual, Position PID Gain (80, 82, 84)
    and Goal PWM (100, full at 885); for open units of time see `sim.emulator.servo2_registers`.
    """

    proportional: float
    derivative: float
    integral: float


def position_loop(servo: ServoSpec) -> PositionLoop:
    """The loop with the gains of the profile. A model without a P gain (AX-12A) has its default slope."""
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
    """Return whether the profile lacks the P gain of this servo."""
    return servo.gains.position_p is None and find_table(servo.model.name, servo.protocol).p_gain is not None


MOTOR, BACK_EMF, SHAFT = "physics_motor_", "physics_emf_", "physics_shaft_"
STRAIN_SHARE = 0.25
"""Share of the greatest torque that takes up all backlash."""
STRAIN_S = 0.02
"""Time constant with which the gears cross their backlash, s."""


@dataclass(frozen=True)
class Drive:
    """A servo, its motor and its loop. stiffness: of its shaft, N m/rad."""

    servo: ServoSpec
    numbers: DriveNumbers
    loop: PositionLoop
    stiffness: float

    @property
    def spring(self) -> float:
        """Torque of the spring at the error of full drive, N m per V of the supply."""
        gain = self.loop.proportional
        return self.stiffness / (gain * self.servo.model.voltage) if gain else 0.0

    @property
    def damping(self) -> float:
        """Damping of the loop beside its D gain, N m s/rad, with which the shaft has the lag of its P gain
        (`loop_lag`)."""
        lag = 1.0 / (self.loop.proportional * self.servo.model.no_load_speed) if self.loop.proportional else 0.0
        return max(self.stiffness * lag - self.numbers.viscous, 0.0)

    @property
    def most_torque(self) -> float:
        """The greatest torque of the motor, or that at the current limit if smaller, N m."""
        limit = self.servo.current_limit
        allowed = np.inf if limit is None else limit * self.numbers.torque_constant
        return min(self.numbers.most_torque, allowed)

    @property
    def coupled(self) -> bool:
        """True if the shaft turns two joints together with another servo."""
        return self.servo.coupling is not None

    @property
    def turns(self) -> tuple[tuple[str, float], ...]:
        """Joints that turn the shaft, with its signed turns per turn of each."""
        servo, coupling = self.servo, self.servo.coupling
        if coupling is None:
            return ((servo.joint, servo.direction * servo.gear),)
        shares = coupling.inverse[coupling.joints.index(servo.joint)]
        return tuple((joint, servo.direction * share) for joint, share in zip(coupling.joints, shares, strict=True))


def add_motors(spec: Any, drives: Sequence[Drive]) -> None:
    """Add actuators, armature and dry friction of these servos to a body; `Motors` adds viscous friction."""
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
    """The motors of a compiled model, arrays (n,) in servo order; angles of shafts from their zero ticks, rad.

    goal: angles, rad. driven: servos with torque.
    """

    def __init__(self, model: Any, drives: Sequence[Drive]) -> None:
        self._model = model
        names = [drive.servo.joint for drive in drives]
        self._motor = np.array([model.actuator(MOTOR + name).id for name in names], dtype=np.intp)
        self._emf = np.array([model.actuator(BACK_EMF + name).id for name in names], dtype=np.intp)
        self._qpos = np.array([model.joint(name).qposadr[0] for name in names], dtype=np.intp)
        self._dof = np.array([model.joint(name).dofadr[0] for name in names], dtype=np.intp)
        self._turns = np.zeros((len(drives), len(drives)))  # shaft angles = it @ joint angles
        for row, drive in enumerate(drives):
            for joint, share in drive.turns:
                self._turns[row, names.index(joint)] = share
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
        self.driven: BoolArray = np.zeros(len(names), dtype=np.bool_)
        # Viscous friction is set in the compiled model, whose arrays have one meaning in every version of the engine.
        for drive in drives:
            viscous, dof = drive.numbers.viscous, model.joint(drive.servo.joint).dofadr[0]
            if drive.coupled:
                model.dof_damping[dof] = 0.0
                model.tendon_damping[model.tendon(SHAFT + drive.servo.joint).id] = viscous
            else:
                model.dof_damping[dof] = drive.turns[0][1] ** 2 * viscous

    def power(self, driven: BoolArray, voltage: FloatArray) -> None:
        """Switch torque on for the servos `driven` (n,), at supplies `voltage` (n,) V, and off for all others."""
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
        """Set drive limits (n,) and P gains (n,) 1/rad, None: unchanged, for the next `power`."""
        self._limit = limit
        self._proportional = self._proportional if proportional is None else proportional

    def command(self, data: Any, elapsed: float) -> None:
        """Pass the goals to the engine for the next `elapsed` s; update backlash and I gain."""
        strain = np.clip(self.torque(data) / (STRAIN_SHARE * self._most), -1.0, 1.0)
        self._side += (strain - self._side) * min(elapsed / STRAIN_S, 1.0)
        reference = self.goal - self._play * self._side
        if self._integrates:
            error = self.goal - self.angle(data)
            most = 1.0 / np.maximum(self._proportional, 1e-9)
            self._sum += self._integral * error * elapsed
            self._sum = np.asarray(self.driven * np.clip(self._sum, -most, most))
            reference = reference + self._sum
        data.ctrl[self._motor] = reference

    def angle(self, data: Any) -> FloatArray:
        """Return shaft angles (n,) rad at the encoders, on the servo's side of the backlash."""
        return np.asarray(self._of_shafts(data.qpos[self._qpos]) + self._play * self._side)

    def shaft(self, data: Any, row: int) -> tuple[float, float]:
        """Return angle rad and speed rad/s of one shaft."""
        if self._plain is None:
            return float(self.angle(data)[row]), float(self.speed(data)[row])
        turns = float(self._plain[row])
        angle = turns * float(data.qpos[self._qpos[row]]) + float(self._play[row]) * float(self._side[row])
        return angle, turns * float(data.qvel[self._dof[row]])

    def speed(self, data: Any) -> FloatArray:
        """Return shaft speeds (n,) rad/s."""
        return self._of_shafts(data.qvel[self._dof])

    def torque(self, data: Any) -> FloatArray:
        """The torques (n,) of the motors at their shafts over the last step, N m."""
        force = data.actuator_force
        return np.asarray(np.minimum(np.maximum(force[self._motor] + force[self._emf], -self._most), self._most))

    def _of_shafts(self, joints: FloatArray) -> FloatArray:
        return np.asarray(joints * self._plain if self._plain is not None else self._turns @ joints)


HEAT_PER_WATT = HEAT_PER_AMPERE2 / (12.0 / LARGEST_CURRENT)
"""Final rise of temperature per loss, K/W: that of `sim.servo_model`, whose servo has 12 V / 2.3 A = 5.2 ohm."""
_OVERLOAD, _OVERHEATING = np.uint8(ServoAlert.OVERLOAD), np.uint8(ServoAlert.OVERHEATING)
NOTICED_V = 0.05
"""Change of the supply after which the motors are updated, V."""


class Electrics:
    """Electrical state of n servos, arrays (n,): voltage V, temperature degrees Celsius, alert bits.

    Not calibrated on hardware. The power of all servos, mechanical and lost in their windings, lowers the supply. A
    servo warms by its loss R i^2 with a first-order lag. trips: overload and overheating become alerts.
    """

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

    def current(self, torque: FloatArray, driven: BoolArray) -> FloatArray:
        """The currents (n,) of motors with `torque` N m, A."""
        return np.asarray(driven * torque / self._constant)

    def advance(self, torque: FloatArray, speed: FloatArray, driven: BoolArray, elapsed: float) -> bool:
        """Go on by `elapsed` s with `torque` (n,) N m at `speed` (n,) rad/s. Return whether the motors need an update:
        the supply has changed by more than NOTICED_V, or an alert is new."""
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
