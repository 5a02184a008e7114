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
    """All that is behind a plane."""

    point: Point = (0.0, 0.0, 0.0)
    """[m] Of its plane."""
    normal: Direction
    """Points out of the solid; its length does not matter."""


class ObstacleShape(SolidShape):
    """Exactly one of the shapes: those of a profile's observers, and the half-space."""

    half_space: Annotated[HalfSpace, Keys] | None = None
    """All that is behind a plane."""


def _one_shape(shape: ObstacleShape) -> ObstacleShape:
    if len(shape.model_fields_set) != 1:
        allowed = "exactly one of: " + ", ".join(ObstacleShape.model_fields)
        raise PydanticCustomError("shape", "not one shape", {"allowed": allowed})
    return shape


class Place(Schema):
    """Where an obstacle's own frame is, in the frame that the obstacle names."""

    pos: Point = (0.0, 0.0, 0.0)
    """[m] Of the obstacle's origin."""
    quat: Quaternion = (1.0, 0.0, 0.0, 0.0)
    """Of its axes, wxyz."""


class PathPoint(Schema):
    """Where an obstacle's own frame is at a time."""

    time: Annotated[Instant, BeforeValidator(_timed)] = Field(default=None, validate_default=True)
    """[s] From the start, rising from point to point."""
    pos: Point
    """[m] Of the obstacle's origin."""
    quat: Quaternion = (1.0, 0.0, 0.0, 0.0)
    """Of its axes, wxyz."""


class Obstacle(Schema):
    """Something that the robot must not touch. Velocities hold between `from` and `until`; a `path` takes the place of
    both.
    """

    shape: Annotated[ObstacleShape, BeforeValidator(_shape_mapping), AfterValidator(_one_shape)]
    """Exactly one, in the obstacle's own frame."""
    frame: Literal["world", "stand"] = "world"
    """What `at`, `path`, `velocity` and live updates are written in: the world, or the robot's stand."""
    at: Annotated[Place, Keys] = Place()
    """Where the obstacle's own frame is at the start."""
    influence: Size = 0.1
    """[m] Distance at which observers begin to yield."""
    margin: Distance = 0.01
    """[m] Distance that they keep."""
    ground: Switch = False
    """The robot stands on it: its soles do not keep away from it, everything else does."""
    velocity: tuple[Speed, Speed, Speed] | None = None
    """[m/s] Of the obstacle's origin, along the axes of `frame`."""
    angular_velocity: tuple[Turn, Turn, Turn] | None = None
    """[rad/s] About those axes."""
    start: Instant = Field(default=0.0, alias="from")
    """[s] When it begins to move."""
    until: Instant | None = None
    """[s] When it stops; absent: never."""
    path: Annotated[tuple[Annotated[PathPoint, Keys], ...], Field(max_length=10_000)] | None = None
    """Poses at times, instead of `at` and velocities."""
    loop: Switch = False
    """The path again and again."""


Obstacles = Annotated[dict[Name, Annotated[Obstacle, Keys]], Field(max_length=256)]
"""Obstacles by name."""
