"""`python -m benchmarks.walking`: OP3 walks in physics by a step pattern, within the limits of its profile.

Pattern, legs and feedback are `benchmarks.walking_pattern`, `walking_legs` and `walking_feedback`; this module lets
them walk a robot with mass, whose masses, friction, IMU, delay and play are drawn by a seed, and counts.

Measured 2026-11-30 with the usual gait (0.576 s a step, 64 ms of it on both feet, 10 mm high), moving arms, start and
stop in each run, links that collide; posture within 4.5 rad/s and 40 rad/s^2; seeds from 100 on were not tuned on. What
is reached is a mean, all else the worst of the runs. Held back: share of ticks in which a limit held a joint back;
strained: in which a servo gave all that it has. Knee: RMS torque, and where its temperature would end by the model of
physics.

| request | stood | reached | slip mm a step | sway deg | rad/s | held back % | strained % | knee N m, C |
|--|--|--|--|--|--|--|--|--|
| in place, 30 s | 20/20 | 0.003 | 0.4 | 1.9 | 2.2 | hip roll 1 | - | 1.45, 32 |
| 0.05 m/s, 30 s | 20/20 | 0.049 | 0.5 | 1.8 | 2.2 | hip roll 1 | - | 1.51, 33 |
| 0.10 m/s, 60 s | 20/20 | 0.099 | 1.7 | 2.1 | 2.7 | hips 1 | knee 2 | 1.67, 35 |
| 0.15 m/s, 60 s | 20/20 | 0.150 | 1.7 | 2.2 | 4.0 | hip pitch 19, knee 15 | knee 8, hip pitch 6 | 1.86, 37 |
| sideways 0.04 m/s, 30 s | 20/20 | 0.036 | 0.9 | 1.8 | 3.1 | hip roll 1 | ankle roll 5, knee 2 | 1.56, 34 |
| turn 0.3 rad/s, 30 s | 20/20 | 0.283 | 1.1 | 2.4 | 2.1 | hip roll 2 | - | 1.45, 33 |
| 0.10, half stiffness, planned so, 20 s | 20/20 | 0.094 | 3.9 | 3.9 | 2.5 | ankle pitch 6 | knee 3 | 1.64, 35 |
| 0.10, half stiffness, not planned, 20 s | 19/20 | 0.106 | 18 | 11 | 3.4 | hip pitch 34 | hip pitch 6 | 1.46, 33 |
| in place, push 0.5 N s in 0.1 s, 8 sides | 40/40 | | 0.5 | 2.0 | | | | |
| 1.0 N s; 1.5 N s | 37/40; 19/40 | | 1.8; 2.2 | 15; 17 | | | | |
| limits on the goal: all but 0.15, 14 s | 50/50 | 0.098 | 1.3 | 3.0 | 3.6 | ankle roll 64 | ankle roll 7 | 1.65, 35 |
| limits on the goal: 0.15 m/s | 0/10 | | | | | | | |
| 0.328 s, 30 mm (the prototype's), all, 14 s | 20/30 | | 12 | 11 | 4.0 | hip pitch 92 | knee 58 | 2.32, 44 |

Beside it: 21 m at 0.15 m/s in one run; moving requests 5/5; arms that follow 02_01, 02_05, 02_10 and 49_18, at 0, 0.10
and 0.15 m/s: 11/12, for a forearm met a thigh that no observer kept it from. Where all joints brake in proportion at
any time, as the gate's stop does, the robot stays up: 36/36. At 0.15 m/s goals are at most 0.25 rad from their shafts,
and 0.15 for 0.2 s (one run).

What binds (`benchmarks.walking_fit`): in place and at low speed the acceleration of knees, which grows with the height
of a step over the square of its time; at 0.15 m/s that of knees and hip pitch (52 rad/s^2); at 0.20 m/s their speed,
5.4 rad/s, and 4.7 at the lowest steps tried, with three times the torque that is left there. With 60 rad/s^2 and 0.45
to 0.51 s a step 0.18 m/s stood (2 runs), with what the servos can do it fell: by their data hips can do 47, knees 55,
ankles 61 rad/s^2 (`servo_accelerations`: 2.95 N m by ToddlerBot's identification, armature 0.045 kg m^2 by Haarnoja et
al., Science Robotics 2024). ToddlerBot's files have an armature of 0.0025, with which hips could do 167: one number to
measure.

Torque ahead of time moves goals at 145 to 196 rad/s^2, which is no motion of the shaft: limits belong to the posture,
and its offset, 0.31 rad at most here, needs bounds of its own.
"""

