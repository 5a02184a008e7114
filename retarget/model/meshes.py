"""Meshes of bodies and scenes, for pictures, pages and headsets."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import count, repeat
from typing import TYPE_CHECKING, Any

import numpy as np

from retarget import rotations
from retarget.model.body import BodyModel, Geom, JointType
from retarget.model.scene_shapes import ShapeKind
from retarget.model.thinning import creased, thinned
from retarget.types import FloatArray, IntArray

if TYPE_CHECKING:
    from retarget import _solver


@dataclass(frozen=True, eq=False)
class Mesh:
    """vertices (v, 3) m; faces (f, 3): corners, counter-clockwise from outside. Round surfaces share vertices, sharp
    edges do not."""

    vertices: FloatArray
    faces: IntArray

    @cached_property
    def is_closed(self) -> bool:
        """True if the surface has no border."""
        _, place = np.unique(self.vertices, axis=0, return_inverse=True)
        corners = place.reshape(-1)[self.faces]
        sides = np.stack([corners, np.roll(corners, -1, axis=1)], axis=-1).reshape(-1, 2)
        there, back = (np.sort(begin * len(place) + end) for begin, end in (sides.T, sides.T[::-1]))
        return bool((there == back).all())

    def placed(self, position: FloatArray, quat: FloatArray) -> "Mesh":
        """Mesh in the frame in which its own is at position (3,) m, quat (4,) wxyz."""
        return Mesh(position + rotations.rotate(quat, self.vertices), self.faces)


def joined(meshes: Sequence[Mesh]) -> Mesh:
    """Several meshes as one."""
    first = np.cumsum([0, *(len(mesh.vertices) for mesh in meshes)])
    faces = [mesh.faces + offset for mesh, offset in zip(meshes, first[:-1], strict=True)]
    return Mesh(np.concatenate([mesh.vertices for mesh in meshes]), np.concatenate(faces))


AROUND = 24
"""Corners of a circle."""
THINNEST, GROUND = 0.002, 2.0
"""Least radius, and half the side of a half-space, m."""


def shape_mesh(kind: int, size: Iterable[float], *, around: int = AROUND) -> Mesh:
    """Canonical shape of `scene_shapes` in its own frame. around: corners of a circle."""
    x, y, z = (float(value) for value in size)
    if kind == ShapeKind.CAPSULE:
        radius = max(x, THINNEST)
        angle = np.linspace(0.0, 0.5 * np.pi, max(around // 4, 1) + 1)
        cap = np.column_stack([radius * np.sin(angle), y + radius * np.cos(angle)])
        cap[0, 0] = 0.0
        upper = cap[::-1] if y > 0.0 else cap[-2::-1]  # a sphere has one equator
        return _swept(np.concatenate([cap * (1.0, -1.0), upper]), around)
    if kind == ShapeKind.CYLINDER:
        lines = ([(0.0, -y), (x, -y)], [(x, -y), (x, y)], [(x, y), (0.0, y)])
        return joined([_swept(np.array(line), around) for line in lines])
    return _box(np.array((x, y, z) if kind == ShapeKind.BOX else (GROUND, GROUND, THINNEST)))


def _swept(line: FloatArray, around: int) -> Mesh:
    """Surface of a line (n, 2) of radius and height, m, swept about z."""
    angle = np.linspace(0.0, 2.0 * np.pi, around, endpoint=False)
    radius, height = line[:, :1], np.repeat(line[:, 1:], around, axis=1)
    vertices = np.stack([radius * np.cos(angle), radius * np.sin(angle), height], axis=-1).reshape(-1, 3)
    # A circle of radius 0 is one vertex.
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
"""Radius of a box's edges relative to its least half side; corners of a circle per step of an edge."""


def _rounded(half: FloatArray, around: int) -> Mesh:
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


