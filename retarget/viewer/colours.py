"""Colours of the page, what each stands for, limbs coloured by their servos, and the legend."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from html import escape
from typing import TYPE_CHECKING

import numpy as np

from retarget.model.robot import RobotBody
from retarget.types import FloatArray
from retarget.viewer.snapshot import Snapshot

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
MODES: tuple[Colour, ...] = ((120, 170, 130), (242, 158, 46), (214, 64, 69))
"""Free, preventive, reactive."""


@dataclass(frozen=True)
class Entry:
    """A part of the scene that can be hidden. box: label of its tick box; keys: its colours, each with what it means.

    at_first: whether it is shown when the page opens.
    """

    box: str
    keys: tuple[tuple[Colour, str], ...]
    at_first: bool = True


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
    "observers": Entry(
        "observers, with their zones",
        ((MODES[0], "observer: free"), (MODES[1], "slows down"), (MODES[2], "gets out of the way")),
        at_first=False,
    ),
    "obstacles": Entry("obstacles", ((OBSTACLE, "obstacle"),)),
}
"""By part of the scene, in the order of the page."""


def mixed(share: float) -> Colour:
    """From COLD (0) to HOT (1)."""
    red, green, blue = (round(cold + share * (hot - cold)) for cold, hot in zip(COLD, HOT, strict=True))
    return red, green, blue


def web(colour: Colour) -> str:
    """As CSS has it."""
    return "#{:02x}{:02x}{:02x}".format(*colour)


# Limbs in the colour of the servo that turns them: by its temperature, or by how much current it draws.

TEMPERATURE, LOAD, PLAIN = "temperature", "load", "nothing"
COLD_C = 30.0
"""Servos warmer than this begin to turn red; at the limit of the profile they are."""
SHADES = 12
"""Steps of colour: a shade that stays is not sent again."""


@dataclass(frozen=True, eq=False)
class Scale:
    """What a colour means. low, high: of the numbers at its ends. each (n,): the number at which a servo is red."""

    words: str
    unit: str
    low: float
    high: float
    each: FloatArray

    def shares(self, values: FloatArray) -> FloatArray:
        """From 0 to 1; 0 for what is not known."""
        return np.nan_to_num(np.clip((np.abs(values) - self.low) / (self.each - self.low), 0.0, 1.0))


class LimbColours:
    """Colours the links of a robot. `by`: TEMPERATURE, LOAD or PLAIN."""

    def __init__(self, robot: RobotBody, meshes: "Sequence[tuple[int, viser.MeshHandle]]") -> None:
        by_link, body = dict(meshes), robot.body
        self._handles = [by_link.get(int(body.joint_body[body.joint_index(j)])) for j in robot.joint_map.joints]
        self._shades = np.zeros(len(self._handles), dtype=int)
        self._scales = {TEMPERATURE: temperature_scale(robot), LOAD: current_scale(robot)}
        self.by = TEMPERATURE

    @property
    def choices(self) -> tuple[str, ...]:
        """What they can be coloured by."""
        return (*(name for name, scale in self._scales.items() if scale is not None), PLAIN)

    @property
    def scale(self) -> Scale | None:
        """Of the colours that are shown."""
        return self._scales.get(self.by)

    def show(self, snapshot: Snapshot) -> None:
        """Where the numbers are known."""
        values = {TEMPERATURE: snapshot.temperature, LOAD: snapshot.current}.get(self.by)
        scale, shades = self.scale, np.zeros_like(self._shades)
        if scale is not None and values is not None and len(values) == len(shades):
            shades = np.round(scale.shares(values) * SHADES).astype(int)
        for index in np.flatnonzero(shades != self._shades):
            handle = self._handles[index]
            if handle is not None:
                handle.color = mixed(shades[index] / SHADES)
        self._shades = shades


def temperature_scale(robot: RobotBody) -> Scale:
    """Red at the temperature that stops the robot."""
    limit = max(robot.profile.safety.temperature_c, COLD_C + 1.0)
    each = np.full(len(robot.joint_map), limit)
    return Scale("limbs by temperature of their servo; red: the robot stops", "\u00b0C", COLD_C, limit, each)


def current_scale(robot: RobotBody) -> Scale | None:
    """Red at the smallest current that the profile names: of a servo, of a warning or of a stop; None without any."""
    profile = robot.profile
    known = [limit for limit in (profile.safety.current_warn_a, profile.safety.current_a) if limit is not None]
    each = np.array([min([*known, *([own] if own is not None else [])], default=np.nan) for own in _own(robot)])
    if not np.isfinite(each).any():
        return None
    return Scale("limbs by current of their servo; red: as much as it may draw", "A", 0.0, float(np.nanmax(each)), each)


def _own(robot: RobotBody) -> list[float | None]:
    """Most current that each servo may draw, A, in servo order."""
    return [robot.profile.servos[joint].current for joint in robot.joint_map.joints]


# What the colours of the scene mean, as HTML for the panel of the page.


def legend(parts: Iterable[str], scale: Scale | None) -> str:
    """Of these parts of the scene, and of the limbs where they are coloured."""
    rows = [_row(colour, words) for part in parts for colour, words in LEGEND[part].keys]
    if scale is not None:
        rows.append(_bar(scale))
    return f"<div style='padding:0 0.8em;font-size:0.8em;line-height:1.6'>{''.join(rows)}</div>"


def _row(colour: Colour, words: str) -> str:
    style = f"display:inline-block;width:0.8em;height:0.8em;border-radius:50%;background:{web(colour)}"
    return f"<div><span style='{style}'></span> {escape(words)}</div>"


def _bar(scale: Scale) -> str:
    """A bar from one colour to the other, with the numbers at its ends."""
    fade = f"background:linear-gradient(90deg,{web(COLD)},{web(HOT)})"
    low, high = (f"{value:g} {scale.unit}" for value in (scale.low, scale.high))
    return (
        f"<div style='margin-top:0.4em'>{escape(scale.words)}</div>"
        f"<div style='display:flex;gap:0.5em;align-items:center'><span>{low}</span>"
        f"<span style='flex:1;height:0.7em;border-radius:0.3em;{fade}'></span><span>{high}</span></div>"
    )
