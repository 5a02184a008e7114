"""A drafted profile: as data, with its landmarks, and as the text of `robot.yaml` with comments that say what is
only a draft.
"""

import json
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from string import Template

import numpy as np

from retarget.schema.profile import DRAFT
from retarget.setup.fit_observers import comment, number, numbers, plain_name, wrapped
from retarget.setup.frames import Placed
from retarget.setup.servo_guess import LOW_VOLTAGE, ServoDraft
from retarget.types import FloatArray

# The proposal of `fit-observers` as the sections of a drafted profile.

HEAD = "# Proposed as retarget fit-observers does; what the comments mean is in docs/own-robot.md.\n"
EMPTY = "ignore_pairs: []"
NO_OBSERVERS = f"observers: {{}}\n{EMPTY}\n"


def observer_text(fitted: str, touching: tuple[tuple[str, str], ...]) -> str:
    """The two sections for a profile, without instructions for copying them.

    fitted: text of `fit-observers`. touching: pairs that touch in the drafted postures, which are ignored too.
    """
    text = HEAD + fitted[fitted.index("observers:\n") :]
    if not touching:
        return text
    reason = "touch in the drafted postures: draw their shapes tighter, or move the postures, then remove this"
    lines = "\n".join(
        f"  - pair: [{json.dumps(first)}, {json.dumps(second)}]  # DRAFT\n    reason: {json.dumps(reason)}"
        for first, second in touching
    )
    place = "ignore_pairs:\n"
    if EMPTY in text:
        return text.replace(EMPTY, place + lines)
    return text.replace(place, place + lines + "\n")


# How a drafted robot follows the human, limb by limb: landmarks by what limbs it has.

STRETCH = 0.97
"""Share of the stretched limb: a stretched human limb must not ask for a singular one."""


@dataclass(frozen=True)
class LandmarkDraft:
    """As `profile_parts.Landmark`, as text of its lists. offset (3,) m, or nothing."""

    name: str
    follows: str
    measured_from: str
    anchor: str
    length: float
    human_length: str
    offset: tuple[float, float, float] | None = None


def find_landmarks(placed: Placed, leg: float, axes: FloatArray) -> tuple[LandmarkDraft, ...]:
    """placed: the robot standing, trunk upright. leg: stretched hip to ankle, m. axes (3, 3): of the robot, columns."""
    at = placed.positions
    found = []
    for side in ("l", "r"):
        shoulder, elbow, hand = (f"{side}_{part}" for part in ("shoulder", "elbow", "hand"))
        if hand in at:
            way = [at[name] for name in (shoulder, elbow, hand) if name in at]
            length = STRETCH * float(np.linalg.norm(np.diff(way, axis=0), axis=1).sum())
            chain = f"[{side}_shoulder, {side}_elbow, {side}_wrist]"
            found.append(LandmarkDraft(hand, f"{side}_wrist", shoulder, shoulder, length, chain))
    if "pelvis" in at:
        length = max(float(np.linalg.norm(at["head"] - at["pelvis"])), 0.01)
        found.append(LandmarkDraft("head", "head", "[l_hip, r_hip]", "pelvis", length, "[[l_hip, r_hip], head]"))
    else:
        length = max(float(np.linalg.norm(at["head"] - at["neck"])), 0.01)
        found.append(LandmarkDraft("head", "head", "neck", "neck", length, "[neck, head]"))
    if "l_sole" not in at or "r_sole" not in at:
        return tuple(found)
    chain, length = "[l_hip, l_knee, l_ankle]", STRETCH * leg
    ankles = "[l_ankle, r_ankle]"
    found.append(LandmarkDraft("pelvis", "[l_hip, r_hip]", ankles, ankles, length, chain))
    for side in ("l", "r"):
        x, y, z = (axes.T @ (at[f"{side}_sole"] - at[f"{side}_ankle"])).round(4).tolist()
        chain = f"[{side}_hip, {side}_knee, {side}_ankle]"
        hip, ankle = f"{side}_hip", f"{side}_ankle"
        found.append(LandmarkDraft(f"{side}_sole", ankle, hip, hip, length, chain, (x, y, z)))
    return tuple(found)


@dataclass(frozen=True)
class FrameDraft:
    """As `profile_parts.Frame`, and what it is."""

    name: str
    link: str
    pos: tuple[float, ...]
    quat: tuple[float, ...]
    about: str


@dataclass(frozen=True)
class FootDraft:
    """As `profile_parts.Foot`."""

    side: str
    frame: str
    polygon: tuple[tuple[float, ...], ...]


@dataclass(frozen=True)
class Draft:
    """A drafted profile as data.

    source: name of the file that it is made from. postures: name -> joint -> rad. facing: by what front and back were
    found. missing: what could not be found. notes: what was changed or assumed. observers: their sections as text.
    """

    name: str
    source: str
    body: str
    root: str
    frames: tuple[FrameDraft, ...]
    servos: tuple[ServoDraft, ...]
    feet: tuple[FootDraft, ...]
    postures: dict[str, dict[str, float]]
    landmarks: tuple[LandmarkDraft, ...]
    facing: str
    missing: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()
    observers: str = NO_OBSERVERS


# A drafted profile as `robot.yaml`: in the order of the shipped ones, with comments that say what is only a draft.