MOST_TRIANGLES = 12_000
"""Greatest number of triangles of a body."""
DETAILS = (AROUND, 20, 16, 12, 8, 6, 4)
FINE = 0.03
"""Least radius, m, of circles with all corners."""
LEAST_TRIANGLES = 40
"""Least number of triangles of a file's mesh."""
THIN, THIN_AROUND, ROOM = 0.025, 12, 500
"""Rods between links: relative radius, corners, and number of triangles."""


Part = tuple[int, tuple[float, float, float] | None]
"""A link, and the colour of a part of it, 0 to 1; None for that of its side."""


def link_meshes(body: BodyModel) -> dict[Part, Mesh]:
    """Meshes of links by colour, each in its link's frame. Shapes that do not collide replace the others of a link;
    without them, rods close gaps."""
    geoms = _shown(body.geoms, range(1, len(body.parent)))
    found, parts = _drawn(geoms, MOST_TRIANGLES - ROOM), dict[Part, list[Mesh]]()
    for geom, mesh in found:
        parts.setdefault((geom.body, None if geom.collides else geom.colour), []).append(mesh)
    for link, rods in _rods(body, found).items():
        parts.setdefault((link, None), []).extend(rods)
    return {part: joined(parts[part]) for part in sorted(parts, key=lambda part: part[0])}


def link_looks(geoms: Sequence[Geom], links: Iterable[int], *, most: int) -> dict[Part, Mesh]:
    """Files' meshes of these links, by colour, with about `most` triangles at most."""
    parts = dict[Part, list[Mesh]]()
    for geom, mesh in _drawn([geom for geom in _shown(geoms, links) if geom.triangles is not None], most):
        parts.setdefault((geom.body, geom.colour), []).append(mesh)
    return {part: joined(meshes) for part, meshes in parts.items()}


def _shown(geoms: Sequence[Geom], links: Iterable[int]) -> list[Geom]:
    """Shapes of these links that do not collide; all of a link without any."""
    own = [[geom for geom in geoms if geom.body == link] for link in links]
    return [geom for all_ in own for geom in [geom for geom in all_ if not geom.collides] or all_]


