"""Balance, as it is seen on the floor: centre of mass, zero-moment point, centre of pressure and support polygon."""

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
"""What keeps of a position (3,) its place on the floor, and the unit vector upwards."""
