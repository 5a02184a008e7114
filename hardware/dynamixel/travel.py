"""Whether a servo's own limits let every goal of its joint through: a goal beyond them is refused in silence."""

import math
from collections.abc import Mapping, Sequence
from typing import NamedTuple

from hardware.bus_spec import BusSpec
from hardware.dynamixel.servo_image import ServoImage
from hardware.dynamixel.setup_plan import setup_command
from hardware.servo import ServoMode, ServoSpec
from hardware.transmission import ROUND_OFF, coupled_pairs


class Span(NamedTuple):
    """First and last tick."""

    low: int
    high: int


def needed_ticks(servos: Sequence[ServoSpec]) -> dict[str, Span]:
    """Goal ticks that the joints' limits make, by joint; of a coupled pair those of all angles of both joints.

    A pair of which one is not among `servos` is left out.
    """
    joints = {servo.joint for servo in servos}
    whole = [servo for servo in servos if servo.coupling is None or set(servo.coupling.joints) <= joints]
    spans: dict[str, Span] = {}
    for servo in whole:
        if servo.coupling is None:
            low, high = sorted(servo.zero_tick + servo.ticks_per_rad * q for q in (servo.lower, servo.upper))
            spans[servo.joint] = _within(servo, math.ceil(low - ROUND_OFF), math.floor(high + ROUND_OFF))
    for pair in coupled_pairs(whole):
        for column, low, high in zip(pair.columns.tolist(), *pair.tick_ends(), strict=True):
            spans[whole[column].joint] = _within(whole[column], round(low), round(high))
    return spans


def _within(servo: ServoSpec, low: int, high: int) -> Span:
    return Span(max(low, servo.lowest_tick), min(high, servo.highest_tick))


def travel_complaints(servo: ServoSpec, bus: BusSpec, image: ServoImage, needed: Span | None) -> list[str]:
    """The servo's own limits against the ticks that the joint needs; None: those are not known."""
    names, moved = _limits(servo, image), limits_to_move(servo, image, needed)
    if names is None or not moved:
        return []
    low, high = (image.value(name) for name in names)
    cure = setup_command(bus, servo.id, moved)
    mode = _other_mode(servo, image, low, high)
    if mode:
        return [f"{mode}: {cure}"]
    assert needed is not None
    return [
        f"takes ticks {low} to {high} only, the joint needs {needed.low} to {needed.high}: narrow the limits of the "
        f"profile, or {cure}"
    ]


def limits_to_move(servo: ServoSpec, image: ServoImage, needed: Span | None) -> dict[str, int]:
    """What the servo's own limits must become for those ticks, counts by register; empty where they are wide enough."""
    names = _limits(servo, image)
    if names is None:
        return {}
    low, high = (image.value(name) for name in names)
    wanted = dict(zip(names, needed or Span(0, servo.model.ticks - 1), strict=True))
    if _other_mode(servo, image, low, high):
        return wanted
    if needed is None or (low <= needed.low and needed.high <= high):
        return {}
    return _narrow(wanted, low, high)


def _other_mode(servo: ServoSpec, image: ServoImage, low: int, high: int) -> str:
    """Which mode the limits of a 1.0 servo make that follows no position; "" for none."""
    if image.table.protocol == 1:
        if low == high == 0:
            return "is in wheel mode (both angle limits 0)"
        if image.has("multi_turn_offset") and low == high == servo.model.ticks - 1:
            return "is in multi-turn mode (both angle limits at their end)"
    return ""


def _limits(servo: ServoSpec, image: ServoImage) -> tuple[str, str] | None:
    """Names of the registers that limit goals; None where no register does."""
    if image.table.protocol == 1:
        return ("cw_angle_limit", "ccw_angle_limit")
    return ("min_position_limit", "max_position_limit") if servo.mode is ServoMode.POSITION else None


def _narrow(wanted: Mapping[str, int], low: int, high: int) -> dict[str, int]:
    """Those of the two that must be moved out."""
    (first, least), (last, most) = wanted.items()
    return ({first: least} if low > least else {}) | ({last: most} if high < most else {})