def _drawn(geoms: Sequence[Geom], most: int) -> list[tuple[Geom, Mesh]]:
    files = [geom for geom in geoms if geom.triangles is not None]
    dense, count, simple = sum(len(_soup(geom)) for geom in files), 0, list[Mesh | None]()
    for around in DETAILS:
        simple = [None if geom.triangles is not None else _simple_mesh(geom, around) for geom in geoms]
        count = sum(len(mesh.faces) for mesh in simple if mesh is not None)
        if count <= most - min(dense, most // 2):
            break
    lots = iter(_lots(files, most - count))
    made = [
        mesh if geom.triangles is None else Mesh(*creased(thinned(_soup(geom), next(lots))))
        for geom, mesh in zip(geoms, simple, strict=True)
    ]
    return [
        (geom, mesh.placed(geom.position, geom.quat))
        for geom, mesh in zip(geoms, made, strict=True)
        if mesh is not None and len(mesh.faces)
    ]


def _soup(geom: Geom) -> FloatArray:
    return np.zeros((0, 3, 3)) if geom.triangles is None else geom.triangles


def _lots(geoms: Sequence[Geom], most: int) -> list[int]:
    """Numbers of triangles of files' meshes, by size and detail."""
    has = np.array([len(_soup(geom)) for geom in geoms], dtype=np.float64)
    size = np.array([np.linalg.norm(np.ptp(_soup(geom).reshape(-1, 3), axis=0)) for geom in geoms]) + 1e-9
    size *= has**0.25
    lots = np.minimum(has, LEAST_TRIANGLES)
    while True:
        wants = lots < has
        left = most - lots.sum()
        if not wants.any() or left < wants.sum():
            return [int(lot) for lot in lots]
        lots[wants] = np.minimum(has, lots + left * size / size[wants].sum())[wants]


def _rods(body: BodyModel, shown: Sequence[tuple[Geom, Mesh]]) -> dict[int, list[Mesh]]:
    """Rods from links to their joints, and to their own shapes across a gap, by link. Links fixed to each other are
    one."""
    position, quat = body.solver_body().forward(body.qpos0)
    rigid = np.arange(len(body.parent))  # the link whose joint moves each one
    for link in range(1, len(rigid)):
        if body.parent[link] > 0 and not (body.joint_body == link).any():
            rigid[link] = rigid[body.parent[link]]
    longest = float(_depths(body)[body.joint_body].max(initial=0.0))
    radius, rods = THIN * longest, dict[int, list[Mesh]]()
    for link in np.unique(rigid[1:]).tolist():
        inside = rigid == link
        own = [(geom, mesh) for geom, mesh in shown if inside[geom.body]]
        if any(not geom.collides for geom, _ in own):
            continue
        back = quat[link] * (1.0, -1.0, -1.0, -1.0)
        origins = rotations.rotate(back, position - position[link])
        turns = rotations.multiply(back, quat)
        boxes = [mesh.placed(origins[geom.body], turns[geom.body]).vertices for geom, mesh in own]
        ends = origins[[child for child in np.unique(rigid[1:]).tolist() if inside[body.parent[child]]]]
        is_turned = any(body.joint_type[joint] != JointType.FREE for joint in np.flatnonzero(body.joint_body == link))
        for begin, end in _joins(ends, origins[inside], boxes, radius, is_turned=is_turned):
            length = float(np.linalg.norm(end - begin))
            if length > THINNEST:
                rod = shape_mesh(ShapeKind.CAPSULE, (radius, 0.5 * length, 0.0), around=THIN_AROUND)
                turn = rotations.shortest_arc(np.array([0.0, 0.0, 1.0]), end - begin)
                rods.setdefault(link, []).append(rod.placed(0.5 * (begin + end), turn))
    return rods


def _joins(
    ends: FloatArray, fixed: FloatArray, shapes: Sequence[FloatArray], radius: float, *, is_turned: bool
) -> list[tuple[FloatArray, FloatArray]]:
    """Ends of a link's rods, (n, 3) m in its frame. ends: joints of children; fixed: origins of links fixed to it;
    shapes: points of each. is_turned: a joint turns it about its origin."""
    begin = np.zeros(3)
    boxes = np.array([[points.min(axis=0), points.max(axis=0)] for points in shapes]).reshape(-1, 2, 3)

    def is_reached(point: FloatArray) -> bool:
        return bool(((boxes[:, 0] - radius < point) & (point < boxes[:, 1] + radius)).all(axis=1).any())

    points = boxes.reshape(-1, 3) if len(boxes) else ends
    middle = 0.5 * (points.min(axis=0) + points.max(axis=0)) if len(points) else begin
    if not is_turned:  # its origin may be anywhere, as on the ground
        return [(middle, end) for end in ends if not is_reached(end)]
    if len(boxes) and not is_reached(begin):  # its shape is off its joint
        ends = np.vstack([ends, middle])
    elif not len(boxes) and not len(ends):
        ends = fixed[np.argmax(np.linalg.norm(fixed, axis=1))][None]
    return [(begin, end) for end in ends if not (is_reached(begin) and is_reached(end))]


def _depths(body: BodyModel) -> FloatArray:
    depths = np.zeros(len(body.parent))
    for link in range(2, len(depths)):
        parent = body.parent[link]
        depths[link] = depths[parent] + (np.linalg.norm(body.body_pos[link]) if parent > 0 else 0.0)
    return depths


def _simple_mesh(geom: Geom, around: int) -> Mesh | None:
    """A geom in its own frame; None for planes and height fields."""
    size = geom.size.tolist()
    middle = sorted(size)[1] if geom.kind == "ellipsoid" else size[0]  # a radius where it is round
    around = min(around, max(4 * round(0.25 * around * (middle / FINE) ** 0.5), DETAILS[-2]))
    if geom.kind == "ellipsoid":
        ball = shape_mesh(ShapeKind.CAPSULE, (1.0, 0.0, 0.0), around=around)
        return Mesh(geom.size * ball.vertices, ball.faces)
    if geom.kind == "sphere":
        return shape_mesh(ShapeKind.CAPSULE, (size[0], 0.0, 0.0), around=around)
    if geom.kind == "box":
        return _rounded(geom.size, around)
    if geom.kind in ("capsule", "cylinder"):
        return shape_mesh(ShapeKind[geom.kind.upper()], size, around=around)
    return None


LEAST_M = 0.05
LEFT, RIGHT, MIDDLE = "#d55e00", "#0072b2", "#b0b0b0"
"""Colours of the sides and the middle of a body, of Okabe and Ito's palette."""
OBSTACLE, OBSERVER = "#b0967a", "#9a5b86"
"""Colours of the scene's shapes and of active observers."""
SIDES = {"l_": LEFT, "r_": RIGHT}
"""Colours by the first letters of names."""


def side_colours(body: BodyModel, named: Mapping[str, int]) -> tuple[str, ...]:
    """Colour of each link, by the side of its limb. named: links by the names of frames on them."""
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
    """A body to draw. links (k,): with meshes. meshes (m,): in their links' frames; owners (m,): rows of links; colours
    (m, 3): 0 to 1. height: m."""

    body: BodyModel
    links: IntArray
    meshes: tuple[Mesh, ...]
    owners: IntArray
    colours: FloatArray
    height: float
    kinematics: "_solver.Body"

    def as_json(self) -> dict[str, Any]:
        """Data of `bodies.js`. Links are numbered as in `poses`."""
        return {"height": round(self.height, 4)} | meshes_json(self.meshes, self.colours.tolist(), self.owners.tolist())

    def poses(self, q: FloatArray) -> FloatArray:
        """Poses (T, k, 7) of its links in postures (T, nq): position, m, and wxyz."""
        forward = [self.kinematics.forward(np.ascontiguousarray(posture)) for posture in q]
        return np.array([np.column_stack(pose)[self.links] for pose in forward])

    def com(self, q: FloatArray) -> FloatArray:
        """Centre of mass (T, 3) m in postures (T, nq)."""
        return self.kinematics.centre_of_mass(np.ascontiguousarray(q))


def meshes_json(
    meshes: Iterable[Mesh], colours: Iterable[Sequence[float]], links: Iterable[int] | None = None
) -> dict[str, Any]:
    """Data of `bodies.js`: vertices to 0.1 mm. links: numbers of poses; None if each mesh has its own."""
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
    """Data of `bodies.js` for meshes of one colour."""
    return meshes_json(meshes, repeat(rgb(colour)))


def rgb(colour: str) -> list[float]:
    """Red, green and blue, 0 to 1, of a colour such as `#d55e00`."""
    return [int(colour[at : at + 2], 16) / 255.0 for at in (1, 3, 5)]


def solid_body(body: BodyModel, named: Mapping[str, int] | None = None) -> SolidBody:
    """Body in the colours of `side_colours`. named: None for the names of links."""
    if named is None:
        named = {name: link for link, name in enumerate(body.body_names) if link > 0}
    meshes, sides, kinematics = link_meshes(body), side_colours(body, named), body.solver_body()
    shades = [own if own and (sides[link] == MIDDLE or (link, None) in meshes) else rgb(sides[link])
              for link, own in meshes]  # fmt: skip
    links, owners = np.unique([link for link, _ in meshes], return_inverse=True)
    position, quat = kinematics.forward(body.qpos0)
    heights = [mesh.placed(position[link], quat[link]).vertices[:, 2] for (link, _), mesh in meshes.items()]
    height = max(float(np.ptp(np.concatenate(heights))), LEAST_M) if heights else LEAST_M
    links, owners = links.astype(np.int64), owners.astype(np.int64)
    return SolidBody(body, links, tuple(meshes.values()), owners, np.array(shades), height, kinematics)
