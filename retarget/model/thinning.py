"""Simplified meshes for pictures, with corners that share a normal on round surfaces.

Edge collapse with quadric error metrics (Garland and Heckbert, SIGGRAPH 1997, sections 3 to 6), many edges at a time:
the cheapest at both of their ends that keep the topology (link condition of Dey, Edelsbrunner, Guha and Nekhayev,
Publications de l'Institut Mathematique 66, 1999), so that walls of a thin shell stay apart.
"""

import numpy as np
from scipy.sparse import coo_array, csr_array
from scipy.sparse.csgraph import connected_components

from retarget.types import BoolArray, FloatArray, IntArray

DENSE, AT_FIRST = 12_000, 30
"""A mesh of more triangles, absolute or relative, is first merged on a grid."""
SAME = 1e-5
"""Distance of equal corners, relative to the mesh's size."""
BORDER = 10.0
"""Weight of planes that keep open edges in place, relative to faces (section 6)."""
SHORT = 1e-4
"""Weight of an edge's squared length, which thins flat regions evenly."""
STIFF = 1e-4
"""Pull to the middle of an edge, relative to its quadric's mean diagonal."""
CHEAPEST = 0.5
"""Share of edges, the cheapest, that may collapse in a round."""
SLOW, LAST = 0.01, 2.0
"""Least progress of a round, as a share of the faces, below which more edges may collapse; beyond all of them, also
those that turn a face over or change the topology."""
TRIES = 2
"""Number of choices of edges in a round."""
TURNED = 0.2
"""Least cosine between a face before and after a collapse."""
CREASE = np.cos(np.radians(50.0))
"""Cosine of the least angle of a sharp edge: cylinders of eight sides are round."""


