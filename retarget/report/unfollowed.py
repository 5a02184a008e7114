"""Postures that a robot on planted soles cannot take: kneeling, lying or sitting on the floor, jumping."""

from collections.abc import Iterator, Mapping
from itertools import pairwise

import numpy as np

from retarget.human.posture_prior import LONGEST_FLIGHT_S
from retarget.ik.gravity_torque import GRAVITY
from retarget.model.human_dimensions import HumanDimensions
from retarget.report.report import Unfollowed
from retarget.report.tracking import Performance
from retarget.run.run_result import RunResult
from retarget.types import BoolArray, FloatArray

KNEELS, ON_FLOOR, JUMPS = "kneels", "lies or sits on the floor", "jumps"
INSTEAD: Mapping[str, str] = {KNEELS: "squats", ON_FLOOR: "squats", JUMPS: "stays on its soles"}
"""The posture that the robot takes instead."""
JOINTS = (*(f"{side}_{part}" for part in ("hip", "knee", "ankle", "toe") for side in "lr"), "neck")
"""Joints of the performer that show it."""

LEAST_S = 0.3
"""Shortest time, s, that is named. A stumble is over sooner, and a robot cannot squat and rise again in less. Shorter
breaks do not end a posture on the floor."""
FLOOR_PERCENTILE = 5.0
"""Standing height is this percentile, %, of the height of the lower foot over the run: recordings and trackers have the
floor anywhere, and a few bad frames may be lower."""
KNEE_SHARE = 0.12
"""Height of a knee above standing ankles, as a share of the leg: about 0.1 m. A knee on the floor is 0.03 m below them
to 0.03 m above; that of the deepest squat is 0.3 m above."""
HIP_SHARE = 0.12
"""The same of the lower hip. One who sits or lies has it 0.05 m above standing ankles. One who squats with thighs on
the shanks, or sits on the heels, has it 0.13 m above them or more."""
FOOT_SHARE = 0.04
"""Height of ankles and toes above where they stand, as a share of the leg: 0.03 m. Shoes, noise and the roll of a foot
are less."""
FALLING = 0.5
"""Least curve of the hips' path in a jump, as a share of free fall's. Arms and legs that swing take a part of it. A
performer who stands on a step, sits or is lifted with the feet up shows none."""
UPRIGHT = 0.5
"""Least share of the trunk's length by which the neck is above the hips: within 60 degrees of upright. On all fours a
trunk is level, in a cartwheel it is upside down."""


def unfollowed_of(run: RunResult, asked: Performance | None) -> tuple[Unfollowed, ...] | None:
    """The postures of a run that its robot could not follow, in the order of their time; None for a robot without
    planted soles, or whose legs do not follow.

    The performer is the recorded body where the file knows all `JOINTS`, else the reconstructed one.
    """
    rows = run.record.following
    if asked is None or run.robot is None or not run.robot.stands or run.setup.parts != "whole":
        return None
    columns = [asked.joint_names.index(name) for name in JOINTS]
    truth, joints = run.human_truth, asked.joints[rows][:, columns]
    if truth is not None and np.isfinite(truth[rows][:, columns]).any(axis=(0, 2)).all():
        joints = truth[rows][:, columns]
    time = run.record.time[rows]
    found = unfollowed(joints, leg_length(asked.dimensions), run.clip.motion_dt)
    named = [Unfollowed(what, float(time[first]), float(time[last])) for what, first, last in found]
    return tuple(sorted(named, key=lambda one: one.from_s))


def unfollowed(joints: FloatArray, leg: float, dt: float) -> Iterator[tuple[str, int, int]]:
    """Each posture with its first and last row. joints (T, m, 3) m: those of `JOINTS`; leg: m; dt: s of the performer's
    time between rows."""
    at = dict(zip(JOINTS, np.moveaxis(joints, 1, 0), strict=True))
    hips, knees, ankles, toes = (
        np.stack([at[f"{side}_{part}"][:, 2] for side in "lr"], axis=1) for part in ("hip", "knee", "ankle", "toe")
    )
    if not np.isfinite(ankles).any():
        return
    trunk = at["neck"] - 0.5 * (at["l_hip"] + at["r_hip"])
    upright = trunk[:, 2] > UPRIGHT * np.linalg.norm(trunk, axis=1)
    floor, toes_floor = (np.nanpercentile(feet.min(axis=1), FLOOR_PERCENTILE) for feet in (ankles, toes))
    on_floor = hips.min(axis=1) - floor < HIP_SHARE * leg
    kneels = (knees.min(axis=1) - floor < KNEE_SHARE * leg) & upright & ~on_floor
    off = (ankles.min(axis=1) - floor > FOOT_SHARE * leg) & (toes.min(axis=1) - toes_floor > FOOT_SHARE * leg)
    for what, holds in ((KNEELS, kneels), (ON_FLOOR, on_floor)):
        for first, last in _spans(_closed(holds, dt)):
            if (last - first) * dt >= LEAST_S:
                yield what, first, last
    for first, last in _spans(off):
        flight = slice(first, last + 1)
        lasts, bulge = (last - first) * dt, _bulge(hips[flight].mean(axis=1))
        falls = bulge > FALLING * GRAVITY * lasts**2 / 12.0  # of a free fall: mean of g t (T - t) / 2 over T
        if LEAST_S <= lasts <= LONGEST_FLIGHT_S and falls and upright[flight].all():
            yield JUMPS, first, last


def _bulge(height: FloatArray) -> float:
    """Mean height, m, of a path (T,) m over the middle of its ends."""
    return float(np.mean(height) - 0.5 * (height[0] + height[-1]))


def leg_length(dimensions: HumanDimensions) -> float:
    """Length of thigh and shank, m: the mean of both legs."""
    return 0.5 * sum(dimensions.length(f"{side}_{part}") for side in "lr" for part in ("knee", "ankle"))


def _spans(holds: BoolArray) -> list[tuple[int, int]]:
    """First and last row of each run of rows (T,) that are true."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], holds, [False]]).astype(np.int8)))
    return [(int(first), int(end) - 1) for first, end in edges.reshape(-1, 2)]


def _closed(holds: BoolArray, dt: float) -> BoolArray:
    """The rows (T,), with breaks between true ones filled that are shorter than `LEAST_S`."""
    closed, spans = holds.copy(), _spans(holds)
    for (_, before), (after, _) in pairwise(spans):
        if (after - before) * dt < LEAST_S:
            closed[before:after] = True
    return closed
