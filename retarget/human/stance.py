"""The stance of a performer who stands still to be measured: reasons to refuse it, by sensors alone."""

from collections.abc import Mapping

import numpy as np

from retarget import rotations
from retarget.arithmetic import dot, norm
from retarget.errors import InputError
from retarget.human.posture_prior import ANKLES
from retarget.human.rest_pose import REQUIRED, may_stand
from retarget.types import FloatArray

PAIRS = ("ankle", "wrist", "hip", "shoulder", "knee", "elbow")  # the line from right to left shows where a person faces
NARROWEST_M = 0.05  # nearer pairs show no direction


def facing_of(at: Mapping[str, FloatArray]) -> FloatArray | None:
    """Horizontal unit vector (2,) that an upright person faces, from positions (3,) m of sensors; None if unknown."""
    left = np.zeros(2)
    for part in PAIRS:
        if f"l_{part}" in at and f"r_{part}" in at:
            left += (at[f"l_{part}"] - at[f"r_{part}"])[:2]
    length = norm(left)
    return None if length < NARROWEST_M else np.array([left[1], -left[0]]) / length


TURNED = ("head", "chest", "pelvis")  # their x axis points forward in a person at rest
BACKWARD = -0.5  # cosine to the front; an axis 120 degrees away points backward, and a head turns by 80
TOES_BEHIND_M = 0.05  # a toe this far behind its ankle belongs to a foot that points backward


def refuse_sides(at: Mapping[str, FloatArray], *, where: str, turns: Mapping[str, FloatArray] | None = None) -> None:
    """Raise InputError if left and right are swapped, limbs are crossed, or the performer is mirrored.

    at: positions (3,) m, z up. turns: orientations (4,) wxyz in canonical axes. Passes if the head is not as high as a
    standing person's, as unit or axes are then wrong. Only toes and orientations show a mirror image.
    """
    if "head" not in at or not may_stand(at):
        return
    _refuse_crossed(at, where=where)
    _refuse_backward(at, turns or {}, where=where)


def _refuse_crossed(at: Mapping[str, FloatArray], *, where: str) -> None:
    lines = {part: (at[f"l_{part}"] - at[f"r_{part}"])[:2] for part in PAIRS if {f"l_{part}", f"r_{part}"} <= set(at)}
    if not lines:
        return
    widest = max(lines.values(), key=norm)
    # Distance of each left sensor to the left of its right one, along the line of the widest pair.
    left = {part: dot(line, widest) / max(norm(widest), NARROWEST_M) for part, line in lines.items()}
    other = [f"{part}s" for part, by in left.items() if by < -NARROWEST_M]
    same = [f"{part}s" for part, by in left.items() if by > NARROWEST_M]
    if not other:
        return
    fewer, more = sorted((other, same), key=len)
    exchanged = fewer if len(fewer) < len(more) else [*fewer, *more]
    raise InputError(
        "limbs are crossed, or left and right of some sensors are swapped",
        where=where,
        found=f"left and right of the {', '.join(fewer)} are exchanged, as seen from the {', '.join(more)}",
        allowed="each left sensor to the left of its right one",
        next_step="Let the arms hang, and do not cross the feet. If you stand so, swap the roles of the left and the "
        f"right tracker of the {' or '.join(exchanged)}, or their names in the performer's file",
    )


def _refuse_backward(at: Mapping[str, FloatArray], turns: Mapping[str, FloatArray], *, where: str) -> None:
    forward = facing_of(at)
    if forward is None:
        return
    found = []
    for side, name in (("left", "l"), ("right", "r")):
        if {f"{name}_toe", f"{name}_ankle"} <= set(at):
            ahead = dot((at[f"{name}_toe"] - at[f"{name}_ankle"])[:2], forward)
            found += [f"your {side} toes are {-ahead:.2f} m behind the ankle"] if ahead < -TOES_BEHIND_M else []
    for name in TURNED:
        if name in turns and np.isfinite(turns[name]).all():
            axis = rotations.rotate(turns[name], np.array([1.0, 0.0, 0.0]))
            found += [f"your {name} faces backward"] if dot(axis[:2], forward) < BACKWARD else []
    if found:
        raise InputError(
            "left and right of all sensors are swapped, or the performer is mirrored",
            where=where,
            found="; ".join(found),
            next_step="If a camera shows a mirror image, undo that (`retarget run`: --mirrored-camera); else see that "
            "no axis of what is sent has the wrong sign, and that left trackers are on the left",
        )


