"""Whole runs of a robot with mass, as `retarget run --bus physics` makes them, and what the measuring needs of them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from benchmarks.bodies import Floats
from hardware.bus import ServoBus
from hardware.clock import Clock, VirtualClock, thread_cpu
from hardware.guard_state import StopCause
from retarget.cli.buses import PhysicsBench
from retarget.cli.exit import StopRequest
from retarget.cli.operator import RunOperator
from retarget.frames import SensorFrames
from retarget.model.robot import RobotBody
from retarget.report.motion_metrics import physics_report
from retarget.run.options import RunOptions
from retarget.run.prepare import prepare
from retarget.run.run_result import RunResult


def timed(bus: ServoBus, spent: list[float]) -> ServoBus:
    """The bus, of which the thread CPU, s, of each read and write is added to `spent`."""
    for name in ("read", "write"):
        setattr(bus, name, _timed(getattr(bus, name), spent))
    return bus


def _timed(call: Callable[..., Any], spent: list[float]) -> Callable[..., Any]:
    def measured(*given: Any) -> Any:
        begun = thread_cpu()
        found = call(*given)
        spent.append(thread_cpu() - begun)
        return found

    return measured


@dataclass(frozen=True)
class PhysicsCost:
    """A run's thread CPU. ticks: of the bus; seconds: of the robot's time; cpu_s: of the whole loop, with arming and
    the move to rest, without loading. real_time: seconds over cpu_s. us per tick: of the whole, of the simulated
    mechanics with their bus, of the human's and of the robot's stage; rest: gate, guard, record. fallen: whether it
    fell."""

    motion: str
    speed: float
    ticks: int
    seconds: float
    cpu_s: float
    real_time: float
    tick_us: float
    physics_us: float
    human_us: float
    robot_us: float
    rest_us: float
    fallen: bool


@dataclass(frozen=True)
class Stood:
    """How a run under a perturbation ended. fallen_at: s on the time of the run, None: it stood. stopped: why the guard
    stopped it, if not for the fall. late: it fell after it had followed, on its way to rest, there, or where a stop
    left it without torque. margin_mm, slip_mm, tilt_deg: of the report."""

    perturbation: str
    seed: int
    fallen_at: float | None
    how: str
    late: bool
    stopped: str
    margin_mm: float | None
    slip_mm: float
    tilt_deg: float


def play(frames: SensorFrames, options: RunOptions) -> RunResult:
    """Run it on a virtual clock; a fall ends it. Raises RetargetError."""
    bench = PhysicsBench(options, lambda text: None)
    with prepare(
        lambda: frames, options, clock=VirtualClock(), make_bus=bench.make_bus, goes_to_rest=options.has_physics
    ) as prepared:
        run = prepared.run(RunOperator(prepared, StopRequest(), bench=bench))
    return bench.seen(run)


def cost_of_run(name: str, frames: SensorFrames, options: RunOptions) -> PhysicsCost:
    """Run it, and take its time. Raises RetargetError."""
    bench = PhysicsBench(options, lambda text: None)
    on_bus: list[float] = []

    def bus(robot: RobotBody, clock: Clock) -> ServoBus:
        return timed(bench.make_bus(robot, clock), on_bus)

    with prepare(
        lambda: frames, options, clock=VirtualClock(), make_bus=bus, goes_to_rest=options.has_physics
    ) as prepared:
        operator = RunOperator(prepared, StopRequest(), bench=bench)
        begun = thread_cpu()
        run = prepared.run(operator)
        cpu = thread_cpu() - begun
        spent = sum(on_bus)
    run = bench.seen(run)
    ticks, dt = len(run.record), run.clip.dt
    human, robot = _total(run.record.cost[:, 0]), _total(run.record.cost[:, 1])
    us = 1e6 / ticks
    return PhysicsCost(
        motion=name,
        speed=run.clip.speed,
        ticks=ticks,
        seconds=ticks * dt,
        cpu_s=cpu,
        real_time=ticks * dt / cpu,
        tick_us=us * cpu,
        physics_us=us * spent,
        human_us=us * human,
        robot_us=us * robot,
        rest_us=us * (cpu - spent - human - robot),
        fallen=run.physics is not None and run.physics.fall is not None,
    )


def stood(perturbation: str, seed: int, run: RunResult) -> Stood:
    """How a run ended."""
    report = physics_report(run)
    assert report is not None, "the robot has mass"
    following = run.record.time[run.record.following]
    last = float(following[-1]) if following.size else 0.0
    return Stood(
        perturbation=perturbation,
        seed=seed,
        fallen_at=report.fallen_at_s,
        how=report.how or "",
        late=report.fallen_at_s is not None and report.fallen_at_s > last,
        stopped="" if run.stop is None or run.stop.cause is StopCause.FALLEN else run.stop.reason,
        margin_mm=report.min_zmp_margin_mm,
        slip_mm=report.foot_slip_mm["total"],
        tilt_deg=report.sole_tilt_max_deg,
    )


def _total(seconds: Floats) -> float:
    return float(np.nansum(seconds))