def thinned(triangles: FloatArray, most: int) -> FloatArray:
    """About `most` triangles at most of triangles (t, 3, 3) m."""
    if len(triangles) <= most:
        return triangles
    low = triangles.reshape(-1, 3).min(axis=0)
    size = max(float(np.ptp(triangles.reshape(-1, 3), axis=0).max()), 1e-9)
    points, place = _merged((triangles - low).reshape(-1, 3) / size, SAME)
    faces, cells = _real(place.reshape(-1, 3)), 3.0 * DENSE**0.5
    while len(faces) > DENSE:
        points, place = _merged(points, 1.0 / cells, _octants(points, faces))
        faces, cells = _real(place[faces]), cells / 1.5
    quadrics, cells = _quadrics(points, faces), 2.0 * most**0.5
    while len(faces) > AT_FIRST * most:
        middle, place = _merged(points, 1.0 / cells, _octants(points, faces))
        if len(fewer := _real(place[faces])) <= AT_FIRST * most:
            quadrics, faces = _summed(quadrics.reshape(-1, 16), place, len(middle)).reshape(-1, 4, 4), fewer
            points = _nearest(quadrics, middle)
        cells /= 1.2
    share = CHEAPEST
    while len(faces) > most and share < LAST:
        before = len(faces)
        points, faces, quadrics = _collapsed(points, faces, quadrics, (len(faces) - most + 1) // 2, share=share)
        if len(faces) > (1.0 - SLOW) * before:
            share *= 1.5
    return np.asarray(low + size * points[faces])


def _merged(points: FloatArray, cell: float, kind: IntArray | int = 0) -> tuple[FloatArray, IntArray]:
    """Middles (p, 3) of the points of a kind in each cell of a grid; and each point's row in them."""
    number = np.round(points / cell).astype(np.int64) + 1
    cells = (number[:, 0] * 2**20 + number[:, 1]) * 2**20 + number[:, 2]
    _, place = np.unique(cells * 8 + kind, return_inverse=True)
    count = int(place.max(initial=-1)) + 1
    return _summed(points, place, count) / np.bincount(place, minlength=count)[:, None], place


def _octants(points: FloatArray, faces: IntArray) -> IntArray:
    """Octant, 0 to 7, of the normal at each point, which differs on both sides of a thin wall."""
    normals = np.tile(_normals(points, faces), (3, 1))
    return np.asarray((_summed(normals, faces.T.ravel(), len(points)) > 0.0) @ np.array([1, 2, 4]))


def _summed(values: FloatArray, place: IntArray, count: int) -> FloatArray:
    """Sums (count, k) of the rows of values (n, k) by place."""
    return np.column_stack([np.bincount(place, weights=column, minlength=count) for column in values.T])


def _nearest(quadrics: FloatArray, middle: FloatArray) -> FloatArray:
    """Points (n, 3) nearest to the planes of quadrics (n, 4, 4), or else to `middle`."""
    stiff = STIFF * np.trace(quadrics[:, :3, :3], axis1=1, axis2=2)[:, None] / 3.0 + 1e-12
    left = quadrics[:, :3, :3] + stiff[..., None] * np.eye(3)
    return np.asarray(np.linalg.solve(left, (stiff * middle - quadrics[:, :3, 3])[..., None])[..., 0])


def _real(faces: IntArray) -> IntArray:
    faces = faces[(faces != np.roll(faces, 1, axis=1)).all(axis=1)]
    ordered = np.sort(faces, axis=1)
    _, first = np.unique((ordered[:, 0] * 2**21 + ordered[:, 1]) * 2**21 + ordered[:, 2], return_index=True)
    return faces[first]


def _edges(faces: IntArray) -> tuple[IntArray, IntArray, IntArray]:
    """Edges (e, 2), numbers of their faces, and edges of the 3 f sides: 0 to 1 of all faces, then 1 to 2, 2 to 0."""
    sides = np.sort(np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]), axis=1)
    key, edge, count = np.unique(sides[:, 0] * 2**32 + sides[:, 1], return_inverse=True, return_counts=True)
    return np.column_stack([key // 2**32, key % 2**32]), count, edge


def _normals(points: FloatArray, faces: IntArray) -> FloatArray:
    """Normals (f, 3) of faces, of twice their area."""
    a, b, c = (points[faces[:, corner]] for corner in range(3))
    return np.asarray(np.cross(b - a, c - a))


def _quadrics(points: FloatArray, faces: IntArray) -> FloatArray:
    """Quadrics (p, 4, 4) of points: planes of faces, and planes across open edges."""
    normal = _normals(points, faces)
    area = np.linalg.norm(normal, axis=1)
    unit = normal / np.maximum(area, 1e-15)[:, None]
    total = np.zeros((len(points), 4, 4))

    def add(at: IntArray, outward: FloatArray, on: FloatArray, weight: FloatArray) -> None:
        plane = np.column_stack([outward, -(outward * on).sum(axis=1)])
        quadric = (weight[:, None, None] * plane[:, :, None] * plane[:, None, :]).reshape(-1, 16)
        total[:] += _summed(quadric, at, len(points)).reshape(-1, 4, 4)

    for corner in range(3):
        add(faces[:, corner], unit, points[faces[:, 0]], area)
    edges, count, of = _edges(faces)
    side = np.flatnonzero(count[of] == 1)
    ends = edges[of[side]]
    along = points[ends[:, 1]] - points[ends[:, 0]]
    across = np.cross(unit[side % len(faces)], along)  # as long as the edge
    long = np.linalg.norm(across, axis=1)
    for end in range(2):
        add(ends[:, end], across / np.maximum(long, 1e-15)[:, None], points[ends[:, 0]], BORDER * long**2)
    return total


def _collapsed(
    points: FloatArray, faces: IntArray, quadrics: FloatArray, most: int, *, share: float
) -> tuple[FloatArray, IntArray, FloatArray]:
    edges, count, _ = _edges(faces)
    both = quadrics[edges[:, 0]] + quadrics[edges[:, 1]]
    target = _nearest(both, points[edges].mean(axis=1))
    whole = np.column_stack([target, np.ones(len(target))])
    short = SHORT * STIFF * np.trace(both[:, :3, :3], axis1=1, axis2=2)
    length = points[edges[:, 1]] - points[edges[:, 0]]
    cost = np.einsum("ei,eij,ej->e", whole, both, whole) + short * (length**2).sum(axis=1)
    rank = np.empty(len(edges), dtype=np.int64)
    rank[np.argsort(cost)] = np.arange(len(edges))
    for _ in range(TRIES):
        least = np.full(len(points), len(edges))
        for end in range(2):
            np.minimum.at(least, edges[:, end], rank)
        chosen = (least[edges] == rank[:, None]).all(axis=1) & (rank <= share * len(edges))
        if share < 1.0:
            wrong = chosen & _turning(points, faces, edges, target, chosen)
            wrong[chosen] |= _pinching(len(points), edges, count, chosen)
            chosen &= ~wrong
            rank[wrong] = len(edges)  # these block no others
    pick = np.flatnonzero(chosen)
    pick = pick[np.argsort(rank[pick])][:most]
    stays, goes = edges[pick].T
    moved, summed, names = points.copy(), quadrics.copy(), np.arange(len(points))
    moved[stays], summed[stays], names[goes] = target[pick], both[pick], stays
    return moved, _real(names[faces]), summed


def _pinching(points: int, edges: IntArray, count: IntArray, chosen: BoolArray) -> BoolArray:
    """Mask of chosen edges whose collapse changes the topology: with other common neighbours, or between borders."""
    sides = np.concatenate([edges, edges[:, ::-1]])
    meets = csr_array((np.ones(len(sides), dtype=np.int32), (sides[:, 0], sides[:, 1])), shape=(points, points))
    border = np.zeros(points, dtype=bool)
    border[edges[count == 1].ravel()] = True
    edges, count = edges[chosen], count[chosen]
    common = meets[edges[:, 0]].multiply(meets[edges[:, 1]]).sum(axis=1)
    return np.asarray((np.ravel(common) != count) | ((count > 1) & border[edges].all(axis=1)))


def _turning(points: FloatArray, faces: IntArray, edges: IntArray, target: FloatArray, chosen: BoolArray) -> BoolArray:
    """Mask of chosen edges whose collapse to `target` turns a face over."""
    moved, names, of = points.copy(), np.arange(len(points)), np.full(len(points), -1)
    pick = np.flatnonzero(chosen)
    for end in range(2):
        moved[edges[pick, end]], of[edges[pick, end]] = target[pick], pick
    names[edges[pick, 1]] = edges[pick, 0]
    after = names[faces]
    stays = (after != np.roll(after, 1, axis=1)).all(axis=1) & (of[faces] >= 0).any(axis=1)
    old, new = _normals(points, faces[stays]), _normals(moved, faces[stays])
    lengths = np.linalg.norm(old, axis=1) * np.linalg.norm(new, axis=1)
    over = (old * new).sum(axis=1) < TURNED * lengths
    wrong = np.zeros(len(edges) + 1, dtype=bool)
    wrong[of[faces[stays][over]].ravel()] = True  # the last is for points that stay
    return wrong[:-1]


def creased(triangles: FloatArray) -> tuple[FloatArray, IntArray]:
    """Vertices (v, 3) and faces (f, 3) of triangles (t, 3, 3) m; sharp edges share no vertices."""
    corners = triangles.reshape(-1, 3)
    _, place = np.unique(corners, axis=0, return_inverse=True)
    place = place.reshape(-1, 3)
    real = (place != np.roll(place, 1, axis=1)).all(axis=1)
    place, corners = place[real], triangles[real].reshape(-1, 3)
    count = len(place)
    normal = _normals(corners, np.arange(3 * count).reshape(-1, 3))
    normal /= np.maximum(np.linalg.norm(normal, axis=1), 1e-15)[:, None]
    edge = _edges(place)[2]
    order = np.argsort(edge, kind="stable")
    first, second = order[:-1], order[1:]
    first, second = (sides[edge[first] == edge[second]] for sides in (first, second))
    smooth = (normal[first % count] * normal[second % count]).sum(axis=1) > CREASE
    first, second = first[smooth], second[smooth]

    def corner(side: IntArray, end: int) -> IntArray:
        return 3 * (side % count) + (side // count + end) % 3

    flat = place.ravel()
    joined = []
    for one in range(2):
        for other in range(2):
            a, b = corner(first, one), corner(second, other)
            joined.append(np.column_stack([a, b])[flat[a] == flat[b]])
    pairs = np.concatenate(joined)
    graph = coo_array((np.ones(len(pairs), dtype=bool), (pairs[:, 0], pairs[:, 1])), shape=(3 * count, 3 * count))
    vertices, name = connected_components(graph, directed=False)
    found = np.empty((vertices, 3))
    found[name] = corners
    return found, name.reshape(-1, 3).astype(np.int64)
