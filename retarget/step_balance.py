"""Where capture point and zero-moment point of a stepping robot are to be: over both feet, over one, or on the way.

As in `standing_balance`, each region is a share of what carries, about its middle. From one region to another its
mass goes through their hull, while both soles carry. A region only ever grows, or shrinks to one that holds both points
already: so no change of it asks for a leap.
"""

from collections.abc import Sequence

import numpy as np

from retarget.priorities import CentreOfMassTask, Priorities
from retarget.rotations import FloatArray
from retarget.stance import Stance
from retarget.standing_balance import GRAVITY, Edges, moving_spaces, shrunk
from retarget.support import convex_hull, support_edges
from retarget.task_slots import SUPPORT_EDGES

__all__ = ["StepBalance", "balance_in_motion"]

WELL_INSIDE = 0.8
"""Share of the region of standing to which a mass comes back. What is to push it farther in has to be behind it, and
would leave the region where it stood at its edge."""
WIDER = 1.4
"""Share of the regions that a shift of weight goes through: who stood at the edge of one gets away from there."""
PRESSED = 0.5
"""Share of what carries in which the zero-moment point is on such a way, more than its capture point: who has come to
its edge could be pushed away from there no more."""
MOST_CORNERS = SUPPORT_EDGES // 2
"""Each edge makes two half-spaces."""


def balance_in_motion(priorities: Priorities) -> float | None:
    """The share of the support in which priorities keep a mass in motion; None: they look at it as if at rest."""
    tasks = [task for _, _, task in priorities.tasks() if isinstance(task, CentreOfMassTask)]
    return min((task.moving for task in tasks if task.moving is not None), default=None)


class StepBalance:
    """Regions of one stance on two soles. both, on_the_way: of standing, and of every shift of weight; over: of
    standing on the left sole, and on the right one; room: around the middle of these, m. middles: of the soles, (2,) m:
    both, left, right."""

    def __init__(self, stance: Stance, share: float) -> None:
        """share: of what carries, about its middle."""
        outlines = [sole.outline for sole in stance.soles]
        polygons = [convex_hull(np.concatenate(outlines)), *(convex_hull(outline) for outline in outlines)]
        self.middles = (np.concatenate(outlines).mean(axis=0), *(outline.mean(axis=0) for outline in outlines))
        self.both: Edges = shrunk(stance.edges(0.0), share, stance).tolist()
        self._well_inside: Edges = shrunk(stance.edges(0.0), WELL_INSIDE * share, stance).tolist()
        self.over: tuple[Edges, ...] = tuple(
            support_edges([about(polygon, middle, share)]).tolist()
            for polygon, middle in zip(polygons[1:], self.middles[1:], strict=True)
        )
        wider = min(WIDER * share, 1.0)
        self.on_the_way, self._pressed = (
            _around(polygons, self.middles, size) for size in (wider, max(wider, PRESSED))
        )
        still = np.zeros(3)
        self.room = min(
            self.depth(region, np.array([*middle, 0.0]), still, still)
            for region, middle in zip(self.over, self.middles[1:], strict=True)
        )
        self._outlines: tuple[Edges, ...] = tuple(
            support_edges([outline]).tolist() for outline in (np.concatenate(outlines), *outlines)
        )

    def spaces(self, region: Edges, com: FloatArray, velocity: FloatArray, dt: float) -> FloatArray:
        """Half-spaces (k, 4) for a centre of mass after the next `dt` s, now at com (3,) m, moving at velocity (3,)
        m/s."""
        spaces = moving_spaces(region, com, velocity, dt, pressed=self._pressed if region is self.on_the_way else None)
        if region is self.both:
            return spaces
        # Where its height changes evenly. Else who may not go aside fast enough would throw up its arms for it.
        spaces[:, 3] -= spaces[:, 2] * float(com[2] + velocity[2] * dt)
        spaces[:, 2] = 0.0
        return spaces

    def pressed(self, region: Edges) -> Edges:
        """Where the zero-moment point may be of a mass that is to be in a region."""
        return self._pressed if region is self.on_the_way else region

    def depth(self, region: Edges, com: FloatArray, velocity: FloatArray, acceleration: FloatArray) -> float:
        """How far (m) inside a region both points are, of a mass at (3,) m, with (3,) m/s and (3,) m/s^2."""
        height = float(com[2])
        capture = com + velocity * (height / GRAVITY) ** 0.5
        pressed = com - acceleration * (height / max(GRAVITY + float(acceleration[2]), 0.1 * GRAVITY))
        return min(_inside(region, capture), _inside(region, pressed))

    def place(self, asked: FloatArray) -> FloatArray:
        """The place (2,) m well inside the region of standing that is nearest to the one asked (2,) m, on the line to
        the middle."""
        middle = self.middles[0]
        share = 1.0
        for nx, ny, offset in self._well_inside:
            room = offset - nx * float(middle[0]) - ny * float(middle[1])
            out = nx * float(asked[0] - middle[0]) + ny * float(asked[1] - middle[1])
            if out > room:
                share = min(share, room / out)
        return np.asarray(middle + share * (asked - middle))

    def inside(self, com: FloatArray, feet: tuple[bool, bool]) -> float:
        """How far (m) a centre of mass (3,) is inside the outline of the soles that carry: left, right."""
        return _inside(self._outlines[0 if all(feet) else 2 - int(feet[0])], com)


def _around(polygons: Sequence[FloatArray], middles: Sequence[FloatArray], share: float) -> Edges:
    """Edges of the hull of polygons (c, 2), each at a share of its size about its middle (2,)."""
    corners = [about(polygon, middle, share) for polygon, middle in zip(polygons, middles, strict=True)]
    edges: Edges = support_edges([at_most(convex_hull(np.concatenate(corners)), MOST_CORNERS)]).tolist()
    return edges


def about(corners: FloatArray, middle: FloatArray, share: float) -> FloatArray:
    """Corners (c, 2) of a polygon at a share of its size about a point (2,)."""
    return np.asarray(middle + share * (corners - middle))


def at_most(corners: FloatArray, count: int) -> FloatArray:
    """A convex polygon (c, 2) without the corners that matter least to its area: never larger."""
    while len(corners) > count:
        before, after = np.roll(corners, 1, axis=0) - corners, np.roll(corners, -1, axis=0) - corners
        area = np.abs(before[:, 0] * after[:, 1] - before[:, 1] * after[:, 0])
        corners = np.delete(corners, int(np.argmin(area)), axis=0)
    return corners


def _inside(region: Edges, point: FloatArray) -> float:
    x, y, _ = point.tolist()
    return float(min(offset - nx * x - ny * y for nx, ny, offset in region))
