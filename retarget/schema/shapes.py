"""Bounded shapes of observers and obstacles. SI units."""

from typing import Annotated, Self

from pydantic import Field, model_validator
from pydantic_core import PydanticCustomError

from retarget.schema.strict_models import Quaternion, Schema

MAX_COORDINATE = 1000.0
"""[m] Largest coordinate and size, beyond any room, so that no distance overflows."""

Coordinate = Annotated[float, Field(strict=True, allow_inf_nan=False, ge=-MAX_COORDINATE, le=MAX_COORDINATE)]
Size = Annotated[float, Field(strict=True, allow_inf_nan=False, gt=0, le=MAX_COORDINATE)]
Distance = Annotated[float, Field(strict=True, allow_inf_nan=False, ge=0, le=MAX_COORDINATE)]
Point = tuple[Coordinate, Coordinate, Coordinate]


class LineSegment(Schema):
    """A line without thickness between two points."""

    start: Point = Field(alias="from")
    """[m] One end."""
    end: Point = Field(alias="to")
    """[m] The other."""


class Rod(LineSegment):
    """A line with a radius: a capsule (round ends) or a cylinder (flat ends)."""

    radius: Size
    """[m] Radius around the line."""


class Ball(Schema):
    """A ball."""

    at: Point = (0.0, 0.0, 0.0)
    """[m] Its centre."""
    radius: Size
    """[m] Its radius."""


class Box(Schema):
    """A box."""

    pos: Point = (0.0, 0.0, 0.0)
    """[m] Its centre."""
    quat: Quaternion = (1.0, 0.0, 0.0, 0.0)
    """Orientation, wxyz."""
    size: tuple[Size, Size, Size]
    """[m] Half of its sizes along its own x, y, z."""


class SolidShape(Schema):
    """Exactly one of the shapes."""

    segment: LineSegment | None = None
    """A line without thickness."""
    capsule: Rod | None = None
    """A line with a radius and round ends."""
    cylinder: Rod | None = None
    """The same with flat ends."""
    sphere: Ball | None = None
    """A ball."""
    box: Box | None = None
    """A box."""

    @property
    def label(self) -> str:
        """Name of the shape in a file."""
        return next(iter(self.model_fields_set))

    @model_validator(mode="after")
    def _one_shape(self) -> Self:
        if len(self.model_fields_set) != 1:
            shapes = ", ".join(type(self).model_fields)
            raise PydanticCustomError("shape", "not one shape", {"allowed": f"exactly one of: {shapes}"})
        return self
