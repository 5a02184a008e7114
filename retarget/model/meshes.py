"""The shapes of a body as triangles, link by link: the one source of pictures, of pages and of what a headset shows."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import count, repeat
from typing import TYPE_CHECKING, Any

import numpy as np

from retarget import rotations
from retarget.model.body import BodyModel, Geom, JointType
from retarget.model.scene_shapes import ShapeKind
from retarget.types import FloatArray, IntArray

if TYPE_CHECKING:
    from retarget import _solver

# A mesh, and those of the shapes that files and scenes know.


@dataclass(frozen=True, eq=False)
class Mesh:
    """vertices (v, 3) m; faces (f, 3): their corners, counter-clockwise as seen from outside.

    Faces share a vertex where the surface is round, and have vertices of their own along a sharp edge: a vertex's
    normal is that of all its faces.
    """

    vertices: FloatArray
    faces: IntArray

    def placed(self, position: FloatArray, quat: FloatArray) -> "Mesh":
        """The same in the frame in which its own is at position (3,) m and turned by quat (4,) wxyz."""
        return Mesh(position + rotations.rotate(quat, self.vertices), self.faces)


def joined(meshes: Sequence[Mesh]) -> Mesh:
    """All of them as one."""
    first = np.cumsum([0, *(len(mesh.vertices) for mesh in meshes)])
    faces = [mesh.faces + offset for mesh, offset in zip(meshes, first[:-1], strict=True)]
    return Mesh(np.concatenate([mesh.vertices for mesh in meshes]), np.concatenate(faces))


AROUND = 24
"""Corners of a circle."""
THINNEST, GROUND = 0.002, 2.0
"""Least radius that is seen, and half the side of the piece of a half-space that is, m."""


def shape_mesh(kind: int, size: Iterable[float], *, around: int = AROUND) -> Mesh:
    """A canonical shape of `scene_shapes`, in its own frame; of a half-space a piece of its surface. around: corners of
    a circle."""
    x, y, z = (float(value) for value in size)
    if kind == ShapeKind.CAPSULE:
        radius = max(x, THINNEST)
        angle = np.linspace(0.0, 0.5 * np.pi, max(around // 4, 1) + 1)
        cap = np.column_stack([radius * np.sin(angle), y + radius * np.cos(angle)])
        cap[0, 0] = 0.0
        upper = cap[::-1] if y > 0.0 else cap[-2::-1]  # a sphere has one equator, or its normals would break there
        return _swept(np.concatenate([cap * (1.0, -1.0), upper]), around)
    if kind == ShapeKind.CYLINDER:
        lines = ([(0.0, -y), (x, -y)], [(x, -y), (x, y)], [(x, y), (0.0, y)])
        return joined([_swept(np.array(line), around) for line in lines])
    return _box(np.array((x, y, z) if kind == ShapeKind.BOX else (GROUND, GROUND, THINNEST)))


def _swept(line: FloatArray, around: int) -> Mesh:
    """What a line (n, 2) of radius and height, m, from below to above, sweeps about z."""
    angle = np.linspace(0.0, 2.0 * np.pi, around, endpoint=False)
    radius, height = line[:, :1], np.repeat(line[:, 1:], around, axis=1)
    vertices = np.stack([radius * np.cos(angle), radius * np.sin(angle), height], axis=-1).reshape(-1, 3)
    # A circle of radius 0 is one vertex, and the faces between two of its corners are none.
    number = np.arange(len(vertices)).reshape(height.shape)
    number = np.where(radius > 0.0, number, number[:, :1])
    after = np.roll(number, -1, axis=1)
    a, b, c, d = number[:-1], after[:-1], after[1:], number[1:]
    faces = np.stack([a, b, c, a, c, d], axis=-1).reshape(-1, 3)
    faces = faces[(faces != np.roll(faces, 1, axis=1)).all(axis=1)]
    used, corners = np.unique(faces, return_inverse=True)
    return Mesh(vertices[used], corners.reshape(-1, 3))


def _box(half: FloatArray) -> Mesh:
    signs = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]], dtype=np.float64)
    sides = np.empty((6, 4, 3))
    for side in range(6):
        axis, sign = side // 2, 2.0 * (side % 2) - 1.0
        sides[side, :, axis] = sign
        sides[side][:, [(axis + 1) % 3, (axis + 2) % 3]] = signs if sign > 0.0 else signs[::-1]
    faces = 4 * np.arange(6)[:, None, None] + np.array([[0, 1, 2], [0, 2, 3]])
    return Mesh(half * sides.reshape(-1, 3), faces.reshape(-1, 3))


ROUND, EDGE = 0.25, 12
"""Radius of the edges of a box that is a link, in its least half side, and corners of a circle to a step of theirs."""


def _rounded(half: FloatArray, around: int) -> Mesh:
    """A box (3,) whose edges are round: the eighths of a ball, apart. around: corners of a circle elsewhere."""
    radius = ROUND * float(half.min())
    quarter = np.linspace(0.0, 0.5 * np.pi, max(around // EDGE, 1) + 1)
    up = np.concatenate([quarter - 0.5 * np.pi, quarter])[:, None]
    about = (0.5 * np.pi * np.arange(4)[:, None] + quarter).ravel()
    ball = [np.cos(up) * np.cos(about), np.cos(up) * np.sin(about), np.repeat(np.sin(up), len(about), axis=1)]
    middle = np.repeat([0.25 * np.pi, 0.75 * np.pi, 1.25 * np.pi, 1.75 * np.pi], len(quarter))
    below = np.repeat([-1.0, 1.0], len(quarter))[:, None]
    signs = [np.sign(np.cos(middle)) + 0.0 * up, np.sign(np.sin(middle)) + 0.0 * up, below + 0.0 * middle]
    vertices = radius * np.stack(ball, axis=-1) + (half - radius) * np.stack(signs, axis=-1)
    number = np.arange(vertices[..., 0].size).reshape(len(up), len(about))
    after = np.roll(number, -1, axis=1)
    a, b, c, d = number[:-1], after[:-1], after[1:], number[1:]
    sides = np.stack([a, b, c, a, c, d], axis=-1).reshape(-1, 3)
    low, high = number[0, :: len(quarter)], number[-1, :: len(quarter)]
    ends = [low[[0, 2, 1]], low[[0, 3, 2]], high[[0, 1, 2]], high[[0, 2, 3]]]
    return Mesh(vertices.reshape(-1, 3), np.concatenate([sides, np.array(ends)]))


# The links of a body.

MOST_TRIANGLES = 12_000
"""Of a body: so many are seen, and a page that holds two bodies stays small."""
DETAILS = (AROUND, 20, 16, 12, 8, 6, 4)
"""Corners of a circle that are tried until a body has no more than that."""
FINE = 0.03
"""Radius, m, of circles that have them all."""
CELLS = 4
"""A mesh of a file is thinned to cells of a body's size over its detail and over this, so that both are as coarse."""
THIN, THIN_AROUND = 0.012, 6
"""Radius of what joins links, in the sum of their lengths, and its corners."""


