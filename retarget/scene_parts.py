"""Models of the entries of a scene: shapes, places and motions of obstacles. SI units.

A shape is written in the obstacle's own frame, which `at`, `path` or a live update places in the world or on the stand.
"""

from typing import Annotated, Any, Literal

from pydantic import AfterValidator, BeforeValidator, Field
from pydantic_core import PydanticCustomError

from retarget.schema import Name, Quaternion, Schema, Switch
from retarget.solid_shapes import Distance, Keys, Point, Size, SolidShape

__all__ = [
    "MAX_SPEED",
    "MAX_TURN",
    "HalfSpace",
    "Obstacle",
    "ObstacleShape",
    "Obstacles",
    "PathPoint",
    "Place",
]

MAX_SPEED = 100.0
"""Fastest obstacle of a file, m/s."""
MAX_TURN = 100.0
"""Fastest turn of an obstacle of a file, rad/s."""
MIN_NORMAL = 1e-6
"""Shortest vector that still has a direction."""

Speed = Annotated[float, Field(strict=True, allow_inf_nan=False, ge=-MAX_SPEED, le=MAX_SPEED)]
Turn = Annotated[float, Field(strict=True, allow_inf_nan=False, ge=-MAX_TURN, le=MAX_TURN)]
Instant = Annotated[float, Field(strict=True, allow_inf_nan=False, ge=0, le=1e6)]


def _shape_mapping(value: Any) -> Any:
    if not isinstance(value, dict):
        allowed = "one shape with its measures, such as {sphere: {radius: 0.1}}"
        raise PydanticCustomError("mapping", "not a shape", {"allowed": allowed})
    return value


def _direction(value: tuple[float, float, float]) -> tuple[float, float, float]:
    if sum(part * part for part in value) < MIN_NORMAL**2:
        raise PydanticCustomError("zero", "a direction without length", {"allowed": "such as [0, 0, 1]"})
    return value


def _timed(value: Any) -> Any:
    if value is None:
        allowed = "time: seconds from the start, rising from point to point"
        raise PydanticCustomError("time", "a moving obstacle without time", {"allowed": allowed})
    return value


Direction = Annotated[Point, AfterValidator(_direction)]


class HalfSpace(Schema):
    """All that is behind a plane: a point of it, m, and the normal that points out of the solid, of any length."""

    point: Point = (0.0, 0.0, 0.0)
    normal: Direction


class ObstacleShape(SolidShape):
    """Exactly one of the shapes: those of a profile's observers, and the half-space."""

    half_space: Annotated[HalfSpace, Keys] | None = None


def _one_shape(shape: ObstacleShape) -> ObstacleShape:
    if len(shape.model_fields_set) != 1:
        allowed = "exactly one of: " + ", ".join(ObstacleShape.model_fields)
        raise PydanticCustomError("shape", "not one shape", {"allowed": allowed})
    return shape


class Place(Schema):
    """Where an obstacle's own frame is: position (3,) m and quat wxyz, in the frame that the obstacle names."""

    pos: Point = (0.0, 0.0, 0.0)
    quat: Quaternion = (1.0, 0.0, 0.0, 0.0)


class PathPoint(Schema):
    """Where an obstacle's own frame is at a time, s from the start."""

    time: Annotated[Instant, BeforeValidator(_timed)] = Field(default=None, validate_default=True)
    pos: Point
    quat: Quaternion = (1.0, 0.0, 0.0, 0.0)


class Obstacle(Schema):
    """Something that the robot must not touch.

    frame: what `at`, `path`, `velocity` and live updates are written in: the world, or the robot's stand. influence:
    distance at which observers begin to yield; margin: distance that they keep. Both m.
    velocity (3,) m/s of the obstacle's origin and angular_velocity (3,) rad/s, along the axes of `frame`, between the
    times `from` and `until`, s; path: poses at times instead, again and again with `loop`.
    """

    shape: Annotated[ObstacleShape, BeforeValidator(_shape_mapping), AfterValidator(_one_shape)]
    frame: Literal["world", "stand"] = "world"
    at: Annotated[Place, Keys] = Place()
    influence: Size = 0.1
    margin: Distance = 0.01
    velocity: tuple[Speed, Speed, Speed] | None = None
    angular_velocity: tuple[Turn, Turn, Turn] | None = None
    start: Instant = Field(default=0.0, alias="from")
    until: Instant | None = None
    path: Annotated[tuple[Annotated[PathPoint, Keys], ...], Field(max_length=10_000)] | None = None
    loop: Switch = False


Obstacles = Annotated[dict[Name, Annotated[Obstacle, Keys]], Field(max_length=256)]
"""Obstacles by name."""
