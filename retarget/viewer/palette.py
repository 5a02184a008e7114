"""Colours of the page, and what each stands for: the scene and its legend say the same."""

from dataclasses import dataclass

__all__ = [
    "ASKED",
    "BALANCE",
    "COLD",
    "GOAL",
    "HOT",
    "HUMAN",
    "LEGEND",
    "MODES",
    "OBSTACLE",
    "OUTSIDE",
    "PRESSURE",
    "REACHED",
    "ROBOT",
    "SENSOR",
    "SOLES",
    "ZMP",
    "Colour",
    "Entry",
    "mixed",
    "web",
]

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
    """A part of the scene that can be hidden. box: beside its tick box; keys: its colours, each with what it means.

    at_first: whether it is shown when the page opens.
    """

    box: str
    keys: tuple[tuple[Colour, str], ...]
    at_first: bool = True


LEGEND = {
    "robot": Entry("robot", ((ROBOT, "robot, where its servos say that it is"),)),
    "body": Entry("robot", ((ROBOT, "robot, as the physics has it"),)),
    "goal": Entry("goal", ((GOAL, "goal that was sent, where the robot is not"),)),
    "performer": Entry("performer", ((HUMAN, "performer, as tall as the robot"),)),
    "human": Entry("performer", ((HUMAN, "performer"),)),
    "sensors": Entry("sensors of the performer", ((SENSOR, "sensor, where it is believed to be"),)),
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
    "around": Entry("obstacles", ((OBSTACLE, "obstacle"),)),
}
"""By part of the scene, in the order of the page."""


def mixed(share: float) -> Colour:
    """From COLD (0) to HOT (1)."""
    red, green, blue = (round(cold + share * (hot - cold)) for cold, hot in zip(COLD, HOT, strict=True))
    return red, green, blue


def web(colour: Colour) -> str:
    """As CSS has it."""
    return "#{:02x}{:02x}{:02x}".format(*colour)
