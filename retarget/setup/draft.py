"""A drafted profile as data, and as the text of `robot.yaml` with comments on the lines that are only a draft."""

import math
from collections.abc import Iterable, Iterator, Sequence, Set
from dataclasses import dataclass, field
from pathlib import Path
from string import Template
from typing import Any

import numpy as np

from hardware.dynamixel.control_table import find_table
from hardware.servo import SERVO_MODELS
from retarget.schema.profile import DRAFT
from retarget.schema.profile_parts import Foot, Landmark, ProfileFrame
from retarget.schema.strict_models import Schema
from retarget.setup.fit_observers import IgnoredLinks, Zones, comment, flow, fragment, wrapped
from retarget.setup.frames import Angles, Posed
from retarget.setup.links import PartLinks
from retarget.setup.postures import leg_length
from retarget.setup.servo_guess import LOW_VOLTAGE, ServoDraft
from retarget.setup.shape_fit import LinkShape

HEAD = "Proposed as retarget fit-observers does; what the comments mean is in docs/own-robot.md."
ZONES = Zones(influence=0.04, margin=0.005)
"""Zones of drafted observers, m."""


# Landmarks.

ARM, LEG = 0.97, 0.99
"""Shares of the stretched limb, so that a stretched human limb does not make it singular. At 0.97 the knee of a leg is
visibly bent, by 28 degrees; at 0.99 by 16."""
SHORTEST = 1e-3
"""Shortest limb with a direction to follow, m."""


def find_landmarks(posed: Posed, standing: Angles) -> tuple[dict[str, Landmark], list[str]]:
    """The landmarks by name, and notes on limbs that are too short. standing: rad by joint, trunk upright."""
    at, found, missing = posed.place(standing).positions, dict[str, Landmark](), list[str]()

    def add(
        frame: str,
        follows: Any,
        measured_from: Any,
        anchor: Any,
        length: float,
        human: Any,
        *,
        name: str = "",
        **more: Any,
    ) -> None:
        if length < SHORTEST:
            missing.append(f"landmark {name or frame}: its limb is {1e3 * length:.1f} mm long")
            return
        limb = {"follows": follows, "from": measured_from, "anchor": anchor, "human_length": human}
        entry = {"frame": frame, "robot_length": round(length, 4), **limb, **more}
        found[name or frame] = Landmark.model_validate(entry)

    for side in ("l", "r"):
        shoulder, elbow, hand, wrist = (f"{side}_{part}" for part in ("shoulder", "elbow", "hand", "wrist"))
        if hand in at:
            path = [at[name] for name in (shoulder, elbow, hand) if name in at]
            parts = np.linalg.norm(np.diff(path, axis=0), axis=1).tolist()
            if elbow in at:
                add(elbow, elbow, shoulder, shoulder, parts[0], [shoulder, elbow], name=f"{side}_upper_arm")
                add(hand, wrist, elbow, elbow, parts[1], [elbow, wrist], name=f"{side}_forearm")
            add(hand, wrist, shoulder, shoulder, ARM * sum(parts), [shoulder, elbow, wrist])
    start, below = (["l_hip", "r_hip"], "pelvis") if "pelvis" in at else ("neck", "neck")
    add("head", "head", start, below, max(float(np.linalg.norm(at["head"] - at[below])), 0.01), [start, "head"])
    if "l_sole" in at and "r_sole" in at:
        ankles, length = ["l_ankle", "r_ankle"], LEG * leg_length(posed)
        add("pelvis", ["l_hip", "r_hip"], ankles, ankles, length, ["l_hip", "l_knee", "l_ankle"])
        for side in ("l", "r"):
            hip, knee, ankle, sole = (f"{side}_{part}" for part in ("hip", "knee", "ankle", "sole"))
            offset = (posed.anatomy.axes.T @ (at[sole] - at[ankle])).round(4).tolist()
            add(sole, ankle, hip, hip, length, [hip, knee, ankle], offset=offset)
    return found, missing


@dataclass(frozen=True)
class Draft:
    """A drafted profile as data. source: name of the body file. frames: by name, each with a comment. postures: name ->
    joint -> rad. shapes: of the observers. links: of the parts. missing: parts that were not found. notes: changes and
    assumptions."""

    name: str
    source: str
    body: str
    root: str
    frames: dict[str, tuple[ProfileFrame, str]]
    servos: tuple[ServoDraft, ...]
    feet: dict[str, Foot]
    postures: dict[str, dict[str, float]]
    landmarks: dict[str, Landmark]
    shapes: tuple[LinkShape, ...] = ()
    ignored: tuple[IgnoredLinks, ...] = ()
    links: PartLinks = field(default_factory=PartLinks)
    missing: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()


