"""The smallest capsule around a set of balls.

    minimise   pi R^2 |b - a| + 4/3 pi R^3     over the segment a b and the radius R
    subject to |c_i - [a b]| + r_i <= R        for every ball (c_i, r_i)

The problem has several local minima: many axes are ranked by the best capsule along each, which has a closed form for
a given line and radius, and the best few are polished as smooth programs (SLSQP) of seven variables. The radius
is then taken exactly from the balls, so that enclosure never depends on the optimiser.
"""

from dataclasses import dataclass

import numpy as np
from scipy.optimize import minimize

from retarget.rotations import FloatArray

__all__ = ["Capsule", "distances_to_segment", "enclosing_capsule"]

MIN_RADIUS = 1e-4
"""[m] thinner geometry gets this radius."""
POLISHED = 4
LATTICE = 60
RADII = np.array([1.0, 1.02, 1.05, 1.1, 1.15, 1.22, 1.3, 1.45, 1.7, 2.0])  # of the smallest along a line
WORKING = 60
ROUNDS = 12


@dataclass(frozen=True, eq=False)
class Capsule:
    """start, end (3,) and radius, m. A ball where start equals end."""

    start: FloatArray
    end: FloatArray
    radius: float

    @property
    def length(self) -> float:
        """Length of the segment, m."""
        return float(np.linalg.norm(self.end - self.start))

    @property
    def volume(self) -> float:
        """m^3."""
        return float(np.pi * self.radius**2 * (self.length + 4.0 / 3.0 * self.radius))

    @property
    def is_ball(self) -> bool:
        """Whether the segment is a point."""
        return self.length == 0.0


def enclosing_capsule(centres: FloatArray, radii: FloatArray, *, axes: FloatArray | None = None) -> Capsule:
    """The smallest capsule around balls with centres (k, 3) and radii (k,), m, a ball where that is no larger.

    axes (j, 3): directions that are tried besides those of the balls' own spread.
    """
    middle = (centres.max(axis=0) + centres.min(axis=0)) / 2.0
    scale = float(np.max(np.linalg.norm(centres - middle, axis=1) + radii))
    if scale < MIN_RADIUS:
        return Capsule(middle, middle.copy(), MIN_RADIUS)
    points, sizes = (centres - middle) / scale, radii / scale
    starts = sorted((_along(u, points, sizes) for u in _directions(points, axes)), key=lambda found: found.volume)
    polished = [_polish(start, points, sizes) for start in starts[:POLISHED]]
    best = min([*starts[:1], *polished], key=lambda found: found.volume)
    ball = _ball(points, sizes)
    if ball.volume <= best.volume * (1.0 + 1e-6):
        best = ball
    start, end = best.start * scale + middle, best.end * scale + middle
    return Capsule(start, end, max(MIN_RADIUS, _needed_radius(start, end, centres, radii)))


def distances_to_segment(points: FloatArray, start: FloatArray, end: FloatArray) -> FloatArray:
    """Distances (k,) of points (k, 3) from a segment, m."""
    return np.asarray(np.linalg.norm(_from_segment(points, start, end)[0], axis=1))


def _needed_radius(start: FloatArray, end: FloatArray, centres: FloatArray, radii: FloatArray) -> float:
    return float(np.max(distances_to_segment(centres, start, end) + radii))


