"""`python -m benchmarks.walking`: OP3 walks in physics by a step pattern, within the limits of its profile.

Pattern, legs and feedback are `benchmarks.walking_pattern`, `walking_legs` and `walking_feedback`; this module lets them
walk a robot with mass, whose masses, friction, IMU, delay and play are drawn by a seed, and counts.
"""

from __future__ import annotations

import os

# One thread for every library, before any of them is loaded.
os.environ.update(dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1"))

import argparse
import math
from collections import deque
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.kept import run_cases
from benchmarks.table import print_table
from benchmarks.walking_body import Measured, WalkingBody
from benchmarks.walking_feedback import Gains, GoalLimits, ankle_torques, turns_against, zmp_shift
from benchmarks.walking_pattern import Gait, Moment, Request, Walk, rotated
from hardware.bus import ServoGoals
from hardware.clock import VirtualClock
from hardware.servo import loop_lag, loop_stiffness
from retarget._solver import Braking
from retarget.ik.gravity_torque import GRAVITY
from retarget.model.robot import RobotBody, load_robot
from retarget.types import FloatArray
from sim.imu import ImuErrors, ImuStandIn, SensedMotion
from sim.physics.bus import PhysicsBus
from sim.physics.imu import LinkMotion
from sim.physics.motors import AMBIENT, HEAT_PER_WATT, drive_numbers
from sim.physics.mount import RELEASE_S, mount_of
from sim.physics.perturbation import NOMINAL, Perturbation, Push
from sim.physics.simulation import Simulation
from sim.physics.state import StateReader
from sim.physics.witness import PhysicsLog
from sim.physics.world import World, build_world

SETTLED_S = RELEASE_S + 0.2
"""Time from the first torque until steps begin."""
STOP_S = 4.0
"""Time before the end of a run at which it is asked to stop."""
RAMP = 0.03
"""Change of a request's speed from step to step, m/s or rad/s / 4."""
FELL = 0.7
"""Tilt of the trunk at which the robot has fallen, rad."""
SMOOTH_S = 0.02
"""Time constant of the measured velocity of the mass, and of what the IMU shows."""
BEHIND = 2
"""Ticks by which what is measured is older than what is planned: one of the bus, and one of servo and sensor."""


@dataclass(frozen=True)
class Case:
    """One run. forward, left m/s, turn rad/s: asked. seconds: of walking. acceleration: limit of all joints, rad/s^2, 0:
    the profile's; on: what the limits hold, "goal" or "posture". arms: of their swing, rad. stiffness: share of what the
    plan takes for granted."""

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
    stiffness: float = 1.0
    push: float = 0.0
    armature: float = 0.0
    gains: str = ""


@dataclass
class Outcome:
    """What happened. stood: s. speed: reached, (3,) m/s, m/s, rad/s. slip: m per step. sway: 95th percentile of the
    trunk's tilt, rad. limited: share of ticks in which limits held a joint back, by joint; strained: in which a servo was
    at its torque limit. knee: RMS torque of the more loaded one, N m; hot: where its temperature would end. fastest:
    99th percentile of the fastest joint, rad/s. touches: ticks in which links touched."""

    stood: float
    steps: int
    speed: list[float]
    slip: float
    sway: float
    limited: dict[str, float]
    strained: dict[str, float]
    knee: float
    hot: float
    warm: float
    fastest: float
    touches: int
    most_offset: float
    error: list[float] = field(default_factory=list)


def drawn_world(robot: RobotBody, start: FloatArray, case: Case) -> tuple[Simulation, SensedMotion, float]:
    """A simulation of the robot with what its seed draws, its IMU, and the delay of its goals, s."""
    chance = np.random.default_rng(1000 + case.seed)
    perturbation = replace(
        NOMINAL, friction=NOMINAL.friction * chance.uniform(0.9, 1.1), stiffness_scale=case.stiffness,
        com_offset=(chance.normal(0.0, 0.0025), chance.normal(0.0, 0.0025), 0.0),
    )
    world = build_world(robot, start, mount=mount_of(robot), perturbation=perturbation)
    model = world.model
    factors = 1.0 + 0.05 * chance.uniform(-1.0, 1.0, model.nbody)
    model.body_mass[:] *= factors
    model.body_inertia[:] *= factors[:, None]
    drives = []
    for drive in world.drives:
        play = math.radians(0.3) * chance.uniform(0.7, 1.3)
        drives.append(replace(drive, numbers=replace(drive.numbers, backlash=play)))
        dof = model.joint(drive.servo.joint).dofadr[0]
        model.dof_frictionloss[dof] *= chance.uniform(0.6, 1.4)
        if case.armature:
            model.dof_armature[dof] = case.armature
    simulation = Simulation(replace(world, drives=tuple(drives)), perturbation=perturbation, seed=case.seed)
    errors = ImuErrors(
        angle_bias=math.radians(0.5), angle_noise=math.radians(0.1), turn_bias=0.005, turn_noise=0.01, delay=0.004
    )
    spec = robot.profile.imu_spec()
    assert spec is not None
    sensor = ImuStandIn(spec, seed=case.seed, motion=LinkMotion(simulation, spec), errors=errors)
    return simulation, SensedMotion(spec, sensor), float(chance.uniform(0.0, 0.008))


class Arms:
    """Arms that swing by themselves, at another rhythm than the legs."""

    def __init__(self, robot: RobotBody, size: float) -> None:
        self._joints = robot.joint_map.joints
        self._stand = robot.posture(robot.profile.postures.neutral)[robot.servo_columns]
        self._size = size

    def __call__(self, t: float) -> FloatArray:
        """Joints (n,) rad of a robot that stands with its arms as at t s."""
        found = self._stand.copy()
        grown = self._size * min(max(t - SETTLED_S, 0.0) / 2.0, 1.0)
        for name, size, hertz, phase in ARM_SWING:
            found[self._joints.index(name)] += grown * size * (math.sin(2.0 * math.pi * hertz * t + phase))
        return found


ARM_SWING = (
    ("l_sho_pitch", 1.0, 0.7, 0.0), ("r_sho_pitch", 1.0, 0.7, 0.0), ("l_el", 0.7, 0.5, 1.0), ("r_el", 0.7, 0.6, 2.0),
    ("l_sho_roll", 0.4, 0.4, 0.0), ("r_sho_roll", 0.4, 0.3, 1.0), ("head_pan", 1.0, 0.2, 0.0),
)
"""Joint, share of the swing's size, Hz, rad."""


class Walker:
    """Goals of a walking robot, tick by tick."""

    def __init__(self, robot: RobotBody, model: Any, case: Case) -> None:
        servos = robot.joint_map.servos
        self.gait = gait = Gait(
            ticks=case.ticks, double_ticks=case.double, dt=1.0 / robot.profile.safety.rate_hz, height=case.height,
            width=case.width, lift=case.lift,
        )
        self.gains = Gains(**{key: float(value) for key, value in (one.split("=") for one in case.gains.split() )})
        self.body = WalkingBody(robot, model, height=case.height)
        self.walk = Walk(gait)
        self.arms = Arms(robot, case.arms)
        self._case = case
        self._stiffness = np.array([loop_stiffness(servo) for servo in servos])
        self._lag = np.array([loop_lag(servo) for servo in servos])
        self._armature = case.armature or np.array([drive_numbers(servo.model).armature for servo in servos])
        self._tick, self.stopping = 0, False
        self._request = Request()
        moment = self.walk.stand()
        for _ in range(30):
            start = self.body.posture(moment, gait.height, self.arms(0.0))
        self._postures, self._moments = deque([start] * 3, 3), deque([moment] * (BEHIND + 3), BEHIND + 3)
        joints = self.body.joints(start)
        self.start = joints
        limits = robot.limits
        most = np.full(len(servos), case.acceleration) if case.acceleration else limits.max_acceleration
        braking = Braking(limits.lower, limits.upper, limits.max_velocity, most, dt=gait.dt)
        self.limits = GoalLimits(braking, most * gait.dt**2, joints)
        self._before: FloatArray | None = None
        self._velocity = np.zeros((2, 2))
        self._rate, self._tilt = np.zeros(3), np.zeros(3)
        self.offset = np.zeros(len(servos))
        self.error = np.zeros(2)

    def goal(self, joints: FloatArray, sample: Any) -> FloatArray:
        """The goal (n,) rad of this tick, from encoders (n,) and the IMU."""
        gait, body = self.gait, self.body
        self._tick += 1
        t = self._tick * gait.dt
        self.stopping = t > SETTLED_S + self._case.seconds - STOP_S
        moment = self.walk.stand()
        if t > SETTLED_S:
            moment = self.walk.advance(None if self.stopping else self._ramped())
        self._postures.append(body.posture(moment, gait.height, self.arms(t)))
        self._moments.append(moment)
        moment = self._moments[-2]
        torque, speed, acceleration = body.torques(*self._postures, gait.dt, moment)
        planned = body.joints(self._postures[1])
        offset = (torque + self._armature * acceleration) / self._stiffness + self._lag * speed
        turn, push = self._feedback(body.measure(joints, sample, self._moments[-2 - BEHIND].yaw))
        self.offset = offset + push
        if self._case.on == "posture":
            return self.limits.limit(planned + turn) + self.offset
        return self.limits.limit(planned + turn + self.offset)

    def _ramped(self) -> Request:
        """The request, which changes by little from step to step."""
        asked, now = self._case, self._request
        most = RAMP / self.gait.ticks

        def toward(at: float, to: float, scale: float) -> float:
            return at + min(max(to - at, -scale * most), scale * most)

        self._request = Request(
            toward(now.forward, asked.forward, 1.0), toward(now.left, asked.left, 0.5), toward(now.turn, asked.turn, 4.0)
        )
        return self._request

    def _feedback(self, measured: Measured) -> tuple[FloatArray, FloatArray]:
        """Turns (n,) rad of joints against the tilt, and offsets (n,) rad that are torques of ankles."""
        gains, gait = self.gains, self.gait
        then, moment = self._moments[-2 - BEHIND], self._moments[-2]
        relative = (measured.mass - measured.soles)[:, :2]
        if self._before is not None:
            self._velocity += (gait.dt / (SMOOTH_S + gait.dt)) * ((relative - self._before) / gait.dt - self._velocity)
        self._before = relative
        divergent = np.zeros(2)
        for side, share in enumerate(then.shares):
            sole = then.soles[side]
            way = relative[side] + self._velocity[side] / gait.omega
            divergent += share * (sole.place[:2] + rotated(way, sole.yaw - float(measured.yaws[side])))
        self.error = divergent - then.pendulum.divergent
        # Noise of the gyroscope would be acceleration of goals.
        smooth = gait.dt / (SMOOTH_S + gait.dt)
        self._rate += smooth * (measured.rate - self._rate)
        self._tilt += smooth * (measured.tilt - self._tilt)
        turn, push = np.zeros(len(self.start)), np.zeros(len(self.start))
        for side, share in enumerate(moment.shares):
            hip, ankle = self.body.columns[side][1:3], self.body.columns[side][4:6]
            axes, sole = measured.axes[side], moment.soles[side]
            shift = rotated(zmp_shift(gains, rotated(self.error, -sole.yaw), np.zeros(2)), sole.yaw)
            force = share * self.body.mass * GRAVITY
            push[ankle] += ankle_torques(axes[4:6], shift, force) / self._stiffness[ankle]
            turn[hip] += share * turns_against(axes[1:3], gains.tilt * self._tilt + gains.hip_rate * self._rate)
            turn[ankle] += share * turns_against(axes[4:6], gains.ankle_rate * self._rate)
        return turn, push


def run_case(case: Case) -> list[Outcome]:
    """Walk once."""
    robot = load_robot("op3")
    nominal = build_world(robot, np.zeros(len(robot.joint_map.joints)), mount=mount_of(robot), perturbation=NOMINAL)
    walker = Walker(robot, nominal.model, case)
    simulation, imu, delay = drawn_world(robot, walker.start, case)
    clock, dt = VirtualClock(), walker.gait.dt
    bus = PhysicsBus(simulation, clock, latency=dt + delay, imu=imu)
    bus.open()
    states = bus.read()
    ticks = robot.joint_map.to_ticks(walker.start)
    bus.write(ServoGoals(ticks))
    bus.torque(True)
    if case.push:
        angle = case.seed * math.pi / 4.0
        force = case.push / 0.1
        start = SETTLED_S + 4.0 + 0.1 * case.seed
        simulation.push(Push((force * math.cos(angle), force * math.sin(angle), 0.0), start, 0.1))
    return [_walk(robot, walker, simulation, bus, clock, case)]


def _walk(robot: RobotBody, walker: Walker, simulation: Simulation, bus: PhysicsBus, clock: VirtualClock, case: Case) -> Outcome:
    """Walk until the end or a fall, and count."""
    reader, dt = StateReader(simulation), walker.gait.dt
    log = PhysicsLog(
        servos=len(walker.start), soles=2, corners=reader.corner_soles, nq=robot.body.nq, loaded=reader.loaded
    )
    limited, strained, squares = (np.zeros(len(walker.start)) for _ in range(3))
    tilts, speeds, errors, places = [], [], [], []
    most_offset = 0.0
    ticks, walked, stood = round((SETTLED_S + case.seconds) / dt), 0, -SETTLED_S
    for _ in range(ticks):
        clock.sleep_until(clock.now() + dt)
        states = bus.read()
        assert states.imu is not None
        goal = walker.goal(robot.joint_map.to_radians(states.position), states.imu)
        goal = np.clip(goal, robot.limits.lower, robot.limits.upper)
        bus.write(ServoGoals(robot.joint_map.to_ticks(goal)))
        state = reader.read()
        w, x, y, z = state.root[3:]
        tilt = math.acos(min(1.0 - 2.0 * (x * x + y * y), 1.0))
        if tilt > FELL or (state.touching and state.time > SETTLED_S):
            break
        stood += dt
        if walker.walk.steps < 1 or walker.walk.over:
            continue
        walked += 1
        log.add(state)
        limited += walker.limits.limited
        torque, speed = simulation.motors.torque(simulation.data), simulation.motors.speed(simulation.data)
        strained += _at_limit(simulation, torque, speed)
        squares += torque**2
        tilts.append(tilt)
        speeds.append(float(np.abs(speed).max()))
        errors.append(np.abs(walker.error))
        most_offset = max(most_offset, float(np.abs(walker.offset).max()))
        if walker.stopping:
            continue
        places.append((state.time, state.root[0], state.root[1], math.atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))))
    return _outcome(robot, walker, simulation, log, case, stood, walked, limited, strained, squares, tilts, speeds, errors, places, most_offset)


