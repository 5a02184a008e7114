"""A drafted profile: as data, with its landmarks, and as the text of `robot.yaml` with comments that say what is
only a draft.
"""

import json
import re
from collections.abc import Iterable
from dataclasses import dataclass, field
from textwrap import wrap

import numpy as np

from retarget.schema.profile import DRAFT
from retarget.setup.frames import Placed
from retarget.setup.servo_guess import ServoDraft
from retarget.types import FloatArray

# The proposal of `fit-observers` as the sections of a drafted profile.

HEAD = "# Proposed as retarget fit-observers does; what the comments mean is in docs/fitting.md.\n"
EMPTY = "ignore_pairs: []"


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
    observers: str = field(default="observers: {}\nignore_pairs: []\n")


# A drafted profile as `robot.yaml`: in the order of the shipped ones, with comments that say what is only a draft.

WIDTH = 118
FEW_SERVOS, FAST_HZ, SLOW_HZ = 22, 100, 50
"""Up to FEW_SERVOS servos, one line of 1 Mbaud has time to read and write all of them at FAST_HZ; else at SLOW_HZ."""
_PLAIN = re.compile(r"[A-Za-z_][A-Za-z0-9_.-]*")
_RESERVED = {"true", "false", "null", "yes", "no", "on", "off", "y", "n"}
_POSTURES = {
    "neutral": "Where pairs of observers that touch are no longer looked at.",
    "stand": "Where a run begins and ends.",
    "rest": "At rest, before torque goes off.",
    "attractor": "Arms away from the trunk, knees bent: in reach of everything.",
}


def profile_text(draft: Draft) -> str:
    """YAML of a whole profile."""
    parts = [
        _head(draft),
        _frames(draft.frames),
        _servos(draft),
        _buses(draft),
        draft.observers.strip() + "\n",
        _feet(draft),
        _postures(draft),
        _landmarks(draft),
        _safety(draft),
        "reconstruct: human\nretarget: servo\n",
    ]
    return "\n".join(part for part in parts if part)


def _head(draft: Draft) -> str:
    lines = _comment(
        f"{draft.name}: drafted by retarget import from {draft.source}, and not yet tried on a robot. Lines that the "
        f"body file does not settle end in {DRAFT}; take the mark away once a line is right. retarget check counts the "
        "lines that are left."
    )
    lines += _comment("Units m, rad, s, kg; x forward, y left, z up.")
    lines += _comment(f"Front and back: {draft.facing}.")
    for text in draft.missing:
        lines += _comment(f"Not found: {text}.")
    for text in draft.notes:
        lines += _comment(f"Note: {text}.")
    free = {
        "free": "it stands on its own feet; `suspended` while it hangs on a stand",
        "suspended": "it has legs but no soles to stand on, so it hangs on a stand",
        "fixed": "bolted down",
    }[draft.root]
    lines += [f"name: {_name(draft.name)}", f"body: {_name(draft.body)}", f"root: {draft.root}  # {free}"]
    return "\n".join(lines) + "\n"


def _frames(frames: Iterable[FrameDraft]) -> str:
    lines = [*_comment("Found by where axes meet and by the shapes of links; named as the human joints."), "frames:"]
    for frame in frames:
        turn = "" if abs(abs(frame.quat[0]) - 1.0) < 1e-6 else f", quat: {_list(frame.quat, 6)}"
        entry = f"  {frame.name}: {{link: {_name(frame.link)}, pos: {_list(frame.pos, 5)}{turn}}}"
        lines.append(f"{entry}  # {frame.about}" if frame.about else entry)
    return "\n".join(lines) + "\n"


def _servos(draft: Draft) -> str:
    lines = _comment(
        "One line per joint, in the order of the body. For the robot itself, fill in: id (retarget servo scan lists "
        "them), model, direction (-1 where the servo turns the other way), zero_tick (what it reports where the body "
        "file has the joint at 0; retarget servo home finds it), gear (shaft turns per joint turn) where there is one. "
        "Simulated servos do as they are."
    )
    lines += _comment(
        "limits: of the body file. max_velocity: 0.9 of the model's speed without load, or that of the file."
    )
    lines += _comment(
        "max_acceleration: half the stall torque on what hangs on the joint; at most 30 in legs and trunk."
    )
    lines += _comment("gains: the maker's default of the model; a run with physics needs what the servo really has.")
    lines.append("servos:")
    width = max(len(_name(servo.joint)) for servo in draft.servos) + 1
    lines += [_servo(servo, width) for servo in draft.servos]
    return "\n".join(lines) + "\n"


