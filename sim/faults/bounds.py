"""The bounds by which faults are judged, as `bounds.yaml` has them."""

from pathlib import Path
from typing import Annotated, Literal

from pydantic import BeforeValidator

from retarget.schema.strict_models import Integer, Number, Schema, Switch, Text, read_model


class _Bound(Schema):
    value: Number
    unit: Literal["s", "rad", "m", "m/s", "share", "ticks"]
    reason: Text


Bound = Annotated[Number, BeforeValidator(lambda entry: _Bound.model_validate(entry).value)]


class ReactionEntry(Schema):
    """A reaction in a run with several faults."""

    strength: Integer = 0
    words: str = ""
    outlived: Switch = False
    harmless: Switch = False


class Bounds(Schema):
    """The values of all bounds, in the units of their names; a share is one of a joint's greatest speed."""

    brake_s: Bound
    off_s: Bound
    to_rest_share: Bound
    resume_share: Bound
    resume_s: Bound
    short_hold_s: Bound
    at_rest_rad: Bound
    healthy_s: Bound
    resumed_s: Bound
    slow_share: Bound
    resume_m_s: Bound
    margin_m: Bound
    stood_s: Bound
    onset_s: Bound
    stop_before_s: Bound
    idle_s: Bound
    settled_s: Bound
    engaging_s: Bound
    endless_s: Bound
    afterwards_s: Bound
    soon_s: Bound
    longer_s: Bound
    cued_s: Bound
    more_s: Bound
    pair_at_s: Bound
    pair_gap_s: Bound
    rounded_ticks: Bound
    rounded_inwards_ticks: Bound
    numerics_rad: Bound
    straight_ticks: Bound
    off_between_s: Bound
    deepest_m: Bound
    reactions: dict[str, ReactionEntry]


BOUNDS = read_model(Bounds, Path(__file__).with_name("bounds.yaml"))