def _at_limit(simulation: Simulation, torque: FloatArray, speed: FloatArray) -> FloatArray:
    """Which servos give all that they can at their speed."""
    found = []
    for drive, one, fast, volt in zip(simulation.world.drives, torque, speed, simulation.electrics.voltage, strict=True):
        line = drive.numbers.stall_torque(volt) - drive.numbers.back_emf * fast * np.sign(one)
        found.append(abs(one) >= 0.97 * min(drive.most_torque, max(line, 0.0)))
    return np.array(found)


def _outcome(robot: RobotBody, walker: Walker, simulation: Simulation, log: PhysicsLog, case: Case, stood: float, walked: int, limited: FloatArray, strained: FloatArray, squares: FloatArray, tilts: list[float], speeds: list[float], errors: list[FloatArray], places: list[Any], most_offset: float) -> Outcome:
    names = robot.joint_map.joints
    share = 1.0 / max(walked, 1)
    knees = [names.index("l_knee"), names.index("r_knee")]
    rms = np.sqrt(squares[knees] * share)
    numbers = drive_numbers(robot.joint_map.servos[knees[0]].model)
    hot = AMBIENT + HEAT_PER_WATT * numbers.resistance * (rms.max() / numbers.torque_constant) ** 2
    speed = [0.0, 0.0, 0.0]
    late = [row for row in places if row[0] > SETTLED_S + min(6.0, 0.3 * case.seconds)]
    if len(late) > 10:
        rows = np.array(late)
        yaw = np.unwrap(rows[:, 3])
        passed = rows[-1, 0] - rows[0, 0]
        steps = np.diff(rows[:, 1:3], axis=0)
        c, s = np.cos(yaw[:-1]), np.sin(yaw[:-1])
        speed = [float((c * steps[:, 0] + s * steps[:, 1]).sum() / passed), float((c * steps[:, 1] - s * steps[:, 0]).sum() / passed), float((yaw[-1] - yaw[0]) / passed)]
    return Outcome(
        stood=stood,
        steps=walker.walk.steps,
        speed=speed,
        slip=float(log.slip_m.sum()) / max(walker.walk.steps, 1),
        sway=float(np.percentile(tilts, 95)) if tilts else 0.0,
        limited={name: float(one) for name, one in zip(names, limited * share, strict=True) if one},
        strained={name: float(one) for name, one in zip(names, strained * share, strict=True) if one},
        knee=float(rms.max()),
        hot=float(hot),
        warm=float(simulation.electrics.temperature[knees].max()),
        fastest=float(np.percentile(speeds, 99)) if speeds else 0.0,
        touches=log.self_contact_ticks,
        most_offset=most_offset,
        error=[float(one) for one in np.percentile(np.array(errors), 95, axis=0)] if errors else [],
    )


REQUESTS = {
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
    parser.add_argument("--set", nargs="*", default=(), help="other values of a case, as ticks=56")
    asked = parser.parse_args()
    kinds = {name: type(value) for name, value in vars(Case()).items()}
    values = dict(one.split("=", 1) for one in asked.set)
    others: dict[str, Any] = {name: kinds[name](value) for name, value in values.items()}
    usual: dict[str, Any] = {"seconds": asked.seconds, **others}
    cases = {
        name: [Case(**{**usual, **request, "seed": seed}) for seed in range(*asked.seeds)]
        for name, request in REQUESTS.items()
    }
    every = [case for group in cases.values() for case in group]
    found = run_cases(every, run_case, Outcome, jobs=asked.jobs, keep=asked.keep)
    heads = ["request", "stood", "reached", "slip mm a step", "sway deg", "fastest rad/s", "held back %", "strained %"]
    rows = [row(name, [one for case in group for one in found[case]], asked.seconds) for name, group in cases.items()]
    print_table([*heads, "knee N m", "knee C"], rows, text=1)


if __name__ == "__main__":
    main()
