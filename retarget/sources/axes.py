"""World axes of a motion file, decided by the recorded body: the up axis, and whether left and right are mirrored.

A declared axis is often wrong, but people mostly stand on the ground, and their knees and toes point forward.
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
"""Least mean cosine between the line from ankles to head and the axis along which a body stands: 45 degrees."""
NEAR_GROUND = 0.3
"""Greatest height of a standing body's ankles above the plane through the origin, as a share of the distance from
ankles to head: a box to stand on is no higher than a knee."""
ON_FLOOR = (-0.03, 0.15)
"""Height of the lowest of head, hips and ankles of a body on the floor, in the same share: a little below it for
calibration errors, above it for ankles on heels and hips in flesh."""
OFTEN = 0.9
"""Share of frames in which a body is on its floor: jumps last parts of a second."""

TOES_ALIGNED = 0.3
"""Least mean cosine between feet and forward that shows it: feet turn out by up to 60 degrees (0.5), more in side
steps."""
KNEES_FORWARD, KNEES_BACK = 0.02, -0.07
"""Mean bend of a knee to the front, as a share of the leg, that shows forward, or the reverse: knees overstretch by up
to 10 degrees (-0.04)."""


def named_axis(name: str) -> FloatArray:
    """Unit vector (3,) of the axis that the user named (x, -y, +z). Raises UsageError."""
    key = name.lower().removeprefix("+")
    if key not in UP_AXES:
        raise UsageError("unknown axis", where="--up", found=repr(name), allowed=", ".join(UP_AXES))
    return UP_AXES[key]


def axis_name(axis: FloatArray) -> str:
    """Name of the signed coordinate axis nearest to a direction (3,)."""
    index = int(np.argmax(np.abs(axis)))
    return ("-" if axis[index] < 0.0 else "") + "xyz"[index]


def axes_with_up(up: FloatArray) -> FloatArray:
    """World axes (3, 3) in file axes, as rows forward, left, up (3,), in cyclic order: with y up, z is forward and x
    left."""
    assert any(np.array_equal(up, axis) for axis in UP_AXES.values()), "up is a signed axis of the file"
    axis = int(np.argmax(np.abs(up)))
    first, second = np.eye(3)[(axis + 1) % 3], np.eye(3)[(axis + 2) % 3]
    return np.stack((first, second, up) if up[axis] > 0 else (second, first, up))


def world_axes(
    tracks: Mapping[str, FloatArray],
    *,
    declared: FloatArray | None,
    declared_by: str = "the file",
    default: FloatArray,
    chosen: FloatArray | None = None,
) -> tuple[FloatArray, tuple[str, ...]]:
    """World axes (3, 3) of a recording as rows forward, left, up, each along a file axis, and notes for the user.

    `position @ axes.T` is the recording in the world; the determinant is -1 if the file is mirrored. tracks: canonical
    joints or sensors (T, 3) in file axes, NaN where lost. declared (3,): the up axis of the file by `declared_by`, None
    if not stated. default (3,): the up axis if neither file nor body shows it. chosen (3,): the user's up axis.
    """
    stands = _standing_axis(tracks)
    notes: tuple[str, ...] = ()
    if chosen is not None:
        up = chosen
        against = [
            f"{axis_name(axis)} by {by}"
            for axis, by in ((declared, declared_by), (stands, "the frames"))
            if axis is not None and axis_name(axis) != axis_name(chosen)
        ]
        if against:
            notes = (f"up axis {axis_name(chosen)}, as --up says ({', '.join(against)})",)
    elif declared is None and stands is not None:
        up, notes = stands, (f"up axis not stated: taken as {axis_name(stands)}, along which the body stands",)
    elif declared is None:
        up, notes = default, (f"up axis not stated: taken as {axis_name(default)} (change it with --up)",)
    elif stands is None or axis_name(stands) == axis_name(declared):
        up = declared
    elif _on_floor(tracks, declared):  # a performer who crawls lies along another axis too
        old, new = axis_name(declared), axis_name(stands)
        note = f"the body lies along {new}, on the floor of its up axis {old}: if it stands, add --up={new}"
        up, notes = declared, (note,)
    elif not abs(float(np.nanmin(_heights(tracks, ("ankle",), stands)))) < NEAR_GROUND:  # False for NaN
        up = declared
    else:
        note = (
            f"the body stands along {axis_name(stands)} in the frames: taken as the up axis, though {declared_by} says "
            f"{axis_name(declared)} (change it with --up)"
        )
        up, notes = stands, (note,)
    axes = axes_with_up(up)
    if forward_sign(tracks) >= 0.0:
        return axes, notes
    note = (
        "the file is mirrored (left-handed axes): knees and toes point backwards for its left and right. It is read "
        "with one axis reversed; if instead left and right are named the wrong way round, add --mirror"
    )
    return np.stack((axes[0], 0.0 - axes[1], axes[2])), (*notes, note)


def _standing_axis(tracks: Mapping[str, FloatArray]) -> FloatArray | None:
    """The signed axis along which the head is above the ankles on average; None if unclear."""
    high, low = _middle(tracks, "head"), _middle(tracks, "ankle")
    if high is None or low is None:
        return None
    line = high - low
    length = norms(line)
    seen = length > 0.0  # False for NaN
    if not seen.any():
        return None
    direction = np.mean(line[seen] / length[seen, None], axis=0)
    axis = int(np.argmax(np.abs(direction)))
    return UP_AXES[axis_name(direction)] if abs(direction[axis]) >= UPRIGHT else None


def _on_floor(tracks: Mapping[str, FloatArray], up: FloatArray) -> bool:
    """True if the body is on the floor through the origin in nearly all frames."""
    heights = _heights(tracks, ("head", "hip", "ankle"), up)
    lowest = np.fmin.reduce(heights, axis=1)
    lowest = lowest[np.isfinite(lowest)]
    low, high = ON_FLOOR
    return lowest.size > 0 and float(np.mean((lowest > low) & (lowest < high))) >= OFTEN


def _heights(tracks: Mapping[str, FloatArray], parts: tuple[str, ...], up: FloatArray) -> FloatArray:
    """Heights (T, k) of parts above the plane through the origin, as shares of the distance from ankles to head."""
    high, low = _middle(tracks, "head"), _middle(tracks, "ankle")
    assert high is not None and low is not None, "a body that stands has both"
    size = float(np.nanmedian(norms(high - low)))
    names = [name for name in tracks if name.removeprefix("l_").removeprefix("r_") in parts]
    return np.stack([(tracks[name] * up).sum(axis=1) for name in names], axis=1) / size


def _middle(tracks: Mapping[str, FloatArray], part: str) -> FloatArray | None:
    """Track (T, 3) of a part, half way between left and right."""
    if part in tracks:
        return tracks[part]
    if f"l_{part}" in tracks and f"r_{part}" in tracks:
        return 0.5 * (tracks[f"l_{part}"] + tracks[f"r_{part}"])
    return None


def forward_sign(tracks: Mapping[str, FloatArray]) -> float:
    """1 if feet and knees point to the front that left and right give, -1 if backwards (a mirrored file), 0 if unclear.
    tracks: as for `world_axes`."""
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
    """Share (T,) by which a toe (cosine) or a knee (bend per leg length) points to the front that `across` (T, 3), from
    right to left, gives; empty for an unknown leg."""
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
