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
    """Each hint is a vector on the ground; their weighted sum points to the left, or forward, of the body.

    pairs: by part with a left and a right sensor: weight of the line between the two (1/m). hands: weight of how far
    ahead of the ankles the hands are (1/m). velocity: weight of the way the head moves (s/m), from none at the first
    to all at the second speed of `walking` (m/s). facing: by sensor with an orientation: weight of its forward axis.
    settle: time constant of the low-pass, s; velocity_settle: of the velocity.
    """

    pairs: dict[Name, NotNegative] = Field(default_factory=lambda: {"ankle": 0.5, "wrist": 1.0}, max_length=16)
    hands: NotNegative = 1.0
    velocity: NotNegative = 0.5
    walking: Annotated[Interval, AfterValidator(_not_negative)] = (0.5, 1.0)
    facing: dict[Name, NotNegative] = Field(
        default_factory=lambda: {"head": 1.0, "chest": 2.0, "pelvis": 2.0}, max_length=16
    )
    settle: Positive = 0.2
    velocity_settle: Positive = 0.05
