"""A motion at another rate: straight lines between the ticks, and the short arc between two orientations.

Nothing is filtered: what moves faster than half the new rate shows as something slower.
"""

from dataclasses import replace

import numpy as np

from retarget.errors import UsageError
from retarget.exporting.motion import Motion, Tracks, quaternion_columns
from retarget.rotations import FloatArray, slerp

__all__ = ["MAX_FPS", "resampled"]

MAX_FPS = 1000.0
EXACT = 1e-9
"""Two rates that differ by less than this share are one."""


def resampled(motion: Motion, fps: float) -> Motion:
    """The motion at `fps` rows per second, from its first row on; nothing is added after its last.

    Raises UsageError for an impossible rate. At its own rate it is returned as it is; otherwise servo goals, which were
    sent at ticks, are left out.
    """
    if not 0.0 < fps <= MAX_FPS:
        raise UsageError("impossible rate", where="--fps", found=f"{fps:g}", allowed=f"above 0, up to {MAX_FPS:g}")
    begin, end = float(motion.time[0]), float(motion.time[-1])
    if len(motion) > 1 and (end - begin) * fps * (1.0 + EXACT) < 1.0:
        raise UsageError(
            "so few rows a second that only one is left",
            where="--fps",
            found=f"{fps:g} in {end - begin:.3g} s",
            allowed=f"{1.0 / (end - begin):.3g} and more, up to {MAX_FPS:g}",
        )
    time = begin + np.arange(int((end - begin) * fps * (1.0 + EXACT)) + 1) / fps
    if len(time) == len(motion) and np.abs(time - motion.time).max() < EXACT:
        return motion
    before = np.clip(np.searchsorted(motion.time, time, side="right") - 1, 0, max(len(motion) - 2, 0))
    after = np.minimum(before + 1, len(motion) - 1)
    gap = np.where(after > before, motion.time[after] - motion.time[before], 1.0)
    share = np.clip((time - motion.time[before]) / gap, 0.0, 1.0)

    def between(values: FloatArray) -> FloatArray:
        weight = share.reshape(-1, *[1] * (values.ndim - 1))
        return np.asarray((1.0 - weight) * values[before] + weight * values[after])

    q = between(motion.q)
    for start in quaternion_columns(motion.body):
        q[:, start : start + 4] = slerp(motion.q[before, start : start + 4], motion.q[after, start : start + 4], share)
    asked = motion.asked
    return replace(
        motion,
        time=time,
        phase=motion.phase[before],
        q=q,
        servos=None if motion.servos is None else between(motion.servos),
        goal_ticks=None,
        asked=None if asked is None else Tracks(asked.names, between(asked.position)),
    )