from __future__ import annotations

import os

# One thread for every library, before any of them is loaded.
os.environ.update(dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1"))

import argparse
import math
from collections import deque
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.kept import run_cases
from benchmarks.table import print_table
from benchmarks.walking_body import WalkingBody
from benchmarks.walking_feedback import Feedback, Gains, GoalLimits
from benchmarks.walking_pattern import Gait, Request, Walk
from hardware.bus import ServoGoals
from hardware.clock import VirtualClock
from hardware.imu import ImuSample
from hardware.motors import drive_numbers
from hardware.servo import loop_lag, loop_stiffness
from retarget._solver import Braking
from retarget.model.body_file import engine
from retarget.model.robot import RobotBody, load_robot
from retarget.run.options import RunOptions
from retarget.run.prepare import prepare
from retarget.sources.open import open_source
from retarget.types import FloatArray
from sim.imu import ImuErrors, ImuStandIn, SensedMotion
from sim.mock_bus import mock_bus
from sim.physics.bus import PhysicsBus
from sim.physics.imu import LinkMotion
from sim.physics.motors import HEAT_PER_WATT
from sim.physics.mount import RELEASE_S, mount_of
from sim.physics.perturbation import NOMINAL, Push
from sim.physics.simulation import Simulation
from sim.physics.state import PhysicsState, StateReader
from sim.physics.witness import PhysicsLog
from sim.physics.world import build_world
from sim.servo_model import AMBIENT

SETTLED_S = RELEASE_S + 0.2
"""Time from the first torque until the walk begins."""
STOP_S = 4.0
"""Time before the end of a run at which it is asked to stop."""
RAMP = 0.03
"""Change of a request from step to step, m/s forward; half of it sideways, four times in rad/s."""
FELL = 0.7
"""Tilt of the trunk at which the robot has fallen, rad."""
BEHIND = 2
"""Ticks by which what is measured is older than what is planned: one of the bus, and one of servo and sensor."""
PLAY = math.radians(0.3)
"""Play of gears, rad, of which seeds draw 0.7 to 1.3."""
ERRORS = ImuErrors(
    angle_bias=math.radians(0.5), angle_noise=math.radians(0.1), turn_bias=0.005, turn_noise=0.01, delay=0.004
)
"""Those of the prototype's IMU, with a biased gyroscope."""
FULL = 0.97
"""Share of the torque at its speed from which on a servo is strained."""


@dataclass(frozen=True)
class Case:
    """One run of `seconds`. forward, left m/s, turn rad/s: asked. ticks, double, lift, height, width: of `Gait`.
    acceleration: limit of all joints, rad/s^2; 0: the profile's, -1: `servo_accelerations`; on: what it holds, the
    planned "posture" or the whole "goal". arms: size of their swing, rad; performer: a file that they follow instead.
    stiffness, planned: of the servos, and in the plan, as shares of the profile's. push: N s on the trunk, from a side
    that the seed says. armature: of all joints, kg m^2, 0: the model's, which is the plan's too. gains: of feedback,
    as "tilt=0.3 zmp=1"."""

    forward: float = 0.0
    left: float = 0.0
    turn: float = 0.0
    seconds: float = 20.0
    seed: int = 0
    ticks: int = 72
    double: int = 8
    lift: float = 0.01
    height: float = 0.23
    width: float = 0.095
    acceleration: float = 0.0
    on: str = "posture"
    arms: float = 0.3
    performer: str = ""
    stiffness: float = 1.0
    planned: float = 1.0
    push: float = 0.0
    armature: float = 0.0
    gains: str = ""


@dataclass
class Outcome:
    """What happened. stood: s. speed: reached before it was asked to stop, (3,) m/s, m/s, rad/s. slip: m a step. sway:
    95th percentile of the trunk's tilt, rad; error: of the divergent component's errors, (2,) m. limited: share of
    ticks in which limits held a joint back, by joint; strained: in which a servo gave all that it has. fastest: 99th
    percentile of the fastest joint, rad/s; most_offset: of a goal from its posture, rad. knee: RMS torque of the more
    loaded one, N m; warm, hot: its temperature at the end, and where it would go. touches: ticks in which links
    touched."""

    stood: float
    steps: int
    speed: list[float]
    slip: float
    sway: float
    error: list[float]
    limited: dict[str, float]
    strained: dict[str, float]
    fastest: float
    most_offset: float
    knee: float
    warm: float
    hot: float
    touches: int


def drawn_world(robot: RobotBody, start: FloatArray, case: Case) -> tuple[Simulation, SensedMotion, float]:
    """A simulation of the robot with what its seed draws, its IMU, and by how much its goals are late, s."""
    chance = np.random.default_rng(1000 + case.seed)
    perturbation = replace(
        NOMINAL,
        friction=NOMINAL.friction * chance.uniform(0.9, 1.1),
        stiffness_scale=case.stiffness,
        com_offset=(chance.normal(0.0, 0.0025), chance.normal(0.0, 0.0025), 0.0),
    )
    world = build_world(robot, start, mount=mount_of(robot), perturbation=perturbation)
    model = world.model
    factors = 1.0 + 0.05 * chance.uniform(-1.0, 1.0, model.nbody)
    model.body_mass[:] *= factors
    model.body_inertia[:] *= factors[:, None]
    drives = []
    for drive in world.drives:
        play = PLAY * chance.uniform(0.7, 1.3)
        drives.append(replace(drive, numbers=replace(drive.numbers, backlash=play)))
        dof = model.joint(drive.servo.joint).dofadr[0]
        model.dof_frictionloss[dof] *= chance.uniform(0.6, 1.4)
        if case.armature:
            model.dof_armature[dof] = case.armature
    simulation = Simulation(replace(world, drives=tuple(drives)), perturbation=perturbation, seed=case.seed)
    spec = robot.profile.imu_spec()
    assert spec is not None, "OP3 has an IMU"
    sensor = ImuStandIn(spec, seed=case.seed, motion=LinkMotion(simulation, spec), errors=ERRORS)
    return simulation, SensedMotion(spec, sensor), float(chance.uniform(0.0, 0.008))


def servo_accelerations(robot: RobotBody, model: Any) -> FloatArray:
    """Accelerations (n,) rad/s^2 that the servos of limbs in the air can give: torque less friction and weight, over
    armature and the limb's inertia, in the less favourable of `stand` and the zero posture."""
    mujoco = engine()
    data, found = mujoco.MjData(model), []
    drives = [drive_numbers(servo.model) for servo in robot.joint_map.servos]
    dofs = [int(model.joint(name).dofadr[0]) for name in robot.joint_map.joints]
    for posture in (robot.profile.postures.stand, dict[str, float]()):
        data.qpos[:] = model.qpos0
        for name, angle in posture.items():
            data.qpos[model.joint(name).qposadr[0]] = angle
        mujoco.mj_forward(model, data)
        inertia = []
        for dof in dofs:
            unit, moved = np.zeros(model.nv), np.zeros(model.nv)
            unit[dof] = 1.0
            mujoco.mj_mulM(model, data, moved, unit)
            inertia.append(moved[dof])
        left = np.array([one.most_torque - one.friction for one in drives]) - np.abs(data.qfrc_bias[dofs])
        found.append(left / np.array(inertia))
    return np.asarray(np.floor(np.minimum(*found)))


ARM_SWING = (
    ("l_sho_pitch", 1.0, 0.7, 0.0),
    ("r_sho_pitch", 1.0, 0.7, 0.0),
    ("l_el", 0.7, 0.5, 1.0),
    ("r_el", 0.7, 0.6, 2.0),
    ("l_sho_roll", 0.4, 0.4, 0.0),
    ("r_sho_roll", 0.4, 0.3, 1.0),
    ("head_pan", 1.0, 0.2, 0.0),
)
"""Joint, share of the swing's size, Hz, rad: rhythms other than the legs'."""


class Arms:
    """Arms and a head that move as by another's will: swinging, or as in a recording of a performer."""

    def __init__(self, robot: RobotBody, case: Case) -> None:
        self._joints = robot.joint_map.joints
        self._neutral = robot.posture(robot.profile.postures.neutral)[robot.servo_columns]
        self._size, self._rate = case.arms, robot.profile.safety.rate_hz
        self._path = followed_arms(case.performer) if case.performer else None

    def __call__(self, t: float) -> FloatArray:
        """Joints (n,) rad at t s after the first torque."""
        found = self._neutral.copy()
        share = min(max(t - SETTLED_S, 0.0) / 2.0, 1.0)
        if self._path is not None:
            # To its end and back again, so that nothing jumps.
            tick, last = round(max(t - SETTLED_S, 0.0) * self._rate), len(self._path) - 1
            found += share * (self._path[last - abs(tick % (2 * last) - last)] - found)
            return found
        for name, size, hertz, phase in ARM_SWING:
            found[self._joints.index(name)] += share * self._size * size * math.sin(2.0 * math.pi * hertz * t + phase)
        return found


@cache
def followed_arms(source: str) -> FloatArray:
    """Joints (T, n) rad of an OP3 that stands and follows a recording on mock servos, tick by tick."""
    options = RunOptions(robot="op3")
    with prepare(lambda: open_source(source), options, clock=VirtualClock(), make_bus=mock_bus) as prepared:
        run = prepared.run()
    assert run.moved_q is not None and run.robot is not None, "a run has a robot that moved"
    return np.asarray(run.moved_q[:, run.robot.servo_columns])


class Walker:
    """Goals of a walking robot, tick by tick. start (n,): rad, where it begins; offset (n,): rad, of the last goal from
    its posture; stopping: whether it was asked to stop. stiffness N m/rad, lag s, (n,): of the servos, as planned."""

    def __init__(self, robot: RobotBody, model: Any, case: Case) -> None:
        """model: of the robot as the plan takes it to be."""
        servos, limits = robot.joint_map.servos, robot.limits
        self.gait = gait = Gait(
            case.ticks, case.double, 1.0 / robot.profile.safety.rate_hz, case.height, case.width, case.lift
        )
        gains: dict[str, Any] = {name: float(value) for name, value in (one.split("=") for one in case.gains.split())}
        self.body = WalkingBody(robot, model, height=case.height)
        self.walk, self.feedback = Walk(gait), Feedback(gait, Gains(**gains), weight=self.body.weight)
        self._case, self._arms = case, Arms(robot, case)
        self.stiffness = case.planned * np.array([loop_stiffness(servo) for servo in servos])
        self.lag = np.array([loop_lag(servo) for servo in servos])
        self._armature = np.array([drive_numbers(servo.model).armature for servo in servos])
        self._tick, self._request, self.stopping = 0, Request(), False
        moment = self.walk.stand()
        for _ in range(STANDING_FITS):
            q = self.body.posture(moment, gait.height, self._arms(0.0))
        self._postures, self._moments = deque([q] * 3, 3), deque([moment] * (BEHIND + 2), BEHIND + 2)
        self.start, self.offset = self.body.joints(q), np.zeros(len(servos))
        most = limits.max_acceleration
        if case.acceleration:
            most = (
                np.full(len(servos), case.acceleration) if case.acceleration > 0 else servo_accelerations(robot, model)
            )
        braking = Braking(limits.lower, limits.upper, limits.max_velocity, most, dt=gait.dt)
        self.limits = GoalLimits(braking, most * gait.dt**2, self.start)

    def plan(self) -> tuple[FloatArray, FloatArray]:
        """Go on by a tick: the planned joints (n,) rad, and how far goals are beyond them, (n,) rad: a servo is a
        spring, and its shaft is late by its lag."""
        gait, body = self.gait, self.body
        self._tick += 1
        t = self._tick * gait.dt
        self.stopping = t > SETTLED_S + self._case.seconds - STOP_S
        moment = self.walk.stand()
        if t > SETTLED_S:
            moment = self.walk.advance(None if self.stopping else self._ramped())
        self._postures.append(body.posture(moment, gait.height, self._arms(t)))
        self._moments.append(moment)
        # Velocity and acceleration are differences about the posture before the last: so goals are one tick late.
        torque, speed, acceleration = body.torques(tuple(self._postures), gait.dt, self._moments[-2])
        ahead = (torque + self._armature * acceleration) / self.stiffness + self.lag * speed
        return body.joints(self._postures[1]), ahead

    def goal(self, joints: FloatArray, sample: ImuSample) -> FloatArray:
        """The goal (n,) rad of this tick, from encoders (n,) and the IMU."""
        planned, ahead = self.plan()
        then, now = self._moments[0], self._moments[-2]
        turns, torques = self.feedback.step(self.body.measure(joints, sample, then.yaw), then, now)
        columns = self.body.columns
        planned[columns] += turns
        self.offset = ahead
        self.offset[columns] += torques / self.stiffness[columns]
        if self._case.on == "goal":
            return self.limits.limit(planned + self.offset)
        return self.limits.limit(planned) + self.offset

    def _ramped(self) -> Request:
        """The request, which changes by little from step to step."""
        asked, now, most = self._case, self._request, RAMP / self.gait.ticks

        def toward(at: float, to: float, scale: float) -> float:
            return at + min(max(to - at, -scale * most), scale * most)

        forward, left = toward(now.forward, asked.forward, 1.0), toward(now.left, asked.left, 0.5)
        self._request = Request(forward, left, toward(now.turn, asked.turn, 4.0))
        return self._request


STANDING_FITS = 30
"""Times that the standing posture is fitted from scratch."""


class Record:
    """What is counted of a run, tick by tick."""

    def __init__(self, simulation: Simulation, reader: StateReader, walker: Walker, case: Case) -> None:
        robot, count = simulation.world.robot, len(walker.start)
        self._simulation, self._walker, self._case = simulation, walker, case
        self._log = PhysicsLog(
            servos=count, soles=2, corners=reader.corner_soles, nq=robot.body.nq, loaded=reader.loaded
        )
        self._limited, self._strained, self._squares = np.zeros(count), np.zeros(count), np.zeros(count)
        self._tilts, self._speeds, self._errors, self._offsets = [0.0], [0.0], [np.zeros(2)], [0.0]
        self._places: list[tuple[float, float, float, float]] = []

    def see(self, state: PhysicsState, tilt: float) -> None:
        """Count a tick in which it walked."""
        simulation, walker = self._simulation, self._walker
        self._log.add(state)
        torque, speed = simulation.motors.torque(simulation.data), simulation.motors.speed(simulation.data)
        self._limited += walker.limits.limited
        self._strained += at_limit(simulation, torque, speed)
        self._squares += torque**2
        self._tilts.append(tilt)
        self._speeds.append(float(np.abs(speed).max()))
        self._errors.append(np.abs(walker.feedback.error))
        self._offsets.append(float(np.abs(walker.offset).max()))
        if not walker.stopping and state.time > SETTLED_S + 0.3 * min(self._case.seconds, 20.0):
            x, y = state.root[:2].tolist()
            w, i, j, k = state.root[3:].tolist()
            self._places.append((state.time, x, y, math.atan2(2.0 * (w * k + i * j), 1.0 - 2.0 * (j * j + k * k))))

    def outcome(self, stood: float) -> Outcome:
        """What was counted of a robot that stood for so long, s."""
        simulation, walker = self._simulation, self._walker
        names = simulation.world.robot.joint_map.joints
        share = 1.0 / max(len(self._tilts) - 1, 1)
        knees = [names.index("l_knee"), names.index("r_knee")]
        knee = float(np.sqrt(self._squares[knees].max() * share))
        numbers = simulation.world.drives[knees[0]].numbers
        return Outcome(
            stood=stood,
            steps=walker.walk.steps,
            speed=self._speed(),
            slip=float(self._log.slip_m.sum()) / max(walker.walk.steps, 1),
            sway=float(np.percentile(self._tilts, 95)),
            error=[float(one) for one in np.percentile(np.array(self._errors), 95, axis=0)],
            limited={name: float(one) for name, one in zip(names, share * self._limited, strict=True) if one},
            strained={name: float(one) for name, one in zip(names, share * self._strained, strict=True) if one},
            fastest=float(np.percentile(self._speeds, 99)),
            most_offset=max(self._offsets),
            knee=knee,
            warm=float(simulation.electrics.temperature[knees].max()),
            hot=AMBIENT + HEAT_PER_WATT * numbers.resistance * (knee / numbers.torque_constant) ** 2,
            touches=self._log.self_contact_ticks,
        )

    def _speed(self) -> list[float]:
        """Mean velocity in the robot's own frame, (3,) m/s, m/s, rad/s."""
        if len(self._places) < 2:
            return [0.0, 0.0, 0.0]
        rows = np.array(self._places)
        passed, yaw = float(rows[-1, 0] - rows[0, 0]), np.unwrap(rows[:, 3])
        (x, y), c, s = np.diff(rows[:, 1:3], axis=0).T, np.cos(yaw[:-1]), np.sin(yaw[:-1])
        ways = float((c * x + s * y).sum()), float((c * y - s * x).sum()), float(yaw[-1] - yaw[0])
        return [way / passed for way in ways]


def at_limit(simulation: Simulation, torque: FloatArray, speed: FloatArray) -> FloatArray:
    """Which servos (n,) give all that they have at their speed, for torques N m and speeds rad/s, (n,) each."""
    numbers = [drive.numbers for drive in simulation.world.drives]
    stall = np.array([one.stall_torque(volt) for one, volt in zip(numbers, simulation.electrics.voltage, strict=True)])
    line = stall - np.array([one.back_emf for one in numbers]) * speed * np.sign(torque)
    most = np.array([drive.most_torque for drive in simulation.world.drives])
    return np.asarray(np.abs(torque) >= FULL * np.minimum(most, np.maximum(line, 0.0)))


def run_case(case: Case) -> list[Outcome]:
    """Walk once, until the end or a fall."""
    robot = load_robot("op3")
    nominal = build_world(robot, np.zeros(len(robot.joint_map.joints)), mount=mount_of(robot), perturbation=NOMINAL)
    walker = Walker(robot, nominal.model, case)
    simulation, imu, late = drawn_world(robot, walker.start, case)
    clock, dt = VirtualClock(), walker.gait.dt
    bus = PhysicsBus(simulation, clock, latency=dt + late, imu=imu)
    bus.open()
    bus.write(ServoGoals(robot.joint_map.to_ticks(walker.start)))
    bus.torque(True)
    if case.push:
        way, force = case.seed * math.pi / 4.0, case.push / PUSH_S
        # Seeds take eight sides in turn, and times that are spread over two steps (golden ratio).
        start = SETTLED_S + 4.0 + 2.0 * walker.gait.period * (0.618 * case.seed % 1.0)
        simulation.push(Push((force * math.cos(way), force * math.sin(way), 0.0), start, PUSH_S))
    reader = StateReader(simulation)
    record, stood = Record(simulation, reader, walker, case), -SETTLED_S
    for _ in range(round((SETTLED_S + case.seconds) / dt)):
        clock.sleep_until(clock.now() + dt)
        states, state = bus.read(), reader.read()
        assert states.imu is not None, "it has an IMU"
        _, x, y, _ = state.root[3:].tolist()
        tilt = math.acos(min(1.0 - 2.0 * (x * x + y * y), 1.0))
        if tilt > FELL or (state.touching and stood > 0.0):
            break
        goal = walker.goal(robot.joint_map.to_radians(states.position), states.imu)
        goal = np.clip(goal, robot.limits.lower, robot.limits.upper)
        bus.write(ServoGoals(robot.joint_map.to_ticks(goal)))
        stood += dt
        if walker.walk.steps and not walker.walk.over:
            record.see(state, tilt)
    return [record.outcome(stood)]


PUSH_S = 0.1
"""Duration of a push."""


REQUESTS: dict[str, dict[str, float]] = {
    "in place": {},
    "0.05 m/s": {"forward": 0.05},
    "0.10 m/s": {"forward": 0.10},
    "0.15 m/s": {"forward": 0.15},
    "sideways 0.04 m/s": {"left": 0.04},
    "turn 0.3 rad/s": {"turn": 0.3},
}
"""What is asked in each row of the table."""


def row(name: str, found: list[Outcome], seconds: float) -> list[str]:
    """The row of one request."""
    stood = [one for one in found if one.stood > seconds - 0.1]
    mean = np.array([one.speed for one in stood]).mean(axis=0) if stood else np.zeros(3)
    axis = 1 if "sideways" in name else 2 if "turn" in name else 0

    def worst(shares: list[dict[str, float]]) -> str:
        most: dict[str, float] = {}
        for one in shares:
            for joint, share in one.items():
                joint = joint.split("_", 1)[1]
                most[joint] = max(most.get(joint, 0.0), share)
        largest = sorted(most.items(), key=lambda item: -item[1])[:2]
        return ", ".join(f"{joint} {100.0 * share:.0f}" for joint, share in largest if share >= 0.005) or "-"

    return [
        name,
        f"{len(stood)}/{len(found)}",
        f"{mean[axis]:.3f}",
        f"{1e3 * max((one.slip for one in stood), default=0.0):.1f}",
        f"{math.degrees(max((one.sway for one in stood), default=0.0)):.1f}",
        f"{max((one.fastest for one in stood), default=0.0):.1f}",
        worst([one.limited for one in stood]),
        worst([one.strained for one in stood]),
        f"{max((one.knee for one in stood), default=0.0):.2f}",
        f"{max((one.warm for one in stood), default=0.0):.0f}, {max((one.hot for one in stood), default=0.0):.0f}",
    ]


def main() -> None:
    """The command."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.walking", description=__doc__)
    parser.add_argument("--seconds", type=float, default=60.0, help="of each run")
    parser.add_argument("--seeds", type=int, nargs=2, default=(100, 110), help="first, and one after the last")
    parser.add_argument("--jobs", type=int, default=1, help="processes")
    parser.add_argument("--keep", type=Path, help="file for every run; runs that are in it are not made again")
    parser.add_argument("--requests", nargs="+", choices=list(REQUESTS), default=list(REQUESTS), help="rows")
    parser.add_argument("--set", nargs="*", default=(), help="other values of a case, as ticks=56")
    asked = parser.parse_args()
    kinds = {name: type(value) for name, value in vars(Case()).items()}
    values = dict(one.split("=", 1) for one in asked.set)
    others: dict[str, Any] = {name: kinds[name](value) for name, value in values.items()}
    usual: dict[str, Any] = {"seconds": asked.seconds, **others}
    cases = {
        name: [Case(**{**usual, **request, "seed": seed}) for seed in range(*asked.seeds)]
        for name, request in REQUESTS.items()
        if name in asked.requests
    }
    every = [case for group in cases.values() for case in group]
    found = run_cases(every, run_case, Outcome, jobs=asked.jobs, keep=asked.keep)
    heads = ["request", "stood", "reached", "slip mm a step", "sway deg", "fastest rad/s", "held back %", "strained %"]
    rows = [row(name, [one for case in group for one in found[case]], asked.seconds) for name, group in cases.items()]
    print_table([*heads, "knee N m", "knee C"], rows, text=1)


if __name__ == "__main__":
    main()