Part = tuple[int, tuple[float, float, float] | None]
"""A link, and the colour of a part of it, 0 to 1; None for the colour of its side."""


def link_meshes(body: BodyModel) -> dict[Part, Mesh]:
    """The shapes of each link that has some, by their colours, in the link's frame; planes and height fields are left
    out. Of a link's shapes only those for looking at (which collide with nothing), if it has any; else also what joins
    links where shapes leave gaps, and all in the colour of its side."""
    reach = float(np.linalg.norm(body.body_pos, axis=1).sum())
    return _coarse(range(1, len(body.parent)), partial(_parts, body), reach, MOST_TRIANGLES)


def link_shapes(geoms: Sequence[Geom], links: Iterable[int], *, reach: float, most: int) -> dict[int, Mesh]:
    """The shapes of each of these links that has some, as `link_meshes` has them, of at most about so many triangles,
    whatever their colours. reach: size of the body, m."""

    def parts_of(link: int, around: int, cell: float) -> list[tuple[Part, Mesh]]:
        return [((link, None), mesh) for _, mesh in _shapes(geoms, link, around, cell)]

    return {link: mesh for (link, _), mesh in _coarse(links, parts_of, reach, most).items()}


def _coarse(
    links: Iterable[int], parts_of: Callable[[int, int, float], list[tuple[Part, Mesh]]], reach: float, most: int
) -> dict[Part, Mesh]:
    """The shapes of each part as one mesh, as fine as that many triangles allow."""
    links, meshes = tuple(links), dict[Part, list[Mesh]]()
    for around in DETAILS:
        cell, meshes = 0.0 if around == DETAILS[0] else reach / (CELLS * around), {}
        for link in links:
            for part, mesh in parts_of(link, around, cell):
                meshes.setdefault(part, []).append(mesh)
        if sum(len(mesh.faces) for shapes in meshes.values() for mesh in shapes) <= most:
            break
    return {part: joined(shapes) for part, shapes in meshes.items()}


def _shapes(geoms: Sequence[Geom], link: int, around: int, cell: float) -> list[tuple[Geom, Mesh]]:
    geoms = [geom for geom in geoms if geom.body == link]
    geoms = [geom for geom in geoms if not geom.collides] or geoms
    return [(geom, mesh) for geom in geoms if (mesh := _geom_mesh(geom, around, cell)) is not None]