FEET_APART_M = 0.5
"""Ankles of a grown person at rest are nearer. Wider ankles lower the head by 1 to 2 %, make long legs, and a first
posture that no robot takes on its soles."""
FEET_LEVEL_M = 0.05  # shoes, straps and noise make less; it changes a stature by 2 %
OFF_BASE_M = 0.15  # the head stands 5 cm ahead of the ankles
HANDS_AHEAD_M = 0.3  # of the head, or behind it: hands that hang or are held aside are nearer
KNEES_AHEAD_M = 0.1  # a knee bent so far lowers the body by 3 cm (2 %)
LOWEST_HEAD_M = 0.7  # below, the sender's axes or unit are wrong, and no posture is judged


def refuse_stance(at: Mapping[str, FloatArray], *, where: str, turns: Mapping[str, FloatArray] | None = None) -> None:
    """Raise InputError for what `refuse_sides` refuses, and for feet that do not stand side by side on one floor."""
    refuse_sides(at, where=where, turns=turns)
    if "head" not in at or not may_stand(at) or not set(ANKLES) <= set(at):
        return
    between = at["l_ankle"] - at["r_ankle"]
    apart, higher = norm(between[:2]), float(between[2])
    found, allowed = [], []
    if apart > FEET_APART_M:
        found.append(f"your ankles are {apart:.2f} m apart")
        allowed.append(f"{FEET_APART_M:g} m apart")
    if abs(higher) > FEET_LEVEL_M:
        one, other = ("left", "right") if higher > 0.0 else ("right", "left")
        found.append(f"your {one} foot is {abs(higher):.2f} m above your {other} one")
        allowed.append(f"{FEET_LEVEL_M:g} m above the other")
    if found:
        raise InputError(
            "the feet do not stand side by side",
            where=where,
            found="; ".join(found),
            allowed=f"at most {', and '.join(allowed)}",
            next_step="Stand with both feet on the floor, as far apart as the hips. If you stand so, see that both "
            "trackers of the feet are worn at the ankles, and none lies elsewhere",
        )


def refuse_crooked(at: Mapping[str, FloatArray], *, where: str) -> None:
    """Raise InputError for a posture whose height is not the stature. at: sensors (3,) m; the performer faces x."""
    feet = [at[name] for name in ANKLES if name in at]
    bases = {"feet": feet if len(feet) == 2 else [], "hips": [at["pelvis"]] if "pelvis" in at else []}
    if not at.keys() >= set(REQUIRED) or any(at["head"][2] - foot[2] < LOWEST_HEAD_M for foot in feet):
        return
    found = []
    for part, base in bases.items():
        ahead, aside = (at["head"] - np.mean(base, axis=0))[:2].tolist() if base else (0.0, 0.0)
        if abs(ahead) > OFF_BASE_M:
            found.append(f"your head is {abs(ahead):.2f} m {'ahead of' if ahead > 0.0 else 'behind'} your {part}")
        if abs(aside) > OFF_BASE_M:
            side = "left" if aside > 0.0 else "right"
            found.append(f"your head is {abs(aside):.2f} m to the {side} of your {part}")
        if found:
            break
    bent = [float(at[f"{s}_knee"][0] - at[f"{s}_ankle"][0]) for s in "lr" if {f"{s}_knee", f"{s}_ankle"} <= at.keys()]
    if bent and max(bent) > KNEES_AHEAD_M:
        found.append(f"your knees are bent, {max(bent):.2f} m ahead of your feet")
    reach = 0.5 * float(at["l_wrist"][0] + at["r_wrist"][0]) - float(at["head"][0])
    if abs(reach) > HANDS_AHEAD_M:
        found.append(f"your hands are {abs(reach):.2f} m {'ahead of' if reach > 0.0 else 'behind'} your head")
    if found:
        step = "Stand upright on both feet, legs straight, looking ahead, arms hanging or straight out to the sides"
        raise InputError("the performer does not stand upright", where=where, found="; ".join(found), next_step=step)
