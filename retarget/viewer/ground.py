"""Balance, as it is seen on the floor: centre of mass, zero-moment point, centre of pressure and support polygon."""

from collections import deque
from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from retarget.ik.support_polygon import convex_hull, plant, support_distance, support_edges
from retarget.model.robot import RobotBody
from retarget.types import FloatArray
from retarget.viewer.colours import BALANCE, OUTSIDE, PRESSURE, SOLES, ZMP
from retarget.viewer.figures import Movable
from retarget.viewer.snapshot import Snapshot

if TYPE_CHECKING:
    import viser


LINE_M = 0.003
"""Width of the line round the support polygon, and its height over the floor."""
EDGE_M = 0.0005
"""A point on the edge is not outside."""
BALL, DISC, POINT = 0.023, 0.029, 0.022
"""Radii, as shares of the robot's height."""


class Balance:
    """Centre of mass with the point below it, and the zero-moment point, red outside of the support polygon: the hull
    of the soles of a robot that stands, in the posture of its goals. top, soles, pressure: nodes that show and hide
    them; soles is None for a body that does not stand."""

    def __init__(self, scene: "viser.SceneApi", robot: RobotBody | None, *, height: float) -> None:
        self.top = scene.add_frame("/balance", show_axes=False)
        self._centre = Movable(scene.add_icosphere("/balance/centre", BALL * height, color=BALANCE))
        self._below = Movable(scene.add_cylinder("/balance/below", DISC * height, 0.002, color=BALANCE))
        self.disc = scene.add_cylinder("/balance/zmp", POINT * height, 0.004, color=ZMP, visible=False)
        self._zmp = Movable(self.disc)
        self.pressure = scene.add_frame("/pressure", show_axes=False)
        disc = scene.add_cylinder("/pressure/disc", 0.6 * POINT * height, 0.006, color=PRESSURE, visible=False)
        self._pressure = Movable(disc)
        self.soles: viser.LineSegmentsHandle | None = None
        if robot is not None and robot.stands:
            soles = plant(robot, robot.profile.postures.stand).soles
            self._body = robot.body.solver_body()
            self._links = [sole.frame.body for sole in soles for _ in sole.corners]
            self._corners = np.concatenate([sole.corners for sole in soles])
            colour = np.array(SOLES, dtype=np.uint8)
            self.soles = scene.add_line_segments("/soles", np.zeros((1, 2, 3), np.float32), colour, thickness=LINE_M)

    def show(self, snapshot: Snapshot, place: Callable[[FloatArray], FloatArray]) -> None:
        """Move centre of mass and zero-moment point. place: from the world of the body to the scene."""
        zmp = np.full(2, np.nan) if snapshot.zmp is None else snapshot.zmp
        com, point = place(snapshot.com), place(np.append(zmp, 0.0))
        self._centre.move(com)
        self._below.move(com * FLAT + 0.001 * UP)
        self._zmp.move(point * FLAT + 0.002 * UP)
        if self.soles is not None:
            inside = float(support_distance(zmp[None], support_edges([self._hull(snapshot.goal)]))[0])
            self.disc.color = OUTSIDE if inside < -EDGE_M else ZMP

    def show_soles(self, snapshot: Snapshot) -> None:
        """Draw the support polygon."""
        assert self.soles is not None, "a robot that stands"
        hull = self._hull(snapshot.goal)
        corners = np.column_stack([hull, np.full(len(hull), LINE_M)]).round(4)
        self.soles.points = np.stack([corners, np.roll(corners, -1, axis=0)], axis=1).astype(np.float32)

    def show_pressure(self, snapshot: Snapshot) -> None:
        """Move the centre of pressure of a simulated robot; hidden where no sole carries."""
        self._pressure.move(np.full(3, np.nan) if snapshot.pressure is None else np.append(snapshot.pressure, 0.003))

    def _hull(self, goal: FloatArray) -> FloatArray:
        """Corners (c, 2) m of the support polygon in a posture (nq,)."""
        points = self._body.points(np.ascontiguousarray(goal)[None], self._links, self._corners)[0]
        return convex_hull(points[:, :2])


FLAT, UP = np.array([1.0, 1.0, 0.0]), np.array([0.0, 0.0, 1.0])


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