def _parts(body: BodyModel, link: int, around: int, cell: float) -> list[tuple[Part, Mesh]]:
    shapes = _shapes(body.geoms, link, around, cell)
    if any(not geom.collides for geom, _ in shapes):
        return [((link, geom.colour), mesh) for geom, mesh in shapes]
    parts = [mesh for _, mesh in shapes]
    return [((link, None), mesh) for mesh in (*parts, *_rods(body, link, parts))]


def _rods(body: BodyModel, link: int, parts: Sequence[Mesh]) -> list[Mesh]:
    """What joins a link to its children, and to its own shapes where they leave a gap."""
    ends, begin = list(body.body_pos[body.parent == link]), np.zeros(3)
    points = joined(parts).vertices if parts else np.array(ends).reshape(-1, 3)
    low, high = (points.min(axis=0), points.max(axis=0)) if len(points) else (begin, begin)
    middle = 0.5 * (low + high)
    if all(body.joint_type[joint] == JointType.FREE for joint in np.flatnonzero(body.joint_body == link)):
        # Nothing turns it about its origin, which may be anywhere: on the ground, say.
        begin = middle
        ends = [end for end in ends if not parts or ((end < low) | (end > high)).any()]
    elif parts and not (np.abs(middle) < 0.5 * (high - low)).all():  # what hangs beside its joint
        ends.append(middle)
    radius, rods = THIN * float(np.linalg.norm(body.body_pos, axis=1).sum()), []
    for end in ends:
        length = float(np.linalg.norm(end - begin))
        if length > THINNEST:
            rod = shape_mesh(ShapeKind.CYLINDER, (radius, 0.5 * length, 0.0), around=THIN_AROUND)
            turn = rotations.shortest_arc(np.array([0.0, 0.0, 1.0]), end - begin)
            rods.append(rod.placed(0.5 * (begin + end), turn))
    return rods


def _geom_mesh(geom: Geom, around: int, cell: float) -> Mesh | None:
    """A geom in the frame of its link; None for planes and height fields. around: corners of a circle, fewer of a small
    one."""
    size = geom.size.tolist()
    middle = sorted(size)[1] if geom.kind == "ellipsoid" else size[0]  # a radius where it is round
    around = min(around, max(4 * round(0.25 * around * (middle / FINE) ** 0.5), DETAILS[-2]))
    if geom.kind == "mesh":
        assert geom.triangles is not None
        mesh = _creased(geom.triangles, cell)
    elif geom.kind == "ellipsoid":
        ball = shape_mesh(ShapeKind.CAPSULE, (1.0, 0.0, 0.0), around=around)
        mesh = Mesh(geom.size * ball.vertices, ball.faces)
    elif geom.kind == "sphere":
        mesh = shape_mesh(ShapeKind.CAPSULE, (size[0], 0.0, 0.0), around=around)
    elif geom.kind == "box":
        mesh = _rounded(geom.size, around)
    elif geom.kind in ("capsule", "cylinder"):
        mesh = shape_mesh(ShapeKind[geom.kind.upper()], size, around=around)
    else:
        return None
    return mesh.placed(geom.position, geom.quat)


