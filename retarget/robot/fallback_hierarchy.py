"""What a robot on its soles does where what it thought of first is not safe: soles before all else, then arms alone.

Where limbs meet, what parts them comes before soles, and may ask for more than legs can do without moving them. Then
the same targets are gone for with the level of the soles first: what is not parted so is for the gate to keep. And
where legs may not move at all, what they carry goes on. Else a robot whose limbs meet could stand for ever.

And who stands because a goal was refused thinks once of parting limbs before all else: what soles, balance or strength
ask for first, and cannot have at once, may be just what brings limbs together, tick after tick.
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

__all__ = ["FallbackHierarchy", "separated_first", "soles_first"]

Build = Callable[[Priorities, BoolArray], Hierarchy]
"""From priorities and who is locked (nv,) to a hierarchy."""


class FallbackHierarchy:
    """Three more hierarchies for the targets of a first one. around: obstacles where they are now, as it sees them.
    parts: the next first thought is that of limbs that are to be parted."""

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
        self._parted, self._parted_from = in_order(separated_first(priorities.levels, soles))
        self._above = build(priorities, carrying)
        self.around: ObstaclePoses | None = None
        self.parts = False

    def first(self, targets: FloatArray, q: FloatArray, dt: float) -> FloatArray:
        """The posture (nq,) thought of first, `dt` s after q (nq,); where the first hierarchy is from then on."""
        solver = self._first.solver
        if not self.parts:
            return solver.frame(targets, dt)
        self.parts = False
        there, velocity = self._thought(self._parted, targets[self._parted_from], q, solver.velocity, dt)
        solver.reset(there, velocity)
        return there

    def after(
        self, targets: FloatArray, q: FloatArray, velocity: FloatArray, dt: float, *, stands: bool
    ) -> Iterator[tuple[FloatArray, FloatArray]]:
        """Postures (nq,) with velocities (nv,) per s, one after the other till one is taken, `dt` s after q (nq,).

        targets: of the first hierarchy. velocity (nv,): at q. stands: whether the legs do.
        """
        yield self._thought(self._planted, targets[self._from], q, velocity, dt)
        if stands:
            yield self._thought(self._above, targets, q, velocity, dt)

    def _thought(
        self, hierarchy: Hierarchy, targets: FloatArray, q: FloatArray, velocity: FloatArray, dt: float
    ) -> tuple[FloatArray, FloatArray]:
        if self.around is not None:
            hierarchy.set_obstacles(self.around)
        hierarchy.solver.reset(q, velocity)
        return hierarchy.solver.frame(targets, dt), hierarchy.solver.velocity


def soles_first(levels: tuple[Level, ...], soles: frozenset[str]) -> list[int]:
    """Numbers of the levels, those that plant a sole first."""
    return sorted(range(len(levels)), key=lambda k: not _plants(levels[k], soles))


def separated_first(levels: tuple[Level, ...], soles: frozenset[str]) -> list[int]:
    """Numbers of the levels, those that keep limbs and obstacles off each other first, then those that plant a sole."""

    def rank(k: int) -> int:
        parts = any(isinstance(task, ReactiveTask | PreventiveTask) for task in levels[k].tasks)
        return 0 if parts else 1 if _plants(levels[k], soles) else 2

    return sorted(range(len(levels)), key=rank)


def _plants(level: Level, soles: frozenset[str]) -> bool:
    return any(isinstance(task, PositionTask | OrientationTask) and soles & set(task.of) for task in level.tasks)
