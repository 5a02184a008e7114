"""Length units of motion files, given by the user or guessed from the size of the body."""

import math
from dataclasses import dataclass

from retarget.errors import InputError, UsageError, suggest

__all__ = ["UNITS", "Unit", "choose_unit", "named_unit"]

CMU_METRES = 0.0254 / 0.45
"""One unit of the CMU recordings (ASF `length 0.45`) in metres."""

UNITS: dict[str, float] = {"m": 1.0, "cm": 0.01, "mm": 0.001, "inch": 0.0254, "cmu": CMU_METRES}
"""Metres per unit."""

TYPICAL_HEIGHT_M = 1.7
USUAL_HEIGHT_M = (1.4, 2.1)
POSSIBLE_HEIGHT_M = (1.0, 2.5)


@dataclass(frozen=True)
class Unit:
    """A length unit and what to tell the user about it (empty: nothing)."""

    name: str
    metres: float
    note: str = ""


def named_unit(name: str) -> Unit:
    """The unit that the user named. Raises UsageError with the nearest names."""
    key = name.lower()
    if key not in UNITS:
        raise UsageError("unknown unit", found=repr(name), allowed=", ".join(UNITS), next_step=suggest(key, UNITS))
    return Unit(key, UNITS[key])


def choose_unit(body_height: float | None, *, where: str) -> Unit:
    """The unit in which a body of this height (file units) is nearest to a human; a note says so.

    Raises InputError if no unit makes it a human at all.
    """
    if body_height is None or not 0.0 < body_height < math.inf:
        raise InputError("the skeleton has no height", where=where, next_step="Say the unit with --unit")
    name = min(UNITS, key=lambda unit: abs(math.log(body_height * UNITS[unit] / TYPICAL_HEIGHT_M)))
    height = body_height * UNITS[name]
    if not POSSIBLE_HEIGHT_M[0] <= height <= POSSIBLE_HEIGHT_M[1]:
        raise InputError(
            "the skeleton fits a human in no known unit",
            where=where,
            found=f"a body {body_height:.4g} units high",
            allowed=f"{POSSIBLE_HEIGHT_M[0]} to {POSSIBLE_HEIGHT_M[1]} m in one of {', '.join(UNITS)}",
            next_step="Say the unit with --unit",
        )
    note = f"unit not stated: taken as {name}, which makes the body {height:.2f} m high (change it with --unit)"
    if not USUAL_HEIGHT_M[0] <= height <= USUAL_HEIGHT_M[1]:
        note += "; that is unusual for an adult"
    return Unit(name, UNITS[name], note)
