"""Obstacles of a scene beside the geoms of a body, in one MuJoCo model that measures distances and nothing else."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from retarget.metrics.moving_geoms import MovingGeoms
from retarget.rotations import FloatArray, to_matrix
from retarget.scene_motion import SceneState
from retarget.scene_shapes import SceneShapes, ShapeKind
from retarget.solid_shapes import MAX_COORDINATE

__all__ = ["ObstacleTracks", "SceneModel", "obstacle_tracks", "scene_model"]

LINE_M = 1e-12
"""Radius, m, of a segment: MuJoCo has no shapes without thickness."""
EVERYWHERE = 1.0
"""Size of a half-space's plane; a plane has no end, whatever is said."""


@dataclass(frozen=True, eq=False)
class SceneModel:
    """model: geoms without links. body (g,) and obstacles (k,): numbers of the geoms.

    shift (g, 3) m, turn (g, 3, 3): where each geom's frame is in that of the body's own model. A mesh is laid anew
    along its axes when it is compiled.
    """

    model: Any
    body: NDArray[np.int64]
    obstacles: NDArray[np.int64]
    shift: FloatArray
    turn: FloatArray

    def placed(self, geoms: MovingGeoms) -> tuple[FloatArray, FloatArray]:
        """Positions (T, g, 3) m and matrices (T, g, 9), world, of the geoms of the body in this model."""
        turn = geoms.matrix.reshape(*geoms.matrix.shape[:2], 3, 3)
        position = geoms.position + (turn @ self.shift[..., None])[..., 0]
        return position, (turn @ self.turn).reshape(geoms.matrix.shape)


@dataclass(frozen=True, eq=False)
class ObstacleTracks:
    """k obstacles at T times: position (T, k, 3) m and matrix (T, k, 9), world; radius (k,) m as of `MovingGeoms`."""

    position: FloatArray
    matrix: FloatArray
    radius: FloatArray


def scene_model(source: Any, geoms: NDArray[np.int64], shapes: SceneShapes) -> SceneModel:
    """Copy `geoms` (g,) of the compiled model `source`, and add the obstacles."""
    import mujoco

    spec = mujoco.MjSpec()
    for number, geom in enumerate(geoms):
        size, kind, mesh = source.geom_size[geom], source.geom_type[geom], source.geom_dataid[geom]
        if kind == mujoco.mjtGeom.mjGEOM_MESH:
            begin, count = source.mesh_vertadr[mesh], source.mesh_vertnum[mesh]
            vertices = source.mesh_vert[begin : begin + count]
            spec.add_mesh(name=f"mesh {number}", uservert=vertices.ravel().tolist())
            spec.worldbody.add_geom(name=f"body {number}", type=kind, meshname=f"mesh {number}")
        else:
            spec.worldbody.add_geom(name=f"body {number}", type=kind, size=size)
    for number, (code, sizes) in enumerate(zip(shapes.kinds, shapes.sizes, strict=True)):
        kind, size = _primitive(mujoco, ShapeKind(int(code)), sizes)
        spec.worldbody.add_geom(name=f"obstacle {number}", type=kind, size=size)
    model = spec.compile()
    body = np.array([model.geom(f"body {k}").id for k in range(len(geoms))], dtype=np.int64)
    obstacles = np.array([model.geom(f"obstacle {k}").id for k in range(len(shapes.names))], dtype=np.int64)
    return SceneModel(model, body, obstacles, *_laid_anew(mujoco, model, body))


def obstacle_tracks(scene: SceneState, times: FloatArray) -> ObstacleTracks:
    """Where the obstacles are at times (T,), s on the clock of the scene."""
    count = len(scene.shapes.names)
    position, quat = np.empty((len(times), count, 3)), np.empty((len(times), count, 4))
    for row, time in enumerate(times):
        poses = scene.at(float(time))
        position[row], quat[row] = poses.position, poses.quat
    return ObstacleTracks(position, to_matrix(quat).reshape(len(times), count, 9), _radii(scene.shapes))


def _radii(shapes: SceneShapes) -> FloatArray:
    """Of balls (k,) about the obstacles, m."""
    radius = np.linalg.norm(shapes.sizes, axis=1)
    capsules, planes = shapes.kinds == ShapeKind.CAPSULE, shapes.kinds == ShapeKind.HALF_SPACE
    radius[capsules] = shapes.sizes[capsules].sum(axis=1)
    radius[planes] = MAX_COORDINATE
    return np.asarray(radius)


def _primitive(mujoco: Any, kind: ShapeKind, sizes: FloatArray) -> tuple[Any, list[float]]:
    """MuJoCo's type and size of a canonical shape."""
    types, (first, second, third) = mujoco.mjtGeom, sizes.tolist()
    if kind is ShapeKind.CAPSULE:
        if second == 0.0:
            return types.mjGEOM_SPHERE, [first, 0.0, 0.0]
        return types.mjGEOM_CAPSULE, [max(first, LINE_M), second, 0.0]
    if kind is ShapeKind.CYLINDER:
        return types.mjGEOM_CYLINDER, [first, second, 0.0]
    if kind is ShapeKind.BOX:
        return types.mjGEOM_BOX, [first, second, third]
    return types.mjGEOM_PLANE, [EVERYWHERE] * 3


def _laid_anew(mujoco: Any, model: Any, geoms: NDArray[np.int64]) -> tuple[FloatArray, FloatArray]:
    """Frames (g, 3) m and (g, 3, 3) of the geoms in the frames that they were copied from."""
    shift, turn = np.zeros((len(geoms), 3)), np.tile(np.eye(3), (len(geoms), 1, 1))
    for k, geom in enumerate(geoms):
        if model.geom_type[geom] == mujoco.mjtGeom.mjGEOM_MESH:
            mesh, matrix = model.geom_dataid[geom], np.zeros(9)
            mujoco.mju_quat2Mat(matrix, model.mesh_quat[mesh])
            shift[k], turn[k] = model.mesh_pos[mesh], matrix.reshape(3, 3)
    return shift, turn
