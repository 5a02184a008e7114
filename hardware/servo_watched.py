"""What is watched of servos: within which bounds there is nothing to say, and the words for what is beyond them."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from math import inf

import numpy as np

from hardware.arrays import BoolArray, FloatArray
from hardware.bus import ServoAlert
from hardware.guard_state import GuardLimits, StopCause
from hardware.servo import ServoSpec

Tell = Callable[[float], str]
"""A value in words."""
Bounds = tuple[float, float]
"""Least and most."""

ANYTHING: Bounds = (-inf, inf)
EASE = 0.1
"""Share of its level by which a current or a following error has to fall below it before a warning ends."""
COOLER = 2.0
"""[degrees Celsius] the same for temperatures, which servos tell in whole degrees."""
STEADIER = 0.2
"""[V] the same for voltages."""
MOST_OF_ALL = 3
"""All servos of a robot are named one by one up to so many."""


@dataclass(frozen=True, kw_only=True)
class Watched:
    """One quantity of every servo. stop: bounds beyond which the robot stops; patience: s that they may be exceeded.

    warn: bounds beyond which somebody is told, after the same patience; ease: how far within them the warning ends;
    slows: it slows the robot too. complaint, warning: what goes before the names of the servos.
    """

    cause: StopCause
    stop: Bounds
    complaint: str
    tell: Tell
    patience: float = 0.0
    warn: Bounds = ANYTHING
    warning: str = ""
    ease: float = 0.0
    slows: bool = False


def watched(limits: GuardLimits) -> tuple[Watched, ...]:
    """What is watched, in the order of `Row`."""
    return (*_by_the_servos(limits), _temperature(limits), _voltage(limits), _current(limits), *_following(limits))


class Row:
    """Where in an array of all that is watched (rows, n) each quantity stands."""

    ALERT, AGE, LIMP, TEMPERATURE, VOLTAGE, CURRENT, FAR, STILL_FAR = range(8)


def name_servos(servos: Sequence[ServoSpec], which: BoolArray, tell: Tell, values: FloatArray) -> str:
    """Every servo of the mask (n,) with its value (n,), for example: l_el (id 6) OVERLOAD; all of them by their number
    alone, from the least value to the most: it is their supply or their bus, and no servo's own."""
    if which.all() and len(servos) > MOST_OF_ALL:
        found = list(dict.fromkeys(tell(float(value)) for value in np.sort(values)))
        told = " and ".join(found) if len(found) < MOST_OF_ALL else f"{found[0]} to {found[-1]}"
        return f"all {len(servos)} servos {told}".rstrip()
    named = []
    for index in np.flatnonzero(which).tolist():
        servo = servos[index]
        named.append(f"{servo.joint} (id {servo.id}) {tell(float(values[index]))}".rstrip())
    return ", ".join(named)


def _by_the_servos(limits: GuardLimits) -> tuple[Watched, ...]:
    return (
        Watched(
            cause=StopCause.SERVO_ALERT, stop=(0, 0), complaint="reports", tell=lambda value: _alert_text(int(value))
        ),
        Watched(
            cause=StopCause.SERVO_LOST,
            stop=(0, limits.max_age),
            complaint=f"has not answered for more than {limits.max_age:g} s:",
            tell=_untold,
            warn=(0, limits.warn_age),
            warning=f"has not answered for more than {limits.warn_age:g} s:",
        ),
        Watched(
            cause=StopCause.SERVO_LIMP,
            stop=(0, 0),
            complaint="does not follow its goals (started anew, or stopped by its watchdog):",
            tell=_untold,
        ),
    )


def _temperature(limits: GuardLimits) -> Watched:
    return Watched(
        cause=StopCause.TEMPERATURE,
        stop=(-inf, limits.max_temperature),
        complaint=f"is hotter than {limits.max_temperature:g} degrees Celsius:",
        tell=lambda value: _known(f"{value:.0f}"),
        warn=(-inf, limits.warn_temperature),
        warning=f"is hotter than {limits.warn_temperature:g} degrees Celsius:",
        ease=COOLER,
        slows=True,
    )


def _voltage(limits: GuardLimits) -> Watched:
    low, high = limits.voltage
    warn_low, warn_high = limits.warn_voltage
    return Watched(
        cause=StopCause.VOLTAGE,
        stop=limits.voltage,
        complaint=f"has a supply outside {low:g} to {high:g} V:",
        tell=lambda value: _known(f"{value:.1f} V"),
        warn=limits.warn_voltage,
        warning=f"has a supply outside {warn_low:g} to {warn_high:g} V:",
        ease=STEADIER,
    )


def _current(limits: GuardLimits) -> Watched:
    lasting = f"for {limits.current_time:g} s:"
    return Watched(
        cause=StopCause.CURRENT,
        stop=(0, limits.max_current),
        complaint=f"draws more than {limits.max_current:g} A {lasting}",
        tell=lambda value: f"{value:.2f} A",
        patience=limits.current_time,
        warn=(0, limits.warn_current),
        warning=f"draws more than {limits.warn_current:g} A {lasting}",
        ease=_eased(limits.warn_current),
        slows=True,
    )


def _following(limits: GuardLimits) -> tuple[Watched, ...]:
    """The largest error at once, a smaller one if it lasts."""
    lasting = f"rad from its goal for {limits.lasting_time:g} s:"
    return (
        Watched(
            cause=StopCause.FOLLOWING_ERROR,
            stop=(0, limits.following_error),
            complaint=f"is more than {limits.following_error:g} rad from its goal:",
            tell=_angle,
        ),
        Watched(
            cause=StopCause.FOLLOWING_ERROR,
            stop=(0, limits.lasting_error),
            complaint=f"is more than {limits.lasting_error:g} {lasting}",
            tell=_angle,
            patience=limits.lasting_time,
            warn=(0, limits.warn_following_error),
            warning=f"is more than {limits.warn_following_error:g} {lasting}",
            ease=_eased(limits.warn_following_error),
        ),
    )


def _eased(level: float) -> float:
    return EASE * level if np.isfinite(level) else 0.0


def _angle(value: float) -> str:
    return f"{value:.2f} rad"


def _untold(value: float) -> str:
    return ""


def _known(value: str) -> str:
    return "not known" if value.startswith("nan") else value


def _alert_text(bits: int) -> str:
    """Names of the alert bits; bits that the maker leaves undefined as a number."""
    known = [alert.name or "" for alert in ServoAlert if bits & alert]
    rest = bits & ~sum(ServoAlert)
    return "+".join([*known, *([f"0x{rest:02x}"] if rest else [])])