def _from_segment(points: FloatArray, start: FloatArray, end: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Vectors (k, 3) from the closest points of the segment, and their share (k,) of the way from start to end."""
    along = end - start
    length2 = float(along @ along)
    share = np.zeros(len(points)) if length2 == 0.0 else np.clip((points - start) @ along / length2, 0.0, 1.0)
    return points - start - share[:, None] * along, share


def _directions(points: FloatArray, axes: FloatArray | None) -> FloatArray:
    """Unit vectors (n, 3): the balls' principal axes, the given ones, and a lattice over the half sphere."""
    spread = np.linalg.svd(points - points.mean(axis=0), full_matrices=True)[2]
    z = (np.arange(LATTICE) + 0.5) / LATTICE
    angle = np.pi * (1.0 + np.sqrt(5.0)) * np.arange(LATTICE)
    flat = np.sqrt(1.0 - z**2)
    lattice = np.stack([flat * np.cos(angle), flat * np.sin(angle), z], axis=1)
    given = np.zeros((0, 3)) if axes is None else axes
    return np.concatenate([spread, np.eye(3), given, lattice])


def _along(u: FloatArray, points: FloatArray, sizes: FloatArray) -> Capsule:
    """The best capsule along direction u (3,), its line through the middle of the balls' shadow."""
    across = np.linalg.svd(u[None])[2][1:]
    shadow = points @ across.T
    middle = across.T @ ((shadow + sizes[:, None]).max(axis=0) + (shadow - sizes[:, None]).min(axis=0)) / 2.0
    smallest = float(np.max(np.linalg.norm(shadow - across @ middle, axis=1) + sizes))
    tries = [_on_line(middle, u, radius, points, sizes) for radius in smallest * RADII]
    return min(tries, key=lambda found: found.volume)


def _on_line(origin: FloatArray, u: FloatArray, radius: float, points: FloatArray, sizes: FloatArray) -> Capsule:
    """The shortest capsule of a radius on a line: each ball needs a point of the segment within radius - r_i."""
    height = (points - origin) @ u
    off2 = np.sum((points - origin - height[:, None] * u) ** 2, axis=1)
    reach = np.sqrt(np.maximum((radius - sizes) ** 2 - off2, 0.0))
    low, high = float(np.min(height + reach)), float(np.max(height - reach))
    if low >= high:
        low = high = (low + high) / 2.0
    start, end = origin + low * u, origin + high * u
    return Capsule(start, end, _needed_radius(start, end, points, sizes))


def _polish(start: Capsule, points: FloatArray, sizes: FloatArray) -> Capsule:
    """A local minimum near `start`, on a working set of balls that grows by those that stick out."""
    x = np.array([*start.start, *start.end, start.radius])
    working = np.argsort(sizes + distances_to_segment(points, x[:3], x[3:6]))[-WORKING:]
    best = start
    for _ in range(ROUNDS):
        x = _local_minimum(x, points[working], sizes[working])
        a, b = x[:3], x[3:6]
        found = Capsule(a, b, _needed_radius(a, b, points, sizes))
        length = found.length
        if length > 1e-9:
            found = _on_line(a, (b - a) / length, found.radius, points, sizes)
        best = min(best, found, key=lambda capsule: capsule.volume)
        outside = sizes + distances_to_segment(points, a, b) - x[6]
        if outside.max() < 1e-10:
            break
        working = np.union1d(working, np.argsort(outside)[-WORKING // 3 :])
    return best


def _local_minimum(x: FloatArray, points: FloatArray, sizes: FloatArray) -> FloatArray:
    def volume(x: FloatArray) -> tuple[float, FloatArray]:
        along, radius = x[3:6] - x[:3], x[6]
        length = float(np.sqrt(along @ along + 1e-20))
        side = np.pi * radius**2 * along / length
        value = np.pi * radius**2 * (length + 4.0 / 3.0 * radius)
        return float(value), np.array([*-side, *side, 2.0 * np.pi * radius * length + 4.0 * np.pi * radius**2])

    def room(x: FloatArray) -> FloatArray:
        return np.asarray(x[6] - sizes - distances_to_segment(points, x[:3], x[3:6]))

    def room_slope(x: FloatArray) -> FloatArray:
        away, share = _from_segment(points, x[:3], x[3:6])
        normal = away / np.maximum(np.linalg.norm(away, axis=1), 1e-12)[:, None]
        return np.hstack([normal * (1.0 - share)[:, None], normal * share[:, None], np.ones((len(points), 1))])

    found = minimize(
        volume,
        x,
        jac=True,
        method="SLSQP",
        constraints={"type": "ineq", "fun": room, "jac": room_slope},
        options={"maxiter": 100, "ftol": 1e-13},
    )
    return np.array(found.x) if np.all(np.isfinite(found.x)) else x


def _ball(points: FloatArray, sizes: FloatArray) -> Capsule:
    """The smallest ball around balls, a convex problem; growing working sets are not needed for its four variables."""

    def room(x: FloatArray) -> FloatArray:
        return np.asarray(x[3] - sizes - np.linalg.norm(points - x[:3], axis=1))

    def room_slope(x: FloatArray) -> FloatArray:
        away = points - x[:3]
        normal = away / np.maximum(np.linalg.norm(away, axis=1), 1e-12)[:, None]
        return np.hstack([normal, np.ones((len(points), 1))])

    found = minimize(
        lambda x: (x[3], np.array([0.0, 0.0, 0.0, 1.0])),
        np.array([0.0, 0.0, 0.0, 1.0]),
        jac=True,
        method="SLSQP",
        constraints={"type": "ineq", "fun": room, "jac": room_slope},
        options={"maxiter": 100, "ftol": 1e-14},
    )
    centre = np.array(found.x[:3])
    return Capsule(centre, centre.copy(), _needed_radius(centre, centre, points, sizes))
