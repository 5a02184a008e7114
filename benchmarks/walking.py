"""`python -m benchmarks.walking`: robots with mass walk as they are asked to, through the whole program.

A stick asks for one velocity while the arms follow a performer who stands (`--source`, again and again), and for a
stand 4 s before the end. The gate checks every goal; links collide. Each seed draws masses (5 %), centre of mass,
friction of floor and joints, play of gears, delay of the bus, and bias and noise of the IMU. Seeds from 100 on were not
tuned on.

Measured 2026-11-30, seeds from 100 on: the first five rows at 0dccb988, 60 s each, the others at bd807dbb, 30 s each,
and Wolfgang's 20. What is reached is a mean, all else the worst of the runs; offset: of a goal from its posture;
torque of the most loaded joint of a leg, RMS, and where its temperature was and would end.

| request | stood | reached | slip mm a step | sway deg | rad/s | offset rad | N m, C, C |
|--|--|--|--|--|--|--|--|
| in place | 12/12 | 0.003 | 0.3 | 2.4 | 2.6 | 0.16 | 1.1, 26, 29 |
| 0.10 m/s | 12/12 | 0.096 | 1.3 | 2.4 | 2.6 | 0.18 | 1.3, 26, 31 |
| 0.15 m/s | 12/12 | 0.141 | 2.9 | 2.6 | 3.1 | 0.23 | 1.5, 26, 33 |
| sideways 0.04 m/s | 12/12 | 0.040 | 0.7 | 2.4 | 2.6 | 0.20 | 1.3, 26, 31 |
| turn 0.3 rad/s | 12/12 | 0.266 | 1.8 | 2.5 | 2.6 | 0.17 | 1.1, 26, 29 |
| 0.10, half stiffness, planned so | 8/8 | 0.092 | 2.7 | 3.6 | 2.0 | 0.35 | 1.3, 26, 31 |
| 0.10, half stiffness, not planned | 8/8 | 0.088 | 6.8 | 10.7 | 3.0 | 0.20 | 1.2, 25, 30 |
| in place, push 0.5 N s | 8/8 | 0.003 | 0.3 | 2.3 | 2.6 | 0.17 | 1.1, 25, 29 |
| in place, push 1.0 N s | 7/8 | 0.003 | 0.7 | 2.6 | 2.6 | 0.17 | 1.1, 25, 29 |
| wolfgang with an IMU, in place | 3/3 | 0.006 | 0.4 | 2.7 | 3.4 | 0.16 | 3.0, 26, 34 |
| wolfgang with an IMU, 0.10 m/s | 3/3 | 0.096 | 1.0 | 2.6 | 3.4 | 0.16 | 3.0, 26, 34 |
| wolfgang with an IMU, turn 0.3 rad/s | 3/3 | 0.228 | 2.7 | 2.8 | 3.4 | 0.16 | 3.1, 26, 34 |

At 0.18 m/s OP3 stumbled in one of two runs: hips and knees would have to speed up by more than 40 rad/s^2. Without an
IMU, Wolfgang fell in 3 of 3 runs after three or four steps (of an earlier gait). ToddlerBot stays planted: its hips are
too weak for one leg.
"""

from __future__ import annotations

import os

