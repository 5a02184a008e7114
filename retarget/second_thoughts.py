"""What a robot on its soles does where what it thought of first is not safe: soles before all else, then arms alone.

Where limbs meet, what parts them comes before soles, and may ask for more than legs can do without moving them. Then
the same targets are gone for with the level of the soles first: what is not parted so is for the gate to keep. And
where legs may not move at all, what they carry goes on. Else a robot whose limbs meet could stand for ever.
"""

from collections.abc import Callable, Iterator

import numpy as np

from retarget.body import IntArray
from retarget.frames import BoolArray
from retarget.hierarchy import Hierarchy
from retarget.priorities import Level, OrientationTask, PositionTask, Priorities
from retarget.rotations import FloatArray
from retarget.scene_motion import ObstaclePoses

__all__ = ["SecondThoughts", "soles_first"]

Build = Callable[[Priorities, BoolArray], Hierarchy]
"""From priorities and who is locked (nv,) to a hierarchy."""


class SecondThoughts:
    """Two more hierarchies for the targets of a first one. around: obstacles where they are now, as it sees them."""

    def __init__(
        self, build: Build, priorities: Priorities, first: Hierarchy, *, soles: frozenset[str], carrying: BoolArray
    ) -> None:
        """soles: names of their frames. carrying (nv,): root and legs."""
        order = soles_first(priorities.levels, soles)
        planted = priorities.model_copy(update={"levels": tuple(priorities.levels[k] for k in order)})
        self._planted = build(planted, np.zeros_like(carrying))
        self._above = build(priorities, carrying)
        every = np.arange(first.solver.target_size)
        self._from: IntArray = np.concatenate([every[first.target_span(k)] for k in order])
        self.around: ObstaclePoses | None = None

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

    def plants(level: Level) -> bool:
        return any(isinstance(task, PositionTask | OrientationTask) and soles & set(task.of) for task in level.tasks)

    return sorted(range(len(levels)), key=lambda k: not plants(levels[k]))
