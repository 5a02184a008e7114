"""Shapes of a scene as arrays for the solver, each in its canonical frame: at its centre, z along its length."""

from dataclasses import dataclass, replace
from enum import IntEnum
from typing import Any

import numpy as np
from numpy.typing import NDArray

from retarget.model.body_file import engine
from retarget.rotations import Quat, Vector, arc, length, minus, plus, product
from retarget.schema.scene import ObstacleShape, Pose, Scene, unit
from retarget.schema.shapes import LineSegment, SolidShape
from retarget.types import FloatArray

UP: Vector = (0.0, 0.0, 1.0)
DOWN: Vector = (0.0, 0.0, -1.0)
UP_TO_DOWN: Quat = (0.0, 1.0, 0.0, 0.0)
"""Unit vectors, world, and the half turn about x between them, wxyz."""


class ShapeKind(IntEnum):
    """Codes of the solver. Spheres are capsules of half length 0, segments of radius 0."""

    CAPSULE = 0
    CYLINDER = 1
    BOX = 2
    HALF_SPACE = 3


@dataclass(frozen=True, eq=False)
class SceneShapes:
    """k obstacles in the order of the file.

    kinds (k,): see `ShapeKind`. sizes (k, 3) m: radius, half length, 0 of capsules and cylinders; half sizes of boxes;
    0 of half-spaces, solid at z <= 0. influence, margin (k,) m. ground (k,): True if soles stand on it.
    """

    names: tuple[str, ...]
    kinds: NDArray[np.int64]
    sizes: FloatArray
    influence: FloatArray
    margin: FloatArray
    ground: NDArray[np.bool_]

    def with_margin(self, margin: float | None) -> "SceneShapes":
        """Shapes with another margin, m; None: their own."""
        return self if margin is None else replace(self, margin=np.full_like(self.margin, margin))


def mujoco_geom(kind: ShapeKind, sizes: FloatArray, *, thinnest: float) -> tuple[Any, FloatArray]:
    """MuJoCo's type and size of a canonical shape with sizes (3,) m, at least `thinnest` m thick."""
    types = engine().mjtGeom
    if kind is ShapeKind.CAPSULE and sizes[1] == 0.0:
        return types.mjGEOM_SPHERE, np.maximum(sizes, thinnest)
    if kind is ShapeKind.HALF_SPACE:
        return types.mjGEOM_PLANE, np.array([0.0, 0.0, 1.0])
    kinds = {
        ShapeKind.CAPSULE: types.mjGEOM_CAPSULE,
        ShapeKind.CYLINDER: types.mjGEOM_CYLINDER,
        ShapeKind.BOX: types.mjGEOM_BOX,
    }
    return kinds[kind], np.maximum(sizes, thinnest)


def scene_shapes(scene: Scene) -> SceneShapes:
    """Shapes of a scene."""
    obstacles = scene.obstacles.values()
    shapes = [canonical(obstacle.shape) for obstacle in obstacles]
    return SceneShapes(
        names=tuple(scene.obstacles),
        kinds=np.array([kind for kind, _, _ in shapes], dtype=np.int64),
        sizes=np.array([size for _, size, _ in shapes], dtype=float).reshape(-1, 3),
        influence=np.array([obstacle.influence for obstacle in obstacles], dtype=float),
        margin=np.array([obstacle.margin for obstacle in obstacles], dtype=float),
        ground=np.array([obstacle.ground for obstacle in obstacles], dtype=bool),
    )


def canonical(shape: SolidShape) -> tuple[ShapeKind, Vector, Pose]:
    """Kind, sizes (3,) m, and T_obstacle_shape of the canonical frame in the obstacle's own, or on its link."""
    if shape.segment is not None:
        return ShapeKind.CAPSULE, (0.0, _half(shape.segment), 0.0), _along(shape.segment)
    if shape.capsule is not None:
        return ShapeKind.CAPSULE, (shape.capsule.radius, _half(shape.capsule), 0.0), _along(shape.capsule)
    if shape.cylinder is not None:
        return ShapeKind.CYLINDER, (shape.cylinder.radius, _half(shape.cylinder), 0.0), _along(shape.cylinder)
    if shape.sphere is not None:
        return ShapeKind.CAPSULE, (shape.sphere.radius, 0.0, 0.0), Pose(shape.sphere.at)
    if shape.box is not None:
        return ShapeKind.BOX, shape.box.size, Pose(shape.box.pos, unit(shape.box.quat))
    if isinstance(shape, ObstacleShape) and shape.half_space is not None:
        return ShapeKind.HALF_SPACE, (0.0, 0.0, 0.0), Pose(shape.half_space.point, _turn_to(shape.half_space.normal))
    raise AssertionError("the reader lets no obstacle without a shape through")


def _half(line: LineSegment) -> float:
    return 0.5 * length(minus(line.end, line.start))


def _along(line: LineSegment) -> Pose:
    x, y, z = plus(line.start, line.end)
    return Pose((0.5 * x, 0.5 * y, 0.5 * z), _turn_to(minus(line.end, line.start)))


def _turn_to(direction: Vector) -> Quat:
    """A turn of z to a direction, from the nearer of up and down, as an arc near pi is ill-conditioned."""
    return arc(UP, direction) if direction[2] >= 0.0 else product(arc(DOWN, direction), UP_TO_DOWN)