def _servo(servo: ServoDraft, width: int) -> str:
    why = f"id, direction, zero_tick; model: {servo.why}" + (f"; limits: {servo.note}" if servo.note else "")
    return (
        f"  {_name(servo.joint) + ':':<{width}} {{id: {servo.number}, model: {servo.model.name}, bus: main, "
        f"direction: 1, zero_tick: {servo.model.centre_tick}, limits: {_list(servo.limits, 6)},\n"
        f"  {'':<{width}}  max_velocity: {servo.max_velocity:g}, max_acceleration: {servo.max_acceleration:.1f}, "
        f"gains: {{p: {servo.position_p}}}}}"
        f"  {DRAFT} {why}"
    )


def _buses(draft: Draft) -> str:
    ids = ", ".join(str(servo.number) for servo in draft.servos)
    return "\n".join(
        [
            "buses:",
            "  main:",
            f"    port: /dev/ttyUSB0  {DRAFT} retarget servo scan finds it",
            f"    baud: 1000000  {DRAFT} what the servos are set to",
            "    protocol: 2",
            *_wrapped(f"    ids: [{ids}]", 10),
            "",
        ]
    )


def _feet(draft: Draft) -> str:
    if not draft.feet:
        return "feet: {}\n"
    lines = [*_comment("Outlines of the flat undersides of the feet, in the frames of the soles."), "feet:"]
    for foot in draft.feet:
        corners = ", ".join(_list(corner, 4) for corner in foot.polygon)
        lines += _wrapped(f"  {foot.side}: {{frame: {foot.frame}, polygon: [{corners}]}}", 9)
    return "\n".join(lines) + "\n"


def _postures(draft: Draft) -> str:
    stands = "Trunk upright, soles flat, centre of mass over the middle of the soles; " if draft.feet else ""
    lines = [*_comment(stands + "joints that are not named are 0."), "postures:"]
    for name, angles in draft.postures.items():
        lines.append(f"  # {_POSTURES[name]}")
        inside = ", ".join(f"{_name(joint)}: {_number(angle, 6)}" for joint, angle in angles.items())
        lines += _wrapped(f"  {name}: {{{inside}}}", 4)
    return "\n".join(lines) + "\n"


def _landmarks(draft: Draft) -> str:
    about = (
        "Which frame follows which joint of the performer. robot_length is a little less than the stretched limb, so "
        "that a stretched human limb does not ask for a singular one."
    )
    lines = [*_comment(about), "landmarks:"]
    for mark in draft.landmarks:
        offset = "" if mark.offset is None else f", offset: {_list(mark.offset, 4)}"
        lines += _wrapped(
            f"  {mark.name}: {{frame: {mark.name}, follows: {mark.follows}, from: {mark.measured_from}, "
            f"anchor: {mark.anchor}, robot_length: {_number(mark.length, 4)}, "
            f"human_length: {mark.human_length}{offset}}}",
            4,
        )
    return "\n".join(lines) + "\n"


def _safety(draft: Draft) -> str:
    supply = min(servo.model.voltage for servo in draft.servos)
    low, high = (4.0, 6.0) if supply < 9.0 else (10.0, 14.8)
    rate = FAST_HZ if len(draft.servos) <= FEW_SERVOS else SLOW_HZ
    return "\n".join(
        [
            "safety:",
            f"  rate_hz: {rate}  {DRAFT} so often a line of {len(draft.servos)} servos is read and written",
            "  freshness: 0.08  # s: a few ticks, and less than the watchdog of the servos",
            "  speed_caps: {follow: 1.0, approach: 0.2, warm: 0.5}",
            f"  temperature_c: 65  {DRAFT} below where the servos switch themselves off",
            f"  voltage: [{low}, {high}]  {DRAFT} V, of the supply",
            "  following_error: 0.45  # rad, at once: the lag at full speed, and some",
            "  following_error_sustained: 0.3",
            "  following_error_s: 0.2",
            "",
        ]
    )


def _name(name: str) -> str:
    return name if _PLAIN.fullmatch(name) and name.lower() not in _RESERVED else json.dumps(name)


def _list(values: Iterable[float], digits: int) -> str:
    return "[" + ", ".join(_number(value, digits) for value in values) + "]"


def _number(value: float, digits: int) -> str:
    text = f"{value:.{digits}f}".rstrip("0").rstrip(".")
    return "0" if text in ("-0", "") else text


def _wrapped(line: str, indent: int) -> list[str]:
    """Long flow YAML, broken where a space may be a line's end."""
    first = len(line) - len(line.lstrip())
    parts = wrap(line.strip(), WIDTH - indent, break_long_words=False, break_on_hyphens=False)
    return [" " * first + parts[0], *(" " * indent + part for part in parts[1:])]


def _comment(text: str) -> list[str]:
    return [f"# {line}" for line in wrap(text, WIDTH - 2, break_long_words=False, break_on_hyphens=False)]
