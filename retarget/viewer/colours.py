"""Colours of the page, what each stands for, limbs coloured by the heat of their servos, and the legend."""

from collections.abc import Iterable
from html import escape

import numpy as np

Colour = tuple[int, int, int]

ROBOT: Colour = (74, 98, 132)
GOAL: Colour = (242, 158, 46)
HUMAN: Colour = (176, 186, 196)
ASKED: Colour = (214, 64, 69)
SENSOR: Colour = (226, 88, 168)
REACHED: Colour = (46, 134, 84)
BALANCE: Colour = (126, 87, 194)
ZMP: Colour = (0, 150, 160)
OUTSIDE: Colour = (214, 40, 40)
SOLES: Colour = (90, 60, 160)
PRESSURE: Colour = (30, 30, 30)
OBSTACLE: Colour = (166, 124, 82)
COLD: Colour = ROBOT
HOT: Colour = (214, 40, 40)
MODES: tuple[Colour, ...] = (GOAL, ASKED)
"""Preventive, reactive."""


Keys = tuple[tuple[Colour, str], ...]
"""Colours, and what each means."""
LEGEND: dict[str, Keys] = {
    "robot": ((ROBOT, "robot, where its servos report it, or the physics has it"),),
    "goal": ((GOAL, "goal that was sent, where the robot is not"),),
    "performer": ((HUMAN, "performer"),),
    "sensors": ((SENSOR, "sensor of the performer, while it is valid"),),
    "asked": ((ASKED, "where hands, feet and head were asked to be"),),
    "reached": ((REACHED, "where the goal has them"),),
    "balance": (
        (BALANCE, "centre of mass, and the point below it"),
        (SOLES, "line round the soles: the support polygon"),
        (ZMP, "zero-moment point, on the floor"),
        (OUTSIDE, "zero-moment point outside of the support polygon: it tips"),
        (PRESSURE, "centre of pressure of the soles, in the physics"),
    ),
    "observers": ((MODES[0], "observer that acts: slows down"), (MODES[1], "gets out of the way")),
    "obstacles": ((OBSTACLE, "obstacle"),),
}
"""By part of the scene, in the order of the page."""


def web(colour: Colour) -> str:
    """Write a colour as CSS has it."""
    return "#{:02x}{:02x}{:02x}".format(*colour)


COLD_C = 30.0
"""Servos warmer than this begin to turn red; at the limit of the profile they are."""
SHADES = 12
"""Steps of colour: a shade that stays is not sent again."""


def heat(temperature: float, limit: float) -> Colour:
    """The colour of a limb whose servo has a temperature, degrees Celsius (NaN: not known), by that which stops it."""
    share = np.clip((temperature - COLD_C) / max(limit - COLD_C, 1.0), 0.0, 1.0)
    shade = round(float(np.nan_to_num(share)) * SHADES) / SHADES
    red, green, blue = (round(cold + shade * (hot - cold)) for cold, hot in zip(COLD, HOT, strict=True))
    return red, green, blue


def heat_keys(limit: float) -> Keys:
    """What the colours of limbs mean, for the legend. limit: of servos, degrees Celsius."""
    return (
        (COLD, f"limb whose servo is at {COLD_C:g} \u00b0C or colder"),
        (HOT, f"limb whose servo is at {limit:g} \u00b0C: the robot stops"),
    )


def legend(keys: Iterable[tuple[Colour, str]]) -> str:
    """What colours mean, as HTML."""
    dot = "display:inline-block;width:0.8em;height:0.8em;border-radius:50%;background:"
    rows = [f"<div><span style='{dot}{web(colour)}'></span> {escape(words)}</div>" for colour, words in keys]
    return f"<div style='padding:0 0.8em;font-size:0.8em;line-height:1.6'>{''.join(rows)}</div>"
