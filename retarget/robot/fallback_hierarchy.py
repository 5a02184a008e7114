"""Fallback hierarchies of a robot on its soles, for a first posture that is not safe: soles first, then arms alone.

Where limbs meet, the tasks that separate them come before the soles, and may ask for more than legs can do with planted
soles. Then the same targets are solved with the level of the soles first; the gate keeps limbs apart that this does not
separate. Where legs may not move at all, the parts above them go on. Else a robot whose limbs meet could stand still
for ever.

A robot that stands still because a goal was refused is solved once with the separation of limbs before all else. What
soles, balance or strength ask for first, and cannot have at once, may be what brings limbs together, tick after tick.
"""

from collections.abc import Callable, Iterator

import numpy as np

from retarget.ik.hierarchy import Hierarchy
from retarget.model.scene_state import ObstaclePoses
from retarget.schema.priorities import (
    Level,
    OrientationTask,
    PositionTask,
    PreventiveTask,
    Priorities,
    ReactiveTask,
)
from retarget.types import BoolArray, FloatArray, IntArray

Build = Callable[[Priorities, BoolArray], Hierarchy]
"""From priorities and locked DoFs (nv,) to a hierarchy."""


class FallbackHierarchy:
    """Three more hierarchies for the targets of a first one. obstacles: where they are now, as the first has them.
    separate: whether the next call of `first` separates limbs before all else."""

    def __init__(
        self, build: Build, priorities: Priorities, first: Hierarchy, *, soles: frozenset[str], carrying: BoolArray
    ) -> None:
        """soles: names of their frames. carrying (nv,): root and legs."""
        every, self._first = np.arange(first.solver.target_size), first

        def in_order(order: list[int]) -> tuple[Hierarchy, IntArray]:
            levels = tuple(priorities.levels[k] for k in order)
            hierarchy = build(priorities.model_copy(update={"levels": levels}), np.zeros_like(carrying))
            return hierarchy, np.concatenate([every[first.target_span(k)] for k in order])

        self._planted, self._from = in_order(soles_first(priorities.levels, soles))
        self._separated, self._separated_from = in_order(separated_first(priorities.levels, soles))
        self._above = build(priorities, carrying)
        self.obstacles: ObstaclePoses | None = None
        self.separate = False

    def first(self, targets: FloatArray, q: FloatArray, dt: float) -> FloatArray:
        """The first posture (nq,) to try, `dt` s after q (nq,); the first hierarchy is there from then on."""
        solver = self._first.solver
        if not self.separate:
            return solver.frame(targets, dt)
        self.separate = False
        there, velocity = self._solve(self._separated, targets[self._separated_from], q, solver.velocity, dt)
        solver.reset(there, velocity)
        return there

    def after(
        self, targets: FloatArray, q: FloatArray, velocity: FloatArray, dt: float, *, stands: bool
    ) -> Iterator[tuple[FloatArray, FloatArray]]:
        """Postures (nq,) with velocities (nv,) per s to try one after the other, `dt` s after q (nq,).

        targets: of the first hierarchy. velocity (nv,): at q. stands: whether the legs stand still.
        """
        yield self._solve(self._planted, targets[self._from], q, velocity, dt)
        if stands:
            yield self._solve(self._above, targets, q, velocity, dt)

    def _solve(
        self, hierarchy: Hierarchy, targets: FloatArray, q: FloatArray, velocity: FloatArray, dt: float
    ) -> tuple[FloatArray, FloatArray]:
        if self.obstacles is not None:
            hierarchy.set_obstacles(self.obstacles)
        hierarchy.solver.reset(q, velocity)
        return hierarchy.solver.frame(targets, dt), hierarchy.solver.velocity


def soles_first(levels: tuple[Level, ...], soles: frozenset[str]) -> list[int]:
    """Indices of the levels, those that plant a sole first."""
    return sorted(range(len(levels)), key=lambda k: not _plants(levels[k], soles))


def separated_first(levels: tuple[Level, ...], soles: frozenset[str]) -> list[int]:
    """Indices of the levels: first those that keep limbs and obstacles apart, then those that plant a sole."""

    def rank(k: int) -> int:
        separates = any(isinstance(task, ReactiveTask | PreventiveTask) for task in levels[k].tasks)
        return 0 if separates else 1 if _plants(levels[k], soles) else 2

    return sorted(range(len(levels)), key=rank)


def _plants(level: Level, soles: frozenset[str]) -> bool:
    return any(isinstance(task, PositionTask | OrientationTask) and soles & set(task.of) for task in level.tasks)