FEW_SERVOS, FAST_HZ, SLOW_HZ = 22, 100, 50
"""Up to FEW_SERVOS servos, one line of 1 Mbaud has time to read and write all of them at FAST_HZ; else at SLOW_HZ."""
_ROOTS = {
    "free": "it stands on its own feet; `suspended` while it hangs on a stand",
    "suspended": "it has legs but no soles to stand on, so it hangs on a stand",
    "fixed": "bolted down",
}
_POSTURES = {
    "neutral": "Where pairs of observers that touch are no longer looked at.",
    "stand": "Where a run begins and ends.",
    "rest": "At rest, before torque goes off.",
    "attractor": "Arms away from the trunk, knees bent: in reach of everything.",
}


def profile_text(draft: Draft) -> str:
    """YAML of a whole profile: `robot.yaml.template` with the drafted lines."""
    stands = "Trunk upright, soles flat, centre of mass over the middle of the soles; " if draft.feet else ""
    ids = ", ".join(str(servo.number) for servo in draft.servos)
    supply = min(servo.model.voltage for servo in draft.servos)
    template = Template(Path(__file__).with_name("robot.yaml.template").read_text(encoding="utf-8"))
    return template.substitute(
        head=_lines(_head(draft)),
        name=plain_name(draft.name),
        body=plain_name(draft.body),
        root=draft.root,
        root_about=_ROOTS[draft.root],
        frames=_lines(_frame(frame) for frame in draft.frames),
        servos=_lines(_servos(draft.servos)),
        mark=DRAFT,
        ids=wrapped(f"    ids: [{ids}]", 10),
        observers=draft.observers.strip(),
        feet=_lines(_feet(draft.feet)),
        about_postures=comment(f"{stands}joints that are not named are 0."),
        postures=_lines(_postures(draft.postures)),
        landmarks=_lines(_landmark(mark) for mark in draft.landmarks),
        rate=FAST_HZ if len(draft.servos) <= FEW_SERVOS else SLOW_HZ,
        count=len(draft.servos),
        voltage="[4.0, 6.0]" if supply < LOW_VOLTAGE else "[10.0, 14.8]",
    )


def _lines(lines: Iterable[str]) -> str:
    return "\n".join(lines)


def _head(draft: Draft) -> Iterator[str]:
    yield comment(
        f"{draft.name}: drafted by retarget import from {draft.source}, and not yet tried on a robot. Lines that the "
        f"body file does not settle end in {DRAFT}; take the mark away once a line is right. retarget check counts the "
        "lines that are left."
    )
    yield comment("Units m, rad, s, kg; x forward, y left, z up.")
    yield comment(f"Front and back: {draft.facing}.")
    yield from (comment(f"Not found: {text}.") for text in draft.missing)
    yield from (comment(f"Note: {text}.") for text in draft.notes)


def _frame(frame: FrameDraft) -> str:
    turn = "" if abs(abs(frame.quat[0]) - 1.0) < 1e-6 else f", quat: {numbers(frame.quat, 6)}"
    entry = f"  {frame.name}: {{link: {plain_name(frame.link)}, pos: {numbers(frame.pos, 5)}{turn}}}"
    return f"{entry}  # {frame.about}" if frame.about else entry


def _servos(servos: Sequence[ServoDraft]) -> Iterator[str]:
    width = max(len(plain_name(servo.joint)) for servo in servos) + 1
    for servo in servos:
        why = f"id, direction, zero_tick; model: {servo.why}" + (f"; limits: {servo.note}" if servo.note else "")
        yield (
            f"  {plain_name(servo.joint) + ':':<{width}} {{id: {servo.number}, model: {servo.model.name}, bus: main, "
            f"direction: 1, zero_tick: {servo.model.centre_tick}, limits: {numbers(servo.limits, 6)},\n"
            f"  {'':<{width}}  max_velocity: {servo.max_velocity:g}, max_acceleration: {servo.max_acceleration:.1f}, "
            f"gains: {{p: {servo.position_p}}}}}  {DRAFT} {why}"
        )


def _feet(feet: Sequence[FootDraft]) -> Iterator[str]:
    if not feet:
        yield "feet: {}"
        return
    yield comment("Outlines of the flat undersides of the feet, in the frames of the soles.")
    yield "feet:"
    for foot in feet:
        corners = ", ".join(numbers(corner, 4) for corner in foot.polygon)
        yield wrapped(f"  {foot.side}: {{frame: {foot.frame}, polygon: [{corners}]}}", 9)


def _postures(postures: Mapping[str, Mapping[str, float]]) -> Iterator[str]:
    for name, angles in postures.items():
        yield f"  # {_POSTURES[name]}"
        inside = ", ".join(f"{plain_name(joint)}: {number(angle, 6)}" for joint, angle in angles.items())
        yield wrapped(f"  {name}: {{{inside}}}", 4)


def _landmark(mark: LandmarkDraft) -> str:
    offset = "" if mark.offset is None else f", offset: {numbers(mark.offset, 4)}"
    return wrapped(
        f"  {mark.name}: {{frame: {mark.name}, follows: {mark.follows}, from: {mark.measured_from}, "
        f"anchor: {mark.anchor}, robot_length: {number(mark.length, 4)}, human_length: {mark.human_length}{offset}}}",
        4,
    )
