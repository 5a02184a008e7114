"""What obstacles cost: our frame with 1, 2, 4, ... 64 of them around the arms, half of them within influence."""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import product
from pathlib import Path

import numpy as np

from benchmarks.measure import WARM_UP, play
from benchmarks.motion import crouch_and_reach
from benchmarks.observed_body import Watched, scene_distances, watched_human, watched_op3
from benchmarks.observed_obstacles import around_arms, influence
from benchmarks.observed_ours import Activation, observed
from retarget.report.plot_style import LEFT, RIGHT, SERVOS, new_figure, plain, save_figure

COUNTS = (1, 2, 4, 8, 16, 32, 64)
FRAMES = 360
SWAY = 0.1
"""Share of the motion that is kept, so that obstacles stay within influence or beyond it."""
ASKED_GROWTH = 4.0
"""What 64 obstacles may cost, in costs of one."""


@dataclass(frozen=True)
class ObstacleCost:
    """Median thread CPU of a frame, us, for each of COUNTS; near: pairs within influence, mean over frames."""

    body: str
    worn: str
    activation: Activation
    counts: tuple[int, ...]
    median_us: tuple[float, ...]
    near: tuple[float, ...]

    @property
    def growth(self) -> float:
        """Of the most obstacles over that of one."""
        return self.median_us[-1] / self.median_us[0]


def obstacle_costs(*, frames: int = FRAMES, repeats: int = 1, counts: tuple[int, ...] = COUNTS) -> list[ObstacleCost]:
    """Human with lines and with capsules, and OP3, each with both ways to act."""
    bodies = (watched_human("lines_and_head"), watched_human("capsules"), watched_op3())
    ways: tuple[Activation, ...] = ("closest", "all")
    return [
        obstacle_cost(watched, way, frames=frames, repeats=repeats, counts=counts)
        for watched, way in product(bodies, ways)
    ]


def obstacle_cost(
    watched: Watched, activation: Activation, *, frames: int, repeats: int, counts: tuple[int, ...]
) -> ObstacleCost:
    """The counts take turns frame by frame."""
    calm = replace(watched.body, swing={name: SWAY * angle for name, angle in watched.body.swing.items()})
    motion = crouch_and_reach(calm, frames)
    free = play(calm, motion, [observed("free", watched, None)])[2][0]
    around = around_arms(watched, free, max(counts))
    sides = [observed(f"{count}", watched, activation, around.leading(count)) for count in counts]
    medians = []
    for _ in range(repeats):
        _, spent, postures = play(calm, motion, sides)
        medians.append(np.median(spent[WARM_UP:], axis=0) / 1e3)
    zone = np.maximum(watched.observers.influence, influence(watched))[:, None]
    near = [
        float((scene_distances(watched, q, around.leading(count)) <= zone).sum(axis=(1, 2)).mean())
        for count, q in zip(counts, postures, strict=True)
    ]
    us = np.median(medians, axis=0)
    return ObstacleCost(calm.name, watched.worn, activation, counts, tuple(us.tolist()), tuple(near))


def plot_costs(costs: list[ObstacleCost], path: Path) -> None:
    """A picture of the table: a colour for each body, full lines where all act, dashed where the closest does."""
    figure = new_figure(7.0, 4.0, "A frame of five iterations with obstacles around the arms, half within influence")
    axes = figure.subplots()
    colours = dict(zip(dict.fromkeys((cost.body, cost.worn) for cost in costs), (RIGHT, LEFT, SERVOS), strict=False))
    for cost in costs:
        axes.plot(
            cost.counts,
            cost.median_us,
            marker="o",
            markersize=3,
            color=colours[cost.body, cost.worn],
            linestyle="-" if cost.activation == "all" else "--",
            label=f"{cost.body}, {cost.worn}, {cost.activation}",
        )
    axes.set_xscale("log", base=2)
    axes.set_xticks(costs[0].counts, [str(count) for count in costs[0].counts])
    axes.set_yscale("log")
    axes.set_xlabel("obstacles")
    axes.set_ylabel("median thread CPU, us")
    axes.legend(fontsize=8, frameon=False)
    plain(axes)
    save_figure(figure, path)
