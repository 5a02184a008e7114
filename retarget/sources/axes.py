"""The axes of a motion file, decided by the body in it: which is up, and whether left and right are mirrored.

What a file declares (a rest pose, the Y_SCREEN of a C3D) is often wrong, while people mostly stand on their feet on the
ground, their knees bend forward and their toes point there.
"""

from collections.abc import Mapping

import numpy as np

from retarget.arithmetic import norms
from retarget.errors import UsageError
from retarget.types import FloatArray

UP_AXES: Mapping[str, FloatArray] = {
    f"{sign}{axis}": 0.0 + factor * row
    for axis, row in zip("xyz", np.eye(3), strict=True)
    for sign, factor in (("", 1.0), ("-", -1.0))
}
"""Name of a signed coordinate axis -> its unit vector (3,)."""

UPRIGHT = 0.7
"""Mean share of the line from ankles to head that must lie along an axis before the frames decide what is up: below
(45 degrees), another axis may be as near."""
NEAR_GROUND = 0.3
"""Greatest height of the ankles above the plane through the origin, as a share of the distance from ankles to head, of
a body that stands there: ankles are 0.06 of it above the soles, and whoever stands on a box all the time stands no
higher than a knee."""
ON_FLOOR = (-0.03, 0.15)
"""Height of the lowest of head, hips and ankles above the plane through the origin, in the same share, of a body that
stands, sits, crawls or lies on that floor: joints of a body that touches it are a few centimetres below (soft mats,
errors of calibration) to a hand's breadth and more above (ankles on heels, hips in flesh)."""
OFTEN = 0.9
"""Share of the frames in which a body is on its floor: people are in the air for parts of a second."""

TOES_ALIGNED = 0.3
"""Least mean cosine between a foot and where left and right say that it points, before it shows what is forward: feet
turn out by up to 60 degrees (0.5), and lose some in steps to the side."""
KNEES_FORWARD, KNEES_BACK = 0.02, -0.07
"""Mean distance of a knee in front of the line between hip and ankle, as a share of their distance, from which it shows
that the front is right, and from which that it is wrong. Healthy knees overstretch by up to 10 degrees (0.04), so only
more than 16 degrees backwards is the bend of a knee in a mirrored file."""


def named_axis(name: str) -> FloatArray:
    """Unit vector (3,) of an axis that the user names (x, -y, +z). Raises UsageError."""
    key = name.lower().removeprefix("+")
    if key not in UP_AXES:
        raise UsageError("unknown axis", where="--up", found=repr(name), allowed=", ".join(UP_AXES))
    return UP_AXES[key]


def axis_name(axis: FloatArray) -> str:
    """Name of the signed coordinate axis that is nearest to a direction (3,)."""
    index = int(np.argmax(np.abs(axis)))
    return ("-" if axis[index] < 0.0 else "") + "xyz"[index]


def axes_with_up(up: FloatArray) -> FloatArray:
    """World axes (3, 3) of a file with this signed up axis (3,): the file's axes in their cyclic order (y up: forward
    z, left x), as rows forward, left, up. The heading stays as recorded.
    """
    assert any(np.array_equal(up, axis) for axis in UP_AXES.values()), "up is a signed axis of the file"
    axis = int(np.argmax(np.abs(up)))
    first, second = np.eye(3)[(axis + 1) % 3], np.eye(3)[(axis + 2) % 3]
    return np.stack((first, second, up) if up[axis] > 0 else (second, first, up))


def world_axes(
    tracks: Mapping[str, FloatArray],
    *,
    declared: FloatArray | None,
    declared_by: str = "the file",
    usual: FloatArray,
    said: FloatArray | None = None,
) -> tuple[FloatArray, tuple[str, ...]]:
    """World axes (3, 3) of a recording as rows forward, left, up, each along a file axis, and notes for the user.

    `position @ axes.T` is the recording in the world; the determinant is -1 where the file is mirrored.

    tracks: canonical joints or sensors (T, 3) in file axes, NaN where lost; of use are head, hips, knees, ankles, toes.
    declared (3,): the signed axis that is up as the file has it, None if it says nothing. declared_by: what in the file
    says so, for notes.
    usual (3,): what is taken where neither the file nor the body says anything. said (3,): what the user says
    (`--up`), which overrules all.
    """
    up, notes = _up_axis(tracks, declared=declared, declared_by=declared_by, usual=usual, said=said)
    axes = axes_with_up(up)
    if forward_sign(tracks) >= 0.0:
        return axes, notes
    note = (
        "the file is mirrored (left-handed axes): knees and toes point backwards for its left and right. It is read "
        "with one axis reversed; if instead left and right are named the wrong way round, add --mirror"
    )
    return np.stack((axes[0], 0.0 - axes[1], axes[2])), (*notes, note)


