"""Colours of the page, what each stands for, limbs coloured by the heat of their servos, and the legend."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from html import escape
from typing import TYPE_CHECKING

import numpy as np

from retarget.model.robot import RobotBody
from retarget.types import FloatArray

if TYPE_CHECKING:
    import viser


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


@dataclass(frozen=True)
class Entry:
    """A part of the scene that can be hidden. box: label of its tick box; keys: its colours and what each means."""

    box: str
    keys: tuple[tuple[Colour, str], ...]


LEGEND = {
    "robot": Entry("robot", ((ROBOT, "robot, where its servos report it"),)),
    "body": Entry("robot", ((ROBOT, "robot, as the physics has it"),)),
    "goal": Entry("goal", ((GOAL, "goal that was sent, where the robot is not"),)),
    "performer": Entry("performer", ((HUMAN, "performer, as tall as the robot"),)),
    "human": Entry("performer", ((HUMAN, "performer"),)),
    "sensors": Entry("sensors of the performer", ((SENSOR, "sensor, while it is valid"),)),
    "asked": Entry("asked of hands, feet, head", ((ASKED, "where hands, feet and head were asked to be"),)),
    "reached": Entry("reached by the goal", ((REACHED, "where the goal has them"),)),
    "balance": Entry(
        "balance",
        (
            (BALANCE, "centre of mass, and the point below it"),
            (ZMP, "zero-moment point of the motion, on the floor"),
        ),
    ),
    "pressure": Entry("pressure of the soles", ((PRESSURE, "centre of pressure of the soles, in the physics"),)),
    "soles": Entry(
        "support polygon",
        ((SOLES, "line round the soles: the support polygon"), (OUTSIDE, "zero-moment point outside of it: it tips")),
    ),
    "observers": Entry("observers that act", ((MODES[0], "observer: slows down"), (MODES[1], "gets out of the way"))),
    "obstacles": Entry("obstacles", ((OBSTACLE, "obstacle"),)),
}
"""By part of the scene, in the order of the page."""


def web(colour: Colour) -> str:
    """Write a colour as CSS has it."""
    return "#{:02x}{:02x}{:02x}".format(*colour)


COLD_C = 30.0
"""Servos warmer than this begin to turn red; at the limit of the profile they are."""
SHADES = 12
"""Steps of colour: a shade that stays is not sent again."""


class LimbColours:
    """Colours the links of a robot by the temperature of the servo that turns them: red at that which stops it."""

    def __init__(self, robot: RobotBody, meshes: "Mapping[int, viser.MeshHandle]") -> None:
        body = robot.body
        self._handles = [meshes.get(int(body.joint_body[body.joint_index(j)])) for j in robot.joint_map.joints]
        self._shades = np.zeros(len(self._handles), dtype=int)
        self._limit = max(robot.profile.safety.temperature_c, COLD_C + 1.0)
        self.keys = (
            (COLD, f"limb whose servo is at {COLD_C:g} \u00b0C or colder"),
            (HOT, f"limb whose servo is at {self._limit:g} \u00b0C: the robot stops"),
        )
        """For the legend."""

    def show(self, temperature: FloatArray | None) -> None:
        """Temperatures (n,) degrees Celsius; NaN or None: not known."""
        if temperature is None or len(temperature) != len(self._shades):
            return
        shares = np.clip((temperature - COLD_C) / (self._limit - COLD_C), 0.0, 1.0)
        shades = np.round(np.nan_to_num(shares) * SHADES).astype(int)
        for index in np.flatnonzero(shades != self._shades):
            handle = self._handles[index]
            if handle is not None:
                share = shades[index] / SHADES
                red, green, blue = (round(cold + share * (hot - cold)) for cold, hot in zip(COLD, HOT, strict=True))
                handle.color = red, green, blue
        self._shades = shades


def legend(parts: Iterable[str], more: Iterable[tuple[Colour, str]]) -> str:
    """What the colours of these parts of the scene mean, and `more` of them, as HTML."""
    rows = [_row(colour, words) for part in parts for colour, words in LEGEND[part].keys]
    rows += [_row(colour, words) for colour, words in more]
    return f"<div style='padding:0 0.8em;font-size:0.8em;line-height:1.6'>{''.join(rows)}</div>"


def _row(colour: Colour, words: str) -> str:
    style = f"display:inline-block;width:0.8em;height:0.8em;border-radius:50%;background:{web(colour)}"
    return f"<div><span style='{style}'></span> {escape(words)}</div>"
