"""The `safety` section of a profile: its keys, and the limits of the guard that follow from them."""

from math import inf
from typing import Annotated

from pydantic import Field

from hardware.guard_state import GuardLimits
from retarget.schema.strict_models import Interval, Positive, Schema, Share

WARN_BEFORE_C = 5.0
"""[degrees Celsius] so much before the stop a servo is warm, where the profile does not say."""


class SpeedCaps(Schema):
    """Shares (0, 1] of each servo's max_velocity."""

    follow: Share = 1.0
    """While following."""
    approach: Share = 0.2
    """On the way to a posture (start, rest) and to the performer."""
    warm: Annotated[float, Field(strict=True, allow_inf_nan=False, ge=0.25, le=1)] = 0.5
    """Share of the speed of following, while a servo is too warm or draws too much."""


class Safety(Schema):
    """Bounds of operation; beyond one of them the guard stops the robot. A key that is left out is not checked."""

    rate_hz: Annotated[float, Field(strict=True, allow_inf_nan=False, ge=10, le=1000)]
    """[Hz] Ticks of the robot."""
    freshness: Positive
    """[s] Greatest age of a servo's state, and of a goal since the start of its tick. Beyond it: stop."""
    freshness_warn: Positive | None = None
    """[s] From here on: a warning."""
    speed_caps: SpeedCaps = SpeedCaps()
    """Shares of each servo's max_velocity, kept by stages and gate."""
    temperature_c: Annotated[float, Field(strict=True, allow_inf_nan=False, gt=0, le=100)]
    """[degrees Celsius] Hottest servo; beyond it: stop."""
    temperature_warn_c: Positive | None = None
    """[degrees Celsius] From here on: a warning, and the robot goes slower. Absent: 5 below temperature_c."""
    voltage: Interval
    """[V] Lowest and highest supply; outside: stop."""
    voltage_warn: Interval | None = None
    """[V] Outside: a warning."""
    following_error: Positive
    """[rad] Largest distance between goal and present position; beyond it: stop."""
    following_error_sustained: Positive | None = None
    """[rad] A smaller one that stops only after following_error_s."""
    following_error_s: Annotated[Positive, Field(le=10)] = 0.2
    """[s] Time after which a sustained error stops or warns."""
    following_error_warn: Positive | None = None
    """[rad] One that gives a warning after following_error_s."""
    current_a: Positive | None = None
    """[A] Greatest current of a servo for current_s; beyond it: stop."""
    current_warn_a: Positive | None = None
    """[A] From here on: a warning, and the robot goes slower."""
    current_s: Annotated[Positive, Field(le=60)] = 1.0
    """[s] Time after which a current stops or warns."""


def guard_limits(safety: Safety) -> GuardLimits:
    """The limits of the guard."""
    return GuardLimits(
        max_age=safety.freshness,
        max_temperature=safety.temperature_c,
        voltage=safety.voltage,
        following_error=safety.following_error,
        sustained_error=_or_any(safety.following_error_sustained),
        sustained_time=safety.following_error_s,
        max_current=_or_any(safety.current_a),
        current_time=safety.current_s,
        warn_age=_or_any(safety.freshness_warn),
        warn_temperature=_warm(safety),
        warn_voltage=safety.voltage_warn or (-inf, inf),
        warn_current=_or_any(safety.current_warn_a),
        warn_following_error=_or_any(safety.following_error_warn),
        slow_share=safety.speed_caps.warm,
    )


def safety_facts(safety: Safety) -> dict[str, str]:
    """What warns, slows and stops, in words for the operator."""
    low, high = safety.voltage
    slows = [f"{_warm(safety):g} degrees Celsius"]
    slows += [] if safety.current_warn_a is None else [f"{safety.current_warn_a:g} A for {safety.current_s:g} s"]
    stops = [f"{safety.temperature_c:g} degrees Celsius", f"outside {low:g} to {high:g} V"]
    stops += [] if safety.current_a is None else [f"{safety.current_a:g} A for {safety.current_s:g} s"]
    stops += [f"{safety.following_error:g} rad from the goal"]
    if safety.following_error_sustained is not None:
        stops += [f"{safety.following_error_sustained:g} rad for {safety.following_error_s:g} s"]
    stops += [f"silent for {safety.freshness:g} s"]
    warns = [] if safety.voltage_warn is None else ["outside {:g} to {:g} V".format(*safety.voltage_warn)]
    if safety.following_error_warn is not None:
        warns += [f"{safety.following_error_warn:g} rad from the goal for {safety.following_error_s:g} s"]
    warns += [] if safety.freshness_warn is None else [f"silent for {safety.freshness_warn:g} s"]
    return {
        "slows": f"to {safety.speed_caps.warm:.0%} at {', '.join(slows)}",
        "warns": ", ".join(warns) or "as it slows",
        "stops": ", ".join(stops),
    }


def _warm(safety: Safety) -> float:
    """Temperature from which on a servo is warm, degrees Celsius."""
    given = safety.temperature_warn_c
    return safety.temperature_c - WARN_BEFORE_C if given is None else given


def _or_any(level: float | None) -> float:
    return inf if level is None else level