# One thread for every library, before any of them is loaded.
os.environ.update(dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1"))

import argparse
import math
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.falls import with_imu
from benchmarks.kept import run_cases
from benchmarks.robustness import SYNTHETIC, motion
from benchmarks.table import print_table
from hardware.bus import ServoBus
from hardware.clock import Clock, VirtualClock
from hardware.joint_map import JointMap
from hardware.servo import p_gain
from retarget.cli.exit import StopRequest
from retarget.cli.operator import RunOperator
from retarget.human.samples import Playback
from retarget.model.robot import RobotBody, load_robot
from retarget.robot.walking.pattern import Request
from retarget.run.loop import RunObserver, Tick
from retarget.run.options import RunOptions
from retarget.run.prepare import Prepared, performance_of, prepare_for
from retarget.run.supervisor import OperatorInput
from retarget.types import RunState
from sim.imu import ImuErrors, ImuStandIn, SensedMotion
from sim.physics.bus import PhysicsBus
from sim.physics.imu import LinkMotion
from sim.physics.motors import HEAT_PER_WATT
from sim.physics.mount import mount_of
from sim.physics.perturbation import NOMINAL, Push
from sim.physics.simulation import Simulation
from sim.physics.witness import Witness, WitnessedBus
from sim.physics.world import build_world
from sim.servo_model import AMBIENT

STOP_S = 4.0
"""Time before the end of a run at which it is asked to stand."""
PUSH_S = 0.1
"""Duration of a push."""
PLAY = math.radians(0.3)
"""Play of gears, rad, of which seeds draw 0.7 to 1.3."""
ERRORS = ImuErrors(
    angle_bias=math.radians(0.5), angle_noise=math.radians(0.1), turn_bias=0.005, turn_noise=0.01, delay=0.004
)


@dataclass(frozen=True)
class Case:
    """One run of `seconds`. forward, left m/s, turn rad/s: asked. stiffness, planned: of the servos, and in the plan,
    as shares of the profile's. push: N s on the trunk, from a side that the seed says."""

    robot: str
    source: str
    seconds: float
    seed: int
    forward: float = 0.0
    left: float = 0.0
    turn: float = 0.0
    stiffness: float = 1.0
    planned: float = 1.0
    push: float = 0.0


@dataclass
class Outcome:
    """What happened. stood: whether it did to the end; reason: why it stopped before. steps: made. speed: reached, (3,)
    m/s, m/s, rad/s. slip: m a step. sway: 95th percentile of the trunk's tilt once it steps, rad. fastest: 99th
    percentile of the fastest joint, rad/s; most_offset: of a goal from its posture, rad. knee: RMS torque of the more
    loaded leg joint, N m; warm, hot: its temperature at the end, and where it would go. gated: ticks in which the gate
    refused what was asked, as a share."""

    stood: bool
    reason: str
    steps: int
    speed: list[float]
    slip: float
    sway: float
    fastest: float
    most_offset: float
    knee: float
    warm: float
    hot: float
    gated: float


IN_PLACE = Request(forward=1e-9)
"""Steps in place: a stick that asks for nothing asks to stand."""


class WalkRecord(RunObserver):
    """Asks for the velocity of a case, and counts the ticks of its walk."""

    def __init__(self, case: Case, simulation: Simulation, witness: Witness, stop: StopRequest) -> None:
        self._case, self._simulation, self._witness, self._stop = case, simulation, witness, stop
        self._begun: float | None = None
        self.robot: Any = None
        self.velocity = Request()
        self._places: list[tuple[float, float, float, float]] = []
        self._tilts, self._speeds, self._offsets, self._gated = [0.0], [0.0], [0.0], [False]
        self._squares = np.zeros(len(simulation.world.drives))
        self._slip = np.zeros(2)
        self.steps = 0

    def see(self, tick: Tick) -> None:
        """Look at a tick, and ask for the next one."""
        output, legs, now = tick.output, self.robot.legs, tick.given.now
        if output is None or output.run_state is not RunState.FOLLOW:
            return
        if self._begun is None:
            self._begun = now
            self._push(now)
        t, case = now - self._begun, self._case
        walks = 1.0 < t < case.seconds - STOP_S
        asked = Request(case.forward, case.left, case.turn)
        self.velocity = (IN_PLACE if asked == Request() else asked) if walks else Request()
        if t > case.seconds:
            self._stop.request("the case is over")
        if not legs.walks:
            self._slip = self._witness.log.slip_m.copy() if legs.tally().steps == 0 else self._slip
            return
        simulation, state = self._simulation, self._witness.state
        torque, speed = simulation.motors.torque(simulation.data), simulation.motors.speed(simulation.data)
        self._squares += torque * torque
        self._speeds.append(float(np.abs(speed).max()))
        w, i, j, k = state.root[3:].tolist()
        if self.steps > 1:  # before, the trunk comes up from where the performer had it
            self._tilts.append(math.acos(max(min(1.0 - 2.0 * (i * i + j * j), 1.0), -1.0)))
        self._gated.append(output.gated)
        if output.goal is not None:
            self._offsets.append(float(np.abs(output.goal.joints - output.goal.posture).max()))
        self.steps = legs.tally().steps
        if walks and t > 1.0 + 0.3 * min(case.seconds, 20.0):
            x, y = state.root[:2].tolist()
            self._places.append((now, x, y, math.atan2(2.0 * (w * k + i * j), 1.0 - 2.0 * (j * j + k * k))))

    def _push(self, now: float) -> None:
        case = self._case
        if case.push:
            way, force = case.seed * math.pi / 4.0, case.push / PUSH_S
            # Seeds take eight sides in turn, and times that are spread over two steps (golden ratio).
            start = now + 6.0 + 1.2 * (0.618 * case.seed % 1.0)
            self._simulation.push(Push((force * math.cos(way), force * math.sin(way), 0.0), start, PUSH_S))

    def outcome(self, stood: bool, reason: str) -> Outcome:
        """What was counted."""
        simulation, log = self._simulation, self._witness.log
        rms = np.sqrt(self._squares / max(len(self._speeds) - 1, 1))
        worst = int(rms.argmax())
        numbers = simulation.world.drives[worst].numbers
        return Outcome(
            stood=stood,
            reason=reason,
            steps=self.steps,
            speed=self._speed(),
            slip=float((log.slip_m - self._slip).sum()) / max(self.steps, 1),
            sway=float(np.percentile(self._tilts, 95)),
            fastest=float(np.percentile(self._speeds, 99)),
            most_offset=max(self._offsets),
            knee=float(rms[worst]),
            warm=float(simulation.electrics.temperature[worst]),
            hot=AMBIENT + HEAT_PER_WATT * numbers.resistance * (float(rms[worst]) / numbers.torque_constant) ** 2,
            gated=float(np.mean(self._gated)),
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


class Steers(RunOperator):
    """Asks for what a record asks for."""

    def __init__(self, prepared: Prepared, stop: StopRequest, record: WalkRecord) -> None:
        super().__init__(prepared, stop)
        self._record = record

    def poll(self, state: RunState | None) -> OperatorInput:
        """What is asked for now."""
        return replace(super().poll(state), velocity=self._record.velocity)


def drawn_world(robot: RobotBody, case: Case) -> tuple[Simulation, SensedMotion, float]:
    """A simulation of the robot with what its seed draws, its IMU, and by how much its goals are late, s."""
    chance = np.random.default_rng(1000 + case.seed)
    perturbation = replace(
        NOMINAL,
        friction=NOMINAL.friction * chance.uniform(0.9, 1.1),
        stiffness_scale=case.stiffness / case.planned,
        com_offset=(chance.normal(0.0, 0.0025), chance.normal(0.0, 0.0025), 0.0),
    )
    start = robot.posture(robot.profile.postures.rest)[robot.servo_columns]
    world = build_world(robot, start, mount=mount_of(robot), perturbation=perturbation)
    model, drives = world.model, []
    factors = 1.0 + 0.05 * chance.uniform(-1.0, 1.0, model.nbody)
    model.body_mass[:] *= factors
    model.body_inertia[:] *= factors[:, None]
    for drive in world.drives:
        play = PLAY * chance.uniform(0.7, 1.3)
        drives.append(replace(drive, numbers=replace(drive.numbers, backlash=play)))
        model.dof_frictionloss[model.joint(drive.servo.joint).dofadr[0]] *= chance.uniform(0.6, 1.4)
    simulation = Simulation(replace(world, drives=tuple(drives)), perturbation=perturbation, seed=case.seed)
    spec = robot.profile.imu_spec()
    assert spec is not None, "it has an IMU"
    sensor = ImuStandIn(spec, seed=case.seed, motion=LinkMotion(simulation, spec), errors=ERRORS)
    return simulation, SensedMotion(spec, sensor), float(chance.uniform(0.0, 0.008))


def softer(robot: RobotBody, share: float) -> RobotBody:
    """The robot with so much of its P gains."""
    servos = [
        replace(servo, gains=replace(servo.gains, position_p=round(share * p_gain(servo))))
        for servo in robot.joint_map.servos
    ]
    return robot if share == 1.0 else replace(robot, joint_map=JointMap(servos))


def run_case(case: Case) -> list[Outcome]:
    """Walk once, until the end or a fall."""
    robot = softer(with_imu(load_robot(case.robot)), case.planned)
    simulation, imu, late = drawn_world(robot, case)
    witness, stop = Witness(simulation), StopRequest()
    playback = Playback(loop=True)

    def make_bus(body: RobotBody, clock: Clock) -> ServoBus:
        cycle = 1.0 / body.profile.safety.rate_hz
        return WitnessedBus(PhysicsBus(simulation, clock, latency=cycle + late, imu=imu), witness)

    options = RunOptions(robot=case.robot, bus="physics", steps="walk", playback=playback)
    record = WalkRecord(case, simulation, witness, stop)
    perform = performance_of(lambda: motion(case.source), playback)
    with prepare_for(perform, options, clock=VirtualClock(), make_bus=make_bus, robot=robot) as prepared:
        assert prepared.machine is not None, "it has a robot"
        record.robot = prepared.machine.follower
        run = prepared.run(Steers(prepared, stop, record), [record])
    stopped = run.stop is not None and run.stop.reason != "the case is over"
    return [record.outcome(witness.fall is None and not stopped, run.stop.reason if stopped and run.stop else "")]


REQUESTS: dict[str, dict[str, float]] = {
    "in place": {},
    "0.10 m/s": {"forward": 0.10},
    "0.15 m/s": {"forward": 0.15},
    "sideways 0.04 m/s": {"left": 0.04},
    "turn 0.3 rad/s": {"turn": 0.3},
    "0.10, half stiffness, planned so": {"forward": 0.10, "stiffness": 0.5, "planned": 0.5},
    "0.10, half stiffness, not planned": {"forward": 0.10, "stiffness": 0.5},
    "in place, push 0.5 N s": {"push": 0.5},
    "in place, push 1.0 N s": {"push": 1.0},
}
"""What is asked in each row of the table, of OP3; speeds of others by the square root of their height."""


def row(name: str, found: list[Outcome]) -> list[str]:
    """The row of one request."""
    stood = [one for one in found if one.stood]
    mean = np.array([one.speed for one in stood]).mean(axis=0) if stood else np.zeros(3)
    axis = 1 if "sideways" in name else 2 if "turn" in name else 0

    def worst(of: str, unit: float = 1.0) -> str:
        return f"{unit * max((getattr(one, of) for one in stood), default=0.0):.2f}"

    return [
        name,
        f"{len(stood)}/{len(found)}",
        f"{mean[axis]:.3f}",
        worst("slip", 1e3),
        worst("sway", math.degrees(1.0)),
        worst("fastest"),
        worst("most_offset"),
        f"{worst('knee')}, {worst('warm')}, {worst('hot')}",
        worst("gated", 100.0),
    ]


def main() -> None:
    """The command."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.walking", description=__doc__)
    parser.add_argument("--robots", nargs="+", default=["op3"], help="by name or path")
    parser.add_argument("--source", default=SYNTHETIC, help=f"a motion file, or {SYNTHETIC}")
    parser.add_argument("--seconds", type=float, default=60.0, help="of each run")
    parser.add_argument("--seeds", type=int, nargs=2, default=(100, 110), help="first, and one after the last")
    parser.add_argument("--jobs", type=int, default=1, help="processes")
    parser.add_argument("--keep", type=Path, help="file for every run; runs that are in it are not made again")
    parser.add_argument("--requests", nargs="+", choices=list(REQUESTS), default=list(REQUESTS), help="rows")
    asked = parser.parse_args()
    cases = {
        (robot, name): [Case(robot, asked.source, asked.seconds, seed, **request) for seed in range(*asked.seeds)]
        for robot in asked.robots
        for name, request in REQUESTS.items()
        if name in asked.requests
    }
    every = [case for group in cases.values() for case in group]
    found = run_cases(every, run_case, Outcome, jobs=asked.jobs, keep=asked.keep)
    heads = ["request", "stood", "reached", "slip mm a step", "sway deg", "rad/s", "offset rad", "N m, C, C", "gated %"]
    rows = [
        row(name if robot == "op3" else f"{robot}, {name}", [one for case in group for one in found[case]])
        for (robot, name), group in cases.items()
    ]
    print_table(heads, rows, text=1)
    for one in (one for case in every for one in found[case] if one.reason):
        print(one.reason)


if __name__ == "__main__":
    main()
