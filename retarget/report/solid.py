"""Bodies as solids in pictures: their triangles, lit from above, drawn from the farthest to the nearest."""

import numpy as np

from retarget import rotations
from retarget.model.meshes import SolidBody
from retarget.types import FloatArray

AZIMUTH, ELEVATION = np.deg2rad(35.0), np.deg2rad(12.0)
"""Where the viewer stands: about the vertical from the way the body faces, and above the horizon."""
TO_VIEWER = np.array([np.cos(AZIMUTH) * np.cos(ELEVATION), np.sin(AZIMUTH) * np.cos(ELEVATION), np.sin(ELEVATION)])
LIGHT = np.array([0.5, -0.1, 0.86])
DARKEST = 0.6
"""Brightness of what the light does not reach."""


def facets_of(solid: SolidBody, q: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """The f triangles of a body in postures (p, nq): corners (p, f, 3, 3) m and normals (p, f, 3) in the world, and
    colours (f, 3)."""
    local = np.concatenate([mesh.vertices[mesh.faces] for mesh in solid.meshes])
    owner = np.repeat(np.arange(len(solid.meshes)), [len(mesh.faces) for mesh in solid.meshes])
    poses = solid.poses(q)[:, owner, None]
    corners = poses[..., :3] + rotations.rotate(poses[..., 3:], local)
    normal = np.cross(corners[:, :, 1] - corners[:, :, 0], corners[:, :, 2] - corners[:, :, 0])
    normal /= np.maximum(np.linalg.norm(normal, axis=-1, keepdims=True), 1e-12)
    return corners, normal, solid.colours[owner]


def lit(corners: FloatArray, normal: FloatArray, colour: FloatArray) -> tuple[FloatArray, FloatArray]:
    """The facets that are seen of a body that faces x, the nearest last: outlines (s, 3, 2), across and up, and colours
    (s, 3). corners (f, 3, 3), normal (f, 3), colour (f, 3)."""
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
