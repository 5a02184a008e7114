"""The stance of a robot: soles on the ground, their support polygon, and a centre of mass inside it.

An edge is a half-plane (nx, ny, d): the unit normal points outward and nx x + ny y <= d holds inside. Coordinates are
metres on the ground, world frame.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from retarget import rotations
from retarget._solver import Body as SolverBody
from retarget._solver import Footing
from retarget.arithmetic import arctan2, hypot, matmul
from retarget.errors import ConfigError
from retarget.model.body import Frame
from retarget.model.robot import RobotBody
from retarget.types import MM, FloatArray

SHORTEST_EDGE = 1e-6  # [m] nearer corners are one


def sole_outline(position: FloatArray, orientation: FloatArray, polygon: FloatArray) -> FloatArray:
    """Corners (c, 2) m on the ground of a sole at (3,) m, (4,) wxyz, with an outline `polygon` (c, 2) m."""
    corners = np.column_stack([polygon, np.zeros(len(polygon))])
    return np.asarray((position + rotations.rotate(orientation, corners))[:, :2])


def convex_hull(points: FloatArray) -> FloatArray:
    """Corners (h, 2) of the convex hull of points (n, 2), counter-clockwise (Andrew's monotone chain)."""
    ordered = [(float(x), float(y)) for x, y in points[np.lexsort((points[:, 1], points[:, 0]))]]
    chains = [_chain(ordered), _chain(ordered[::-1])]
    return np.array([corner for chain in chains for corner in chain[:-1]])


def support_edges(outlines: Sequence[FloatArray], *, margin: float = 0.0) -> FloatArray:
    """Edges (e, 3) of the convex hull of all `outlines` (c, 2), moved inward by `margin` m where there is room."""
    corners = convex_hull(np.concatenate(outlines))
    along = np.roll(corners, -1, axis=0) - corners
    length = hypot(along[:, 0], along[:, 1])
    long = length > SHORTEST_EDGE
    along, corners = along[long] / length[long, None], corners[long]
    normal = np.column_stack([along[:, 1], -along[:, 0]])
    offset = (normal * corners).sum(axis=1)
    # A margin beyond the middle would turn the polygon inside out.
    room = float((offset - matmul(normal, corners.mean(axis=0))).min())
    return np.column_stack([normal, offset - min(margin, 0.9 * room)])


def half_spaces(edges: FloatArray) -> FloatArray:
    """Edges (e, 3) as half-spaces (e, 4) of any height: nx, ny, 0, d with n . p <= d, m."""
    return np.insert(edges, 2, 0.0, axis=1)


def support_distance(points: FloatArray, edges: FloatArray) -> FloatArray:
    """Distance (...) m of points (..., 2 or 3) inside the edges (e, 3); negative outside."""
    return np.asarray((edges[:, 2] - matmul(points[..., :2], edges[:, :2].T)).min(axis=-1))


def _chain(ordered: Sequence[tuple[float, float]]) -> list[tuple[float, float]]:
    chain: list[tuple[float, float]] = []
    for x, y in ordered:
        while len(chain) > 1:
            (ax, ay), (bx, by) = chain[-2:]
            if (bx - ax) * (y - ay) - (by - ay) * (x - ax) > 0.0:
                break
            chain.pop()
        chain.append((x, y))
    return chain


@dataclass(frozen=True, eq=False)
class Sole:
    """A sole planted on the ground.

    position (3,) m, orientation (4,) wxyz: of its frame, flat on the ground, world. outline (c, 2) m: corners on the
    ground, world. corners (c, 3) m: in the frame of the link.
    """

    frame: Frame
    position: FloatArray
    orientation: FloatArray
    outline: FloatArray
    corners: FloatArray


@dataclass(frozen=True, eq=False)
class Stance:
    """A robot on its soles, the origin between them, x forward. soles: none for a robot that does not stand.

    q (nq,): posture with the root. points: world position (3,) m of each frame of the profile.
    """

    q: FloatArray
    points: dict[str, FloatArray]
    soles: tuple[Sole, ...]

    def edges(self, margin: float) -> FloatArray:
        """Edges (e, 3) of the support polygon, `margin` m inside the hull of the soles."""
        return support_edges([sole.outline for sole in self.soles], margin=margin)


def plant(robot: RobotBody, angles: dict[str, float]) -> Stance:
    """Stand with these joint angles, rad (0 elsewhere), on soles taken as flat and level.

    A robot on a stand keeps the root of its body file.
    """
    q = robot.posture(angles)
    feet = robot.profile.feet if robot.on_floor else {}
    frames = tuple(foot.frame for foot in feet.values())
    if frames:
        # The mean normal of the soles becomes the vertical, their mean direction x, their middle the origin.
        positions, orientations = robot.points(q[None], frames)[0], robot.orientations(q[None], frames)[0]
        vertical, ahead = np.array([0.0, 0.0, 1.0]), np.array([1.0, 0.0, 0.0])
        level = rotations.shortest_arc(rotations.rotate(orientations, vertical).mean(axis=0), vertical)
        forward = rotations.rotate(rotations.multiply(level, orientations), ahead).mean(axis=0)
        turn = rotations.from_axis_angle(vertical, -arctan2(forward[1], forward[0]))
        upright = rotations.multiply(turn, level)
        q[:3] = rotations.rotate(upright, q[:3] - positions.mean(axis=0))
        q[3:7] = rotations.normalise(rotations.multiply(upright, q[3:7]))
    names = tuple(robot.profile.frames)
    points = dict(zip(names, robot.points(q[None], names)[0], strict=True))
    soles = []
    if not robot.stands:
        return Stance(q, points, ())
    for foot, orientation in zip(feet.values(), robot.orientations(q[None], frames)[0], strict=True):
        place = points[foot.frame] * np.array([1.0, 1.0, 0.0])
        forward = rotations.rotate(orientation, np.array([1.0, 0.0, 0.0]))
        flat = rotations.from_axis_angle(np.array([0.0, 0.0, 1.0]), arctan2(forward[1], forward[0]))
        frame, polygon = robot.frame(foot.frame), np.array(foot.polygon)
        corners = frame.position + rotations.rotate(frame.quat, np.column_stack([polygon, np.zeros(len(polygon))]))
        soles.append(Sole(frame, place, flat, sole_outline(place, flat, polygon), corners))
    return Stance(q, points, tuple(soles))


def footing(body: SolverBody, soles: Sequence[Sole]) -> Footing:
    """The measure of how far soles are off their places, and the centre of mass inside their outline."""
    # Corners that are farthest along the diagonals are enough to see a sole move or tilt.
    spread = []
    for sole in soles:
        x, y = sole.outline[:, 0], sole.outline[:, 1]
        spread.append((sole, sorted({int(np.argmax(x * i + y * j)) for i in (-1, 1) for j in (-1, 1)})))
    links = [sole.frame.body for sole, few in spread for _ in few]
    local = np.concatenate([sole.corners[few] for sole, few in spread])
    planted = np.concatenate([sole.outline[few] for sole, few in spread])
    edges = support_edges([sole.outline for sole in soles])
    return Footing(body, links, local, np.insert(planted, 2, 0.0, axis=1), edges)


def check_stand(robot: RobotBody) -> float | None:
    """Distance, m, of the centre of mass inside the edge of the soles; None without soles. Raises ConfigError if
    outside."""
    if not robot.stands or not robot.body.mass.sum() > 0.0:
        return None
    stance = plant(robot, robot.profile.postures.stand)
    com = robot.body.solver_body().centre_of_mass(stance.q[None])[0]
    margin = float(support_distance(com, stance.edges(0.0)))
    if margin <= 0.0:
        polygon = convex_hull(np.concatenate([sole.outline for sole in stance.soles]))
        raise ConfigError(
            "the robot would fall over in posture stand",
            where=f"{robot.profile.path}: postures.stand",
            found=f"centre of mass at {_point(com)}, {-MM * margin:.1f} mm outside the soles",
            allowed="inside " + ", ".join(_point(corner) for corner in polygon),
            next_step="Lean the robot until it is inside (x forward, y left, mm, from the middle of the soles), or "
            "correct the masses of the body or the polygons of `feet`",
        )
    return margin


def _point(place: FloatArray) -> str:
    return f"({MM * place[0]:.0f}, {MM * place[1]:.0f})"
