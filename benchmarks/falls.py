"""`python -m benchmarks.falls`: how long before its trunk meets the floor a fall of a robot with mass is recognised.

Each seed draws a push of 0.2 s from any side at any time of the motion; --push 0 0 plays the motion alone, where every
recognised fall is a false one. --vary draws masses, friction and stiffness by the seed, too. A robot whose profile has
no IMU gets a BNO08x on its first link.
`--keep FILE` keeps each run as it ends, a line of JSON, and goes on from what it holds.
"""

from __future__ import annotations

import os

# One thread for every library, before any of them is loaded.
os.environ.update(dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1"))

import argparse
import math
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from benchmarks.kept import run_cases
from benchmarks.recording import RECORDING
from benchmarks.robustness import SYNTHETIC, motion
from benchmarks.table import print_table
from hardware.bus import ServoBus
from hardware.clock import Clock, VirtualClock
from retarget.cli.exit import StopRequest
from retarget.cli.operator import RunOperator
from retarget.human.samples import Playback
from retarget.model.robot import RobotBody, load_robot
from retarget.run.loop import RunObserver, Tick
from retarget.run.options import PhysicsOptions, RunOptions
from retarget.run.prepare import performance_of, prepare_for
from retarget.schema.profile_parts import Imu
from retarget.types import RunState
from sim.buses import DRAWN, physics_bus, simulation_of
from sim.physics.perturbation import Push, combined, drawn
from sim.physics.witness import WitnessedBus

PUSH_S = 0.2
"""Duration of a push."""
ASKED_S, ASKED = 0.15, 0.95
"""Time before the trunk meets the floor, and share of the falls that are recognised so early."""


@dataclass(frozen=True)
class Case:
    """One run. source: a file, or SYNTHETIC; force: of the push, N, lowest and highest; 0: none. varied: the body is
    not quite the one of the plan."""

    robot: str
    source: str
    end: float
    force: tuple[float, float]
    seed: int
    varied: bool = False


@dataclass(frozen=True)
class Outcome:
    """What happened, s on the run's time: when a fall was recognised, and when anything but soles and hands met the
    floor; None: never, it lies on its hands. fell: as the simulation sees it. most_tilt_deg: of the least tilted sole
    until a fall was recognised, or in the whole run."""

    seed: int
    recognised: float | None
    landed: float | None
    fell: bool
    most_tilt_deg: float


class FallRecord(RunObserver):
    """Notes when a fall is recognised, and when the robot lands."""

    def __init__(self, bus: WitnessedBus) -> None:
        self._witness = bus.witness
        self.recognised: float | None = None
        self.landed: float | None = None
        self.most_tilt = 0.0

    def see(self, tick: Tick) -> None:
        """Look at a tick."""
        now, state = tick.given.now, self._witness.state
        run_state = None if tick.output is None else tick.output.run_state
        if run_state is RunState.FALLING and self.recognised is None:
            self.recognised = now
        if self.recognised is None and run_state is not RunState.OFF:
            self.most_tilt = max(self.most_tilt, float(state.tilt.min()))
        if state.touching and self.landed is None and run_state is not RunState.GO_TO_REST:
            self.landed = now


def run_case(case: Case) -> list[Outcome]:
    """Play one, at the performer's speed."""
    draw = np.random.default_rng(case.seed + 1000)
    way, force = draw.uniform(0.0, 2.0 * math.pi), draw.uniform(*case.force)
    start = draw.uniform(4.0, 4.0 + case.end)
    options = RunOptions(
        robot=case.robot,
        bus="physics",
        physics=PhysicsOptions(seed=case.seed),
        playback=Playback(end=case.end),
    )
    buses: list[WitnessedBus] = []

    def make_bus(robot: RobotBody, clock: Clock) -> ServoBus:
        posture = robot.profile.postures.rest
        begins = robot.joint_map.to_ticks(robot.posture(posture)[robot.servo_columns])
        kinds = [drawn(kind, case.seed, within=(0, 0)) for kind in DRAWN] if case.varied else []
        simulation = simulation_of(robot, start=begins, seed=case.seed, perturbation=combined(kinds))
        if case.force[1] > 0.0:
            simulation.push(Push((force * math.cos(way), force * math.sin(way), 0.0), start, PUSH_S))
        buses.append(physics_bus(simulation, clock))
        return buses[0]

    robot = with_imu(load_robot(case.robot))
    perform = performance_of(lambda: motion(case.source), options.playback)
    with prepare_for(
        perform, options, clock=VirtualClock(), make_bus=make_bus, goes_to_rest=True, robot=robot
    ) as prepared:
        record = FallRecord(buses[0])
        prepared.run(RunOperator(prepared, StopRequest()), [record])
    fell = buses[0].witness.fall is not None
    return [Outcome(case.seed, record.recognised, record.landed, fell, math.degrees(record.most_tilt))]


def with_imu(robot: RobotBody) -> RobotBody:
    """The robot, with an IMU."""
    if robot.profile.imu is not None:
        return robot
    imu = Imu(kind="bno08x", port="/dev/imu", link=robot.body.body_names[1])
    return replace(robot, profile=robot.profile.model_copy(update={"imu": imu}))


def row(name: str, found: list[Outcome]) -> list[str]:
    """The row of one robot and motion."""
    fell, stood = ([one for one in found if one.fell is fell] for fell in (True, False))
    seen = [(one.recognised, math.inf if one.landed is None else one.landed) for one in fell]
    leads = [landed - recognised for recognised, landed in seen if recognised is not None]
    early = sum(lead >= ASKED_S for lead in leads)
    false = [str(one.seed) for one in stood if one.recognised is not None]
    return [
        name,
        str(len(found)),
        str(len(fell)),
        f"{early} of {len(fell)}" if fell else "-",
        f"{min(leads):.3f}" if leads else "-",
        f"{np.median(leads):.3f}" if leads else "-",
        f"{len(false)} of {len(stood)}",
        f"{max((one.most_tilt_deg for one in stood), default=0.0):.1f}",
        " ".join(false) or "-",
    ]


def main() -> None:
    """The command."""
    usual = str(RECORDING) if RECORDING.is_file() else SYNTHETIC
    parser = argparse.ArgumentParser(prog="python -m benchmarks.falls", description=__doc__)
    parser.add_argument("--robots", nargs="+", default=["op3", "wolfgang"], help="by name or path")
    parser.add_argument("--sources", nargs="+", default=[usual], help=f"motion files, or {SYNTHETIC}")
    parser.add_argument("--push", nargs=2, type=float, default=(10.0, 60.0), help="lowest and highest force, N")
    parser.add_argument("--vary", action="store_true", help="draw the body by the seed")
    parser.add_argument("--end", type=float, default=4.0, help="end at this time of the motion, s")
    parser.add_argument("--seeds", type=int, default=50, help="runs of each robot and motion")
    parser.add_argument("--jobs", type=int, default=2, help="processes")
    parser.add_argument("--keep", type=Path, help="file for every run; runs that are in it are not made again")
    asked = parser.parse_args()
    cases = [
        Case(robot, source, asked.end, tuple(asked.push), seed, asked.vary)
        for robot in asked.robots
        for source in asked.sources
        for seed in range(asked.seeds)
    ]
    found = run_cases(cases, run_case, Outcome, jobs=asked.jobs, keep=asked.keep)
    rows = []
    for robot in asked.robots:
        for source in asked.sources:
            own = [found[case] for case in cases if (case.robot, case.source) == (robot, source)]
            rows.append(row(f"{robot}, {Path(source).stem}", [one for ends in own for one in ends]))
    print(f"asked: {ASKED:.0%} of the falls {ASKED_S:g} s before the robot lands, none where it stands")
    heads = ["robot, motion", "runs", "falls", f"{ASKED_S:g} s early", "least, s", "median, s"]
    print_table([*heads, "false", "most tilt standing, degrees", "seeds"], rows, text=1)


if __name__ == "__main__":
    main()
