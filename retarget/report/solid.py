"""Bodies as solids: the shapes of their files as facets, lit from above, drawn from the farthest to the nearest."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from matplotlib.colors import to_rgb

from retarget import rotations
from retarget.model.body import BodyModel, Geom
from retarget.types import FloatArray, IntArray

LEFT, RIGHT, MIDDLE = "#d55e00", "#0072b2", "#b0b0b0"
"""Of Okabe and Ito's palette: the sides of a body, and what is between."""
ROUND, CAP = 20, 6
"""Facets around a capsule, and from the edge of its cap to the top."""
THIN = 0.012
"""Radius of what joins links, in the sum of their lengths."""
AZIMUTH, ELEVATION = np.deg2rad(35.0), np.deg2rad(12.0)
"""Where the viewer stands: about the vertical from the way the body faces, and above the horizon."""
TO_VIEWER = np.array([np.cos(AZIMUTH) * np.cos(ELEVATION), np.sin(AZIMUTH) * np.cos(ELEVATION), np.sin(ELEVATION)])
LIGHT = np.array([0.5, -0.1, 0.86])
DARKEST = 0.6
"""Brightness of what the light does not reach."""


@dataclass(frozen=True, eq=False)
class Facets:
    """f facets. corners (f, 4, 3) m and normal (f, 3), in the frame of the link (f,) each is on; colour (f, 3)."""

    corners: FloatArray
    normal: FloatArray
    link: IntArray
    colour: FloatArray

    def placed(self, position: FloatArray, quat: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Corners (f, 4, 3) m and normals (f, 3) in the world. position (nb, 3) m, quat (nb, 4) wxyz: of all links."""
        turn = quat[self.link]
        corners = position[self.link][:, None] + rotations.rotate(turn[:, None], self.corners)
        return corners, rotations.rotate(turn, self.normal)


def facets_of(body: BodyModel, sides: dict[int, str]) -> Facets:
    """The shapes of a body, and what joins its links where shapes leave gaps. sides: `LEFT` or `RIGHT` of the links
    that have one."""
    shapes = [(geom.body, surface) for geom in body.geoms if geom.body > 0 for surface in _surfaces(geom)]
    shapes += _joints(body)
    corners = np.concatenate([surface for _, surface in shapes])
    first, second = corners[:, 2] - corners[:, 0], corners[:, 3] - corners[:, 1]
    normal = np.cross(first, second)
    normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-12)
    link = np.concatenate([np.full(len(surface), owner) for owner, surface in shapes])
    colour = np.array([to_rgb(sides.get(owner, MIDDLE)) for owner in link.tolist()])
    return Facets(corners, normal, link, colour)


def sides_of(body: BodyModel, ends: dict[str, list[int]], middle: list[int]) -> dict[int, str]:
    """The side of each link of the chains that carry the links `ends`, by colour, and of what hangs from them. middle:
    links whose chains to the root have no side."""
    between = {link for end in middle for link in body.chain_to_root(end)}
    found: dict[int, str] = {}
    for colour, links in ends.items():
        found |= {link: colour for end in links for link in body.chain_to_root(end) if link not in between}
    for link, parent in enumerate(body.parent.tolist()):  # a parent comes before its children
        if link not in found and link not in between and parent in found:
            found[link] = found[parent]
    return found


def lit(corners: FloatArray, normal: FloatArray, colour: FloatArray) -> tuple[FloatArray, FloatArray]:
    """The facets that are seen of a body that faces x, the nearest last: outlines (s, 4, 2), across and up, and colours
    (s, 3). corners (f, 4, 3), normal (f, 3), colour (f, 3)."""
    seen = normal @ TO_VIEWER > 0.0
    across, up, near = project(corners[seen])
    light = DARKEST + (1.0 - DARKEST) * np.maximum(normal[seen] @ LIGHT, 0.0)[:, None]
    order = np.argsort(near.mean(axis=1))
    return np.stack([across, up], axis=-1)[order], np.minimum(colour[seen] * light, 1.0)[order]


def project(points: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Across and up in the picture, and how near to the viewer, of points (..., 3): parallel projection."""
    # Across is to the viewer's right.
    across = -np.sin(AZIMUTH) * points[..., 0] + np.cos(AZIMUTH) * points[..., 1]
    before = np.cos(AZIMUTH) * points[..., 0] + np.sin(AZIMUTH) * points[..., 1]
    up = points[..., 2] * np.cos(ELEVATION) - before * np.sin(ELEVATION)
    return across, up, before * np.cos(ELEVATION) + points[..., 2] * np.sin(ELEVATION)


def _surfaces(geom: Geom) -> Iterator[FloatArray]:
    """The facets (f, 4, 3) of a shape, in the frame of its link; none of a mesh or a plane."""
    size = geom.size.tolist()
    if geom.kind == "box":
        surface = _box(geom.size)
    elif geom.kind == "cylinder":
        surface = _turned([(0.0, -size[1]), (size[0], -size[1]), (size[0], size[1]), (0.0, size[1])])
    elif geom.kind in ("sphere", "capsule"):
        surface = _capsule(size[0], size[1] if geom.kind == "capsule" else 0.0)
    else:
        return
    yield geom.position + rotations.rotate(geom.quat, surface)


def _box(half: FloatArray) -> FloatArray:
    signs = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]], dtype=np.float64)
    sides = []
    for axis in range(3):
        for sign in (-1.0, 1.0):
            side = np.empty((4, 3))
            side[:, axis] = sign
            side[:, [(axis + 1) % 3, (axis + 2) % 3]] = signs if sign > 0.0 else signs[::-1]
            sides.append(side)
    return np.asarray(np.array(sides) * half)


def _capsule(radius: float, half: float) -> FloatArray:
    """A capsule along z; a sphere where `half` is 0."""
    angle = np.linspace(0.0, 0.5 * np.pi, CAP + 1)
    cap = [(radius * float(np.sin(a)), half + radius * float(np.cos(a))) for a in angle]
    return _turned([*((r, -z) for r, z in cap), *reversed(cap)])


def _turned(profile: list[tuple[float, float]]) -> FloatArray:
    """The facets of what a line of (radius, height) m from below to above sweeps about z."""
    line = np.array(profile)
    angle = np.linspace(0.0, 2.0 * np.pi, ROUND + 1)
    rings = np.stack(
        [line[:, :1] * np.cos(angle), line[:, :1] * np.sin(angle), np.repeat(line[:, 1:], ROUND + 1, axis=1)], axis=-1
    )
    return np.stack([rings[:-1, :-1], rings[:-1, 1:], rings[1:, 1:], rings[1:, :-1]], axis=2).reshape(-1, 4, 3)


def _joints(body: BodyModel) -> Iterator[tuple[int, FloatArray]]:
    """A thin capsule from each link to its children; all that is known of a body whose file has only meshes."""
    reach = float(np.linalg.norm(body.body_pos, axis=1).sum())
    for child in range(1, len(body.parent)):
        along, length = body.body_pos[child], float(np.linalg.norm(body.body_pos[child]))
        if body.parent[child] > 0 and length > 1e-6:
            turn = rotations.shortest_arc(np.array([0.0, 0.0, 1.0]), along)
            yield int(body.parent[child]), 0.5 * along + rotations.rotate(turn, _capsule(THIN * reach, 0.5 * length))
