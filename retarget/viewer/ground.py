"""Balance, as it is seen on the floor: centre of mass, zero-moment point, centre of pressure and support polygon."""

from collections import deque
from typing import TYPE_CHECKING

import numpy as np

from retarget.ik.support_polygon import convex_hull, plant, support_distance, support_edges
from retarget.model.robot import RobotBody
from retarget.types import FloatArray
from retarget.viewer.colours import BALANCE, OUTSIDE, PRESSURE, SOLES, ZMP
from retarget.viewer.figures import HERE, Movable
from retarget.viewer.snapshot import Snapshot

if TYPE_CHECKING:
    import viser


LINE_M = 0.003
"""Width of the line round the support polygon, and its height over the floor."""
EDGE_M = 0.0005
"""A point on the edge is not outside."""
BALL, DISC, POINT = 0.023, 0.029, 0.022
"""Radii, as shares of the robot's height."""


class Soles:
    """The support polygon: the hull of the soles in the posture of the goals. edges (e, 3): see `support_edges`, or
    None."""

    def __init__(self, scene: "viser.SceneApi", robot: RobotBody) -> None:
        soles = plant(robot, robot.profile.postures.stand).soles
        self._body = robot.body.solver_body()
        self._links = [sole.frame.body for sole in soles for _ in sole.corners]
        self._corners = np.concatenate([sole.corners for sole in soles])
        self._hull = np.zeros((0, 2))
        self.edges: FloatArray | None = None
        self._lines = scene.add_line_segments(
            "/soles", np.zeros((1, 2, 3), dtype=np.float32), np.array(SOLES, dtype=np.uint8), thickness=LINE_M
        )

    def show(self, snapshot: Snapshot) -> None:
        """Draw it anew where it has changed."""
        points = self._body.points(np.ascontiguousarray(snapshot.goal)[None], self._links, self._corners)[0]
        hull = convex_hull(points[:, :2])
        if hull.shape == self._hull.shape and np.abs(hull - self._hull).max() < 1e-4:
            return
        self._hull, self.edges = hull, support_edges([hull])
        corners = np.column_stack([hull, np.full(len(hull), LINE_M)])
        self._lines.points = np.stack([corners, np.roll(corners, -1, axis=0)], axis=1).astype(np.float32)

    def see(self, *, visible: bool) -> None:
        """Show or hide it."""
        self._lines.visible = visible


FLAT, UP = np.array([1.0, 1.0, 0.0]), np.array([0.0, 0.0, 1.0])


class Balance:
    """Centre of mass with the point below it, and the zero-moment point: of another colour outside of `soles`."""

    def __init__(self, scene: "viser.SceneApi", *, height: float, soles: Soles | None) -> None:
        self._soles = soles
        self._centre = Movable(scene.add_icosphere("/balance/centre", BALL * height, color=BALANCE))
        self._below = Movable(scene.add_cylinder("/balance/below", DISC * height, 0.002, color=BALANCE))
        self._disc = scene.add_cylinder("/balance/zmp", POINT * height, 0.004, color=ZMP, visible=False)
        self._zmp, self._outside = Movable(self._disc), False
        self.at = HERE
        """Where the world of the body is in the scene."""

    def show(self, snapshot: Snapshot) -> None:
        """Move it."""
        com, zmp = self.at.of(snapshot.com), np.full(2, np.nan) if snapshot.zmp is None else snapshot.zmp
        self._centre.put(com)
        self._below.put(com * FLAT + 0.001 * UP)
        self._zmp.put(self.at.of(np.append(zmp, 0.0)) * FLAT + 0.002 * UP)
        edges = None if self._soles is None else self._soles.edges
        outside = edges is not None and float(support_distance(zmp[None], edges)[0]) < -EDGE_M
        if outside != self._outside:
            self._outside = outside
            self._disc.color = OUTSIDE if outside else ZMP

    def see(self, *, visible: bool) -> None:
        """Show or hide it."""
        for node in (self._centre, self._below, self._zmp):
            node.see(visible=visible)


class Pressure:
    """The centre of pressure of the soles of a simulated robot; hidden where no sole carries."""

    def __init__(self, scene: "viser.SceneApi", *, height: float) -> None:
        self._disc = Movable(
            scene.add_cylinder("/pressure", 0.6 * POINT * height, 0.006, color=PRESSURE, visible=False)
        )

    def show(self, snapshot: Snapshot) -> None:
        """Move it."""
        self._disc.put(np.full(3, np.nan) if snapshot.pressure is None else np.append(snapshot.pressure, 0.003))

    def see(self, *, visible: bool) -> None:
        """Show or hide it."""
        self._disc.see(visible=visible)


# The zero-moment point of a motion that is looked at: where the floor would have to push.

GRAVITY = 9.81  # [m/s^2]
SPACING_S = 0.04
"""Between the three looks at the centre of mass of which its acceleration is made: a mean over twice that."""
LONGEST_S = 0.2
"""Looks that are farther apart give no acceleration."""


def zero_moment_point(times: FloatArray, com: FloatArray) -> FloatArray:
    """Where it was, (2,) m on the floor, at the second of three times (3,) s, of a centre of mass at com (3, 3) m.

    As in `standing_balance`, with all mass in one point: p = c - z / (g + z'') c''. NaN where times are not apart, or
    too far, and where it falls freely.
    """
    before, after = np.diff(times)
    if not (0.0 < before <= LONGEST_S and 0.0 < after <= LONGEST_S):
        return np.full(2, np.nan)
    change = (com[2] - com[1]) / after - (com[1] - com[0]) / before
    acceleration = 2.0 * change / (before + after)
    weight = GRAVITY + acceleration[2]
    if weight <= 0.0:
        return np.full(2, np.nan)
    point: FloatArray = com[1, :2] - com[1, 2] / weight * acceleration[:2]
    return point


def rows_around(times: FloatArray, row: int) -> tuple[int, int, int]:
    """The row of times (T,) s, with one about SPACING_S before and one as long after it; NaN comes of those that are
    not there."""
    before, after = np.searchsorted(times, times[row] + np.array([-SPACING_S, SPACING_S]) - 1e-6)
    last = len(times) - 1
    return max(min(int(before), row - 1), 0), row, min(max(int(after), row + 1), last)


class MassMotion:
    """Looks at a centre of mass that moves."""

    def __init__(self) -> None:
        self._seen: deque[tuple[float, FloatArray]] = deque(maxlen=3)

    def look(self, time: float, com: FloatArray) -> FloatArray:
        """The centre of mass com (3,) m at a time, s. Returns the zero-moment point (2,) m of one look before."""
        if not self._seen or time > self._seen[-1][0]:
            self._seen.append((time, com))
        if len(self._seen) < 3:
            return np.full(2, np.nan)
        times, places = zip(*self._seen, strict=True)
        return zero_moment_point(np.array(times), np.array(places))
