"""Models of bounded shapes: of the observers of a profile and of the obstacles of a scene. SI units."""

from typing import Annotated, Any

from pydantic import BeforeValidator, Field
from pydantic_core import PydanticCustomError

from retarget.schema import Quaternion, Schema

__all__ = [
    "MAX_COORDINATE",
    "Ball",
    "Box",
    "Coordinate",
    "Distance",
    "Keys",
    "Line",
    "Point",
    "Rod",
    "Size",
    "SolidShape",
]

MAX_COORDINATE = 1000.0
"""Largest coordinate and size, m: far beyond any room, so that no distance ever overflows."""

Coordinate = Annotated[float, Field(strict=True, allow_inf_nan=False, ge=-MAX_COORDINATE, le=MAX_COORDINATE)]
Size = Annotated[float, Field(strict=True, allow_inf_nan=False, gt=0, le=MAX_COORDINATE)]
Distance = Annotated[float, Field(strict=True, allow_inf_nan=False, ge=0, le=MAX_COORDINATE)]
Point = tuple[Coordinate, Coordinate, Coordinate]


def _mapping(value: Any) -> Any:
    if not isinstance(value, dict):
        raise PydanticCustomError("mapping", "keys are missing", {"allowed": "a mapping of keys"})
    return value


Keys = BeforeValidator(_mapping)


class Line(Schema):
    """A line without thickness between two points, m."""

    start: Point = Field(alias="from")
    end: Point = Field(alias="to")


class Rod(Line):
    """A line with a radius, m: a capsule (round ends) or a cylinder (flat ends)."""

    radius: Size


class Ball(Schema):
    """A ball: centre and radius, m."""

    at: Point = (0.0, 0.0, 0.0)
    radius: Size


class Box(Schema):
    """A box: centre (3,) m, quat wxyz, half sizes (3,) m along its own x, y, z."""

    pos: Point = (0.0, 0.0, 0.0)
    quat: Quaternion = (1.0, 0.0, 0.0, 0.0)
    size: tuple[Size, Size, Size]


class SolidShape(Schema):
    """Exactly one of the shapes, which whoever takes it checks."""

    segment: Annotated[Line, Keys] | None = None
    capsule: Annotated[Rod, Keys] | None = None
    cylinder: Annotated[Rod, Keys] | None = None
    sphere: Annotated[Ball, Keys] | None = None
    box: Annotated[Box, Keys] | None = None

    @property
    def label(self) -> str:
        """Its name in a file."""
        return next(iter(self.model_fields_set))
