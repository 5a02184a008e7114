"""How the heading is told from the sensors: weights of what hints at it. The `heading` section of a priority file."""

from typing import Annotated

from pydantic import AfterValidator, Field

from retarget.schema import Interval, Name, NotNegative, Positive, Schema

__all__ = ["HeadingSettings"]


def _not_negative(pair: tuple[float, float]) -> tuple[float, float]:
    if pair[0] < 0.0:
        raise ValueError("a speed is not negative")
    return pair


class HeadingSettings(Schema):
    """Each hint is a vector on the ground; their weighted sum points to the left, or forward, of the body."""

    pairs: dict[Name, NotNegative] = Field(default_factory=lambda: {"ankle": 0.5, "wrist": 1.0}, max_length=16)
    """[1/m] By part with a left and a right sensor: weight of the line between the two."""
    hands: NotNegative = 1.0
    """[1/m] Weight of how far ahead of the ankles the hands are."""
    velocity: NotNegative = 0.5
    """[s/m] Weight of the way the head moves."""
    walking: Annotated[Interval, AfterValidator(_not_negative)] = (0.5, 1.0)
    """[m/s] Speeds of the head at which that begins to count, and counts wholly."""
    facing: dict[Name, NotNegative] = Field(
        default_factory=lambda: {"head": 1.0, "chest": 2.0, "pelvis": 2.0}, max_length=16
    )
    """By sensor with an orientation: weight of its forward axis."""
    settle: Positive = 0.2
    """[s] Time constant of the low-pass."""
    velocity_settle: Positive = 0.05
    """[s] Of that of the velocity."""