# A drafted profile as `robot.yaml`.

FEW_SERVOS, FAST_HZ, SLOW_HZ = 22, 100, 50
"""One line of 1 Mbaud can read and write up to FEW_SERVOS servos at FAST_HZ, else at SLOW_HZ."""
_ROOTS = {
    "free": "it stands on its own feet; `suspended` while it hangs on a stand",
    "suspended": "it has legs but no soles to stand on, so it hangs on a stand",
    "fixed": "bolted down",
}


def profile_text(draft: Draft) -> str:
    """The YAML of a profile: `robot.yaml.template` with the drafted lines."""
    stands = "Trunk upright, soles flat, centre of mass over the middle of the soles; " if draft.feet else ""
    ids = [servo.entry.id for servo in draft.servos]
    feet = _lines(wrapped(_entry(side, foot), 9) for side, foot in draft.feet.items())
    template = Template(Path(__file__).with_name("robot.yaml.template").read_text(encoding="utf-8"))
    return template.substitute(
        head=_lines(_head(draft)),
        name=flow(draft.name),
        body=flow(draft.body),
        root=draft.root,
        root_about=_ROOTS[draft.root],
        frames=_lines(
            _entry(name, frame) + (f"  # {about}" if about else "") for name, (frame, about) in draft.frames.items()
        ),
        servos=_lines(_servos(draft.servos)),
        mark=DRAFT,
        ids=wrapped(f"    ids: {flow(ids)}", 10),
        protocol=min(max(SERVO_MODELS[servo.entry.model].protocols) for servo in draft.servos),
        observers=fragment([HEAD], draft.shapes, draft.ignored, ZONES).strip(),
        feet=f"feet:\n{feet}" if feet else "feet: {}",
        about_postures=comment(f"{stands}joints that are not named are 0."),
        **{name: wrapped(f"  {name}: {flow(angles)}", 4) for name, angles in draft.postures.items()},
        landmarks=_lines(wrapped(_entry(name, landmark), 4) for name, landmark in draft.landmarks.items()),
        rate=FAST_HZ if len(draft.servos) <= FEW_SERVOS else SLOW_HZ,
        count=len(draft.servos),
        voltage=_supply({servo.entry.model for servo in draft.servos}),
    )


def _supply(models: Set[str]) -> str:
    """Voltages, V, at which no servo of these models has an alarm (e-Manual, initial voltage limits), within 4 to 6 V
    for low voltage, or up to 14.8 V, a battery of four cells."""
    limits = [find_table(name, max(SERVO_MODELS[name].protocols)) for name in models]
    lowest = [0.1 * (table["min_voltage_limit"].initial or 0) for table in limits]
    highest = [0.1 * (table["max_voltage_limit"].initial or math.inf) for table in limits]
    low, high = (4.0, 6.0) if min(SERVO_MODELS[name].voltage for name in models) < LOW_VOLTAGE else (0.0, 14.8)
    return f"[{max(low, *lowest):.1f}, {min(high, *highest):.1f}]"


def _lines(lines: Iterable[str]) -> str:
    return "\n".join(lines)


def _head(draft: Draft) -> Iterator[str]:
    yield comment(
        f"{draft.name}: drafted by retarget import from {draft.source}, and not yet tried on a robot. Lines that the "
        f"body file does not settle end in {DRAFT}; take the mark away once a line is right. retarget check counts the "
        "lines that are left."
    )
    yield comment("Units m, rad, s, kg; x forward, y left, z up.")
    parts = {part: link for part, link in draft.links.model_dump().items() if link is not None}
    yield comment(f"Links of its parts: {flow(parts)}.")
    yield from (comment(f"Not found: {text}.") for text in draft.missing)
    yield from (comment(f"Note: {text}.") for text in draft.notes)


def _entry(name: str, entry: Schema, width: int = 0) -> str:
    keys = flow(entry.model_dump(by_alias=True, exclude_unset=True))
    return f"  {flow(name) + ':':<{width}} {keys}"


def _servos(servos: Sequence[ServoDraft]) -> Iterator[str]:
    width = max(len(flow(servo.joint)) for servo in servos) + 1
    for servo in servos:
        number = "id (the number in its name)" if servo.numbered else "id"
        why = f"{number}, direction, zero_tick; model: {servo.why}" + (f"; limits: {servo.note}" if servo.note else "")
        yield f"{wrapped(_entry(servo.joint, servo.entry, width), width + 4)}  {DRAFT} {why}"
