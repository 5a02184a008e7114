"""What one tick of `retarget run` computes: from a sensor sample to a robot posture, Python and solver together."""

from __future__ import annotations

import gc
import time
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from unittest import mock

import numpy as np

from benchmarks.bodies import Floats
from retarget import _solver
from retarget.human.calibration import calibrate
from retarget.human.reconstruction import Reconstructor
from retarget.human.samples import Playback, lay_on_ticks
from retarget.ik import whole_body_stop
from retarget.model.human import build_human
from retarget.model.robot import load_robot
from retarget.robot.follower import Follower
from retarget.schema.performer import load_performer
from retarget.schema.priorities import load_priorities
from retarget.sources.open import open_source

STAGES = ("human", "robot", "both")
WARM_UP = 20
"""Ticks that are not timed."""


@dataclass(frozen=True)
class FrameCost:
    """Thread CPU per tick, us: of a stage, and of its calls of the solver alone (measured in a run of their own)."""

    stage: str
    median_us: float
    p99_us: float
    solver_median_us: float
    solver_p99_us: float


class TimedSolver:
    """A solver that counts what its frames and clips cost, all of them together."""

    spent_ns = 0

    def __init__(self, *arguments: Any, **named: Any) -> None:
        self._solver = REAL(*arguments, **named)

    def __getattr__(self, name: str) -> Any:
        return getattr(self._solver, name)

    def frame(self, targets: Floats, dt: float) -> Floats:
        """See `_solver.Solver`."""
        return self._counted(self._solver.frame, targets, dt)

    def clip(self, targets: Floats, dt: float) -> Floats:
        """See `_solver.Solver`."""
        return self._counted(self._solver.clip, targets, dt)

    def _counted(self, solve: Any, targets: Floats, dt: float) -> Floats:
        before = time.thread_time_ns()
        q: Floats = solve(targets, dt)
        TimedSolver.spent_ns += time.thread_time_ns() - before
        return q


REAL = _solver.Solver


def real_frame(path: Path, *, robot: str = "op3", repeats: int = 1, end: float | None = None) -> list[FrameCost]:
    """Both stages on a recording (up to `end` s), five sensors, at the robot's rate: medians over the repeats."""
    plain, timed = [], []
    for _ in range(repeats):
        plain.append(_play(path, robot, end)[0])
        timed.append(timed_play(path, robot=robot, end=end)[1])
    return [
        FrameCost(stage, *_percentiles([run[:, k] for run in plain]), *_percentiles([run[:, k] for run in timed]))
        for k, stage in enumerate(STAGES)
    ]


def timed_play(path: Path, *, robot: str = "op3", end: float | None = None) -> tuple[Floats, Floats]:
    """Thread CPU (T, 3) ns of human, robot and both, of one play: whole frames, and their solvers."""
    with ExitStack() as stack:
        stack.enter_context(mock.patch.object(_solver, "Solver", TimedSolver))
        stack.enter_context(mock.patch.object(whole_body_stop, "Solver", TimedSolver))
        return _play(path, robot, end)


def _play(path: Path, name: str, end: float | None) -> tuple[Floats, Floats]:
    """Thread CPU (T, 3) ns of human, robot and both, whole and in timed solvers."""
    robot, performer, frames = load_robot(name), load_performer("five"), open_source(path)
    rate = robot.profile.safety.rate_hz
    clip = lay_on_ticks(frames, performer=performer, playback=Playback(end=end), rate_hz=rate)
    human = build_human(calibrate(frames))
    reconstructor = Reconstructor(human, load_priorities(robot.profile.reconstruct), performer)
    follower = Follower(robot, load_priorities(robot.profile.retarget), human.dimensions)
    posture = reconstructor.start(clip.sample(0))
    follower.start(posture)
    whole, solver = np.zeros((len(clip), 3)), np.zeros((len(clip), 3))
    gc.collect()
    gc.disable()
    for tick in range(1, len(clip)):
        sample = clip.sample(tick)
        begun = time.thread_time_ns(), TimedSolver.spent_ns
        posture = reconstructor.step(sample, clip.motion_dt)
        between = time.thread_time_ns(), TimedSolver.spent_ns
        follower.step(posture, clip.dt)
        done = time.thread_time_ns(), TimedSolver.spent_ns
        for table, a, b, c in zip((whole, solver), begun, between, done, strict=True):
            table[tick] = b - a, c - b, c - a
    gc.enable()
    return whole[WARM_UP:], solver[WARM_UP:]


def _percentiles(runs: list[Floats]) -> tuple[float, float]:
    """Median and 99th percentile, us: of each run, then the median over the runs."""
    median, p99 = np.median([np.percentile(run, [50, 99]) for run in runs], axis=0) / 1e3
    return float(median), float(p99)