def _up_axis(
    tracks: Mapping[str, FloatArray],
    *,
    declared: FloatArray | None,
    declared_by: str,
    usual: FloatArray,
    said: FloatArray | None,
) -> tuple[FloatArray, tuple[str, ...]]:
    """Up (3,) and notes; arguments as of `world_axes`.

    The frames overrule the file only where the body stands along another axis, near the ground, and is not on the floor
    of the declared one: a performer who crawls there lies along another axis too.
    """
    stands = _standing_axis(tracks)
    if said is not None:
        against = [
            f"{axis_name(axis)} by {by}"
            for axis, by in ((declared, declared_by), (stands, "the frames"))
            if axis is not None and axis_name(axis) != axis_name(said)
        ]
        return said, (f"up axis {axis_name(said)}, as --up says ({', '.join(against)})",) if against else ()
    if declared is None:
        if stands is not None:
            return stands, (f"up axis not stated: taken as {axis_name(stands)}, along which the body stands",)
        return usual, (f"up axis not stated: taken as {axis_name(usual)} (change it with --up)",)
    if stands is None or axis_name(stands) == axis_name(declared):
        return declared, ()
    old, new = axis_name(declared), axis_name(stands)
    if _on_floor(tracks, declared):
        return declared, (
            f"the body lies along {new}, on the floor of its up axis {old}: if it stands, add --up={new}",
        )
    if not abs(float(np.nanmin(_heights(tracks, ("ankle",), stands)))) < NEAR_GROUND:  # nor NaN
        return declared, ()
    return stands, (
        f"the body stands along {new} in the frames: taken as the up axis, though {declared_by} says {old} "
        "(change it with --up)",
    )


def _standing_axis(tracks: Mapping[str, FloatArray]) -> FloatArray | None:
    """The signed axis along which the head is above the ankles on average; None where that is no clear one."""
    high, low = _middle(tracks, "head"), _middle(tracks, "ankle")
    if high is None or low is None:
        return None
    line = high - low
    length = norms(line)
    seen = length > 0.0  # nor NaN
    if not seen.any():
        return None
    direction = np.mean(line[seen] / length[seen, None], axis=0)
    axis = int(np.argmax(np.abs(direction)))
    return UP_AXES[axis_name(direction)] if abs(direction[axis]) >= UPRIGHT else None


def _on_floor(tracks: Mapping[str, FloatArray], up: FloatArray) -> bool:
    """True where the body is on the floor through the origin with this up axis, in nearly all frames."""
    heights = _heights(tracks, ("head", "hip", "ankle"), up)
    lowest = np.fmin.reduce(heights, axis=1)
    lowest = lowest[np.isfinite(lowest)]
    low, high = ON_FLOOR
    return lowest.size > 0 and float(np.mean((lowest > low) & (lowest < high))) >= OFTEN


def _heights(tracks: Mapping[str, FloatArray], parts: tuple[str, ...], up: FloatArray) -> FloatArray:
    """Heights (T, k) of joints of these parts above the plane through the origin, as shares of the distance from ankles
    to head."""
    high, low = _middle(tracks, "head"), _middle(tracks, "ankle")
    assert high is not None and low is not None, "a body that stands has both"
    size = float(np.nanmedian(norms(high - low)))
    names = [name for name in tracks if name.removeprefix("l_").removeprefix("r_") in parts]
    return np.stack([(tracks[name] * up).sum(axis=1) for name in names], axis=1) / size


def _middle(tracks: Mapping[str, FloatArray], part: str) -> FloatArray | None:
    """Track (T, 3) of a part of the body, half way between left and right; None without it."""
    if part in tracks:
        return tracks[part]
    if f"l_{part}" in tracks and f"r_{part}" in tracks:
        return 0.5 * (tracks[f"l_{part}"] + tracks[f"r_{part}"])
    return None


# Which way is forward: shown by feet and knees, whatever left and right are called.


def forward_sign(tracks: Mapping[str, FloatArray]) -> float:
    """1 where feet and knees point to the front that left and right give, -1 where they point backwards (a mirrored
    file), 0 where neither shows it or they disagree.

    tracks: as of `world_axes`, in any axes; of use are hips (else ankles), knees, ankles, toes.
    """
    across = None
    for part in ("hip", "shoulder", "ankle"):
        if across is None and f"l_{part}" in tracks and f"r_{part}" in tracks:
            across = tracks[f"l_{part}"] - tracks[f"r_{part}"]
    if across is None:
        return 0.0
    shows = {"toe": (-TOES_ALIGNED, TOES_ALIGNED), "knee": (KNEES_BACK, KNEES_FORWARD)}
    signs = []
    for part, (back, front) in shows.items():
        shares = [_pointing(tracks, side, part, across) for side in "lr"]
        known = np.concatenate([share[np.isfinite(share)] for share in shares])
        mean = float(np.mean(known)) if known.size else 0.0
        if not back <= mean <= front:
            signs.append(float(np.sign(mean)))
    return signs[0] if signs and min(signs) == max(signs) else 0.0


def _pointing(tracks: Mapping[str, FloatArray], side: str, part: str, across: FloatArray) -> FloatArray:
    """Share (T,) by which toe or knee point to the front that `across` (T, 3), from right to left, gives: of a toe its
    cosine, of a knee its bend as a share of the leg. It is empty where the leg is not known."""
    needed = [f"{side}_{name}" for name in (("knee", "ankle", "toe") if part == "toe" else ("hip", "knee", "ankle"))]
    if not set(needed) <= set(tracks):
        return np.zeros(0)
    first, second, third = (tracks[name] for name in needed)
    along = first - second if part == "toe" else first - third  # up the leg
    front = np.cross(across, along)
    pointing = third - second if part == "toe" else second - 0.5 * (first + third)
    length = norms(pointing if part == "toe" else along) * norms(front)
    seen = length > 0.0
    return np.asarray((pointing[seen] * front[seen]).sum(axis=1) / length[seen])