def _creased(triangles: FloatArray, cell: float) -> Mesh:
    """The mesh of triangles (t, 3, 3) m: corners in one cell of a grid, of this size in m, become one, but not those of
    faces that look along different axes."""
    corners = triangles.reshape(-1, 3)
    key = np.round(corners / cell) if cell > 0.0 else corners
    _, place = np.unique(key, axis=0, return_inverse=True)
    place = place.reshape(-1)
    count = np.bincount(place)
    mean = np.column_stack([np.bincount(place, weights=column) / count for column in corners.T])
    faces = place.reshape(-1, 3)
    faces = faces[(faces != np.roll(faces, 1, axis=1)).all(axis=1)]
    normal = np.cross(mean[faces[:, 1]] - mean[faces[:, 0]], mean[faces[:, 2]] - mean[faces[:, 0]])
    axis = np.argmax(np.abs(normal), axis=1)
    side = 2 * axis + (normal[np.arange(len(faces)), axis] > 0.0)
    used, corner = np.unique(6 * faces + side[:, None], return_inverse=True)
    return Mesh(mean[used // 6], corner.reshape(-1, 3))


# A body to draw: its meshes with colours, and where its links are.

LEAST_M = 0.05
"""Height of a body that has hardly any: something to scale by."""
LEFT, RIGHT, MIDDLE = "#d55e00", "#0072b2", "#b0b0b0"
"""Of Okabe and Ito's palette: the sides of a body, and what is between."""
OBSTACLE, OBSERVER = "#b0967a", "#9a5b86"
"""Of the scene's shapes, and of observers that act; the legend of a page has the same ones."""
SIDES = {"l_": LEFT, "r_": RIGHT}
"""Colours of parts of a body by how their names begin."""


def side_colours(body: BodyModel, named: Mapping[str, int]) -> tuple[str, ...]:
    """The colour of each link, by the side of the limb it belongs to. named: the links that frames are on, by the names
    of the frames: a limb is what carries `l_` or `r_` frames only, and what hangs from it."""
    between = {link for name, end in named.items() if name[:2] not in SIDES for link in body.chain_to_root(end)}
    found: dict[int, str] = {}
    for name, end in named.items():
        if name[:2] in SIDES:
            found |= {link: SIDES[name[:2]] for link in body.chain_to_root(end) if link not in between}
    for link, parent in enumerate(body.parent.tolist()):  # a parent comes before its children
        if link not in found and link not in between and parent in found:
            found[link] = found[parent]
    return tuple(found.get(link, MIDDLE) for link in range(len(body.parent)))


@dataclass(frozen=True, eq=False)
class SolidBody:
    """A body to draw. links (k,): those that have meshes, by their numbers. meshes (m,) in the frames of their links,
    owners (m,): which of the k; colours (m, 3), 0 to 1. height: from its lowest to its highest point as the file has
    it, m."""

    body: BodyModel
    links: IntArray
    meshes: tuple[Mesh, ...]
    owners: IntArray
    colours: FloatArray
    height: float
    kinematics: "_solver.Body"

    def as_json(self) -> dict[str, Any]:
        """What `bodies.js` draws. Links are numbered as in `poses`."""
        return {"height": round(self.height, 4)} | meshes_json(self.meshes, self.colours.tolist(), self.owners.tolist())

    def poses(self, q: FloatArray) -> FloatArray:
        """Where its links are in postures (T, nq): (T, k, 7) of position, m, and quaternion wxyz."""
        forward = [self.kinematics.forward(np.ascontiguousarray(posture)) for posture in q]
        return np.array([np.column_stack(pose)[self.links] for pose in forward])

    def com(self, q: FloatArray) -> FloatArray:
        """Centre of mass (T, 3) m in postures (T, nq)."""
        return self.kinematics.centre_of_mass(np.ascontiguousarray(q))


def meshes_json(
    meshes: Iterable[Mesh], colours: Iterable[Sequence[float]], links: Iterable[int] | None = None
) -> dict[str, Any]:
    """Meshes and their colours, 0 to 1, as `bodies.js` draws them: vertices in m to a tenth of a millimetre. links:
    numbers of their poses; None if each mesh has its own."""
    return {
        "meshes": [
            {
                "link": link,
                "vertices": mesh.vertices.round(4).ravel().tolist(),
                "faces": mesh.faces.ravel().tolist(),
                "colour": [round(value, 3) for value in colour],
            }
            for link, mesh, colour in zip(count() if links is None else links, meshes, colours, strict=False)
        ]
    }


def shapes_json(meshes: Iterable[Mesh], colour: str) -> dict[str, Any]:
    """Meshes of one colour, as `bodies.js` draws them."""
    return meshes_json(meshes, repeat(rgb(colour)))


def rgb(colour: str) -> list[float]:
    """Red, green and blue, 0 to 1, of a colour as `#d55e00`."""
    return [int(colour[at : at + 2], 16) / 255.0 for at in (1, 3, 5)]


def solid_body(body: BodyModel, named: Mapping[str, int] | None = None) -> SolidBody:
    """A body in the colours of its sides, see `side_colours`. named: None for the names of the links themselves."""
    if named is None:
        named = {name: link for link, name in enumerate(body.body_names) if link > 0}
    meshes, sides, kinematics = link_meshes(body), side_colours(body, named), body.solver_body()
    # A limb shows its side: its links have colours of their own only beside that of the side.
    shades = [own if own and (sides[link] == MIDDLE or (link, None) in meshes) else rgb(sides[link])
              for link, own in meshes]  # fmt: skip
    links, owners = np.unique([link for link, _ in meshes], return_inverse=True)
    position, quat = kinematics.forward(body.qpos0)
    heights = [mesh.placed(position[link], quat[link]).vertices[:, 2] for (link, _), mesh in meshes.items()]
    height = max(float(np.ptp(np.concatenate(heights))), LEAST_M) if heights else LEAST_M
    links, owners = links.astype(np.int64), owners.astype(np.int64)
    return SolidBody(body, links, tuple(meshes.values()), owners, np.array(shades), height, kinematics)
