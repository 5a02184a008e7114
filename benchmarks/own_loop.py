"""`python -m benchmarks.own_loop`: thread CPU of `retarget.Pipeline.step`: OP3 follows five sensors of the sample."""

import argparse

import numpy as np

from hardware.clock import thread_cpu
from retarget.pipeline import Pipeline
from retarget.sources.open import open_source
from retarget.types import RunState

LONGEST_APPROACH = 2000
"""Ticks."""


def measure(seconds: float, priorities: str | None) -> list[float]:
    """ms of each step, from the moment at which the robot follows at full speed."""
    pipeline = Pipeline("op3", performer="five", priorities=priorities)
    frames, dt = open_source("sample"), pipeline.dt
    pipeline.start(frames.sample(0.0))
    followed = 0
    for _ in range(LONGEST_APPROACH):
        pipeline.step(frames.sample(0.0), dt)
        followed += pipeline.state is RunState.FOLLOW
        if followed * dt > 2.0:
            break
    spent = []
    for sample in [frames.sample(tick * dt) for tick in range(round(seconds / dt))]:
        begun = thread_cpu()
        pipeline.step(sample, dt)
        spent.append(1e3 * (thread_cpu() - begun))
    return spent


def main() -> None:
    """Measure, and print a line for each priority file."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=5.0, help="of following")
    seconds = parser.parse_args().seconds
    for name in ("servo", "balanced"):
        spent = measure(seconds, name)
        median, late = np.median(spent), np.percentile(spent, 99)
        print(f"Pipeline.step, op3, {name}: {median:.3f} ms thread CPU in the median, {late:.3f} ms at p99")


if __name__ == "__main__":
    main()
