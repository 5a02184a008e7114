"""The support polygon of planted soles: its edges for the solver, and how far inside of it a centre of mass is.

An edge is a half-plane (nx, ny, d): the unit normal points outward and nx x + ny y <= d holds inside. Coordinates are
metres on the ground, world frame.
"""

from collections.abc import Sequence

import numpy as np

from retarget import rotations
from retarget.rotations import FloatArray

__all__ = ["convex_hull", "half_spaces", "sole_outline", "support_distance", "support_edges"]

SHORTEST_EDGE = 1e-6
"""Corners closer than this, m, are one."""


def sole_outline(position: FloatArray, orientation: FloatArray, polygon: FloatArray) -> FloatArray:
    """Corners (c, 2) on the ground of a sole at `position` (3,), `orientation` (4,); `polygon` (c, 2): its outline."""
    corners = np.column_stack([polygon, np.zeros(len(polygon))])
    return np.asarray((position + rotations.rotate(orientation, corners))[:, :2])


def convex_hull(points: FloatArray) -> FloatArray:
    """Corners (h, 2) of the convex hull of points (n, 2), counter-clockwise (Andrew's monotone chain)."""
    ordered = [(float(x), float(y)) for x, y in points[np.lexsort((points[:, 1], points[:, 0]))]]
    chains = [_chain(ordered), _chain(ordered[::-1])]
    return np.array([corner for chain in chains for corner in chain[:-1]])


def support_edges(outlines: Sequence[FloatArray], *, margin: float = 0.0) -> FloatArray:
    """Edges (e, 3) of the convex hull of all `outlines`, each (c, 2), moved inward by `margin` m.

    Where the margin leaves nothing, the edges are moved inward only as far as the middle of the polygon allows.
    """
    corners = convex_hull(np.concatenate(outlines))
    along = np.roll(corners, -1, axis=0) - corners
    length = np.hypot(along[:, 0], along[:, 1])
    long = length > SHORTEST_EDGE
    along, corners = along[long] / length[long, None], corners[long]
    normal = np.column_stack([along[:, 1], -along[:, 0]])
    offset = np.einsum("ij,ij->i", normal, corners)
    room = float((offset - normal @ corners.mean(axis=0)).min())
    return np.column_stack([normal, offset - min(margin, 0.9 * room)])


def half_spaces(edges: FloatArray) -> FloatArray:
    """Edges (e, 3) as half-spaces (e, 4) of any height: nx, ny, 0, d."""
    return np.insert(edges, 2, 0.0, axis=1)


def support_distance(points: FloatArray, edges: FloatArray) -> FloatArray:
    """How far (...) m points (..., 2 or 3) are inside the edges (e, 3); negative: outside, by the edge missed most."""
    return np.asarray((edges[:, 2] - points[..., :2] @ edges[:, :2].T).min(axis=-1))


def _chain(ordered: Sequence[tuple[float, float]]) -> list[tuple[float, float]]:
    """One side of the hull of points in order; every corner is a left turn."""
    chain: list[tuple[float, float]] = []
    for x, y in ordered:
        while len(chain) > 1:
            (ax, ay), (bx, by) = chain[-2:]
            if (bx - ax) * (y - ay) - (by - ay) * (x - ax) > 0.0:
                break
            chain.pop()
        chain.append((x, y))
    return chain
