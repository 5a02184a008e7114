"""Postures that a robot on planted soles cannot take: kneeling, lying or sitting on the floor, jumping."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from math import inf

import numpy as np

from retarget.human.support_phase import LONGEST_FLIGHT_S
from retarget.ik.gravity_torque import GRAVITY
from retarget.model.human_dimensions import POINTS, HumanDimensions
from retarget.report.motion_metrics import spans
from retarget.report.report import Unfollowed
from retarget.report.tracking import ReferenceMotion
from retarget.run.record import Phase, Record
from retarget.run.run_result import RunResult
from retarget.types import BoolArray, FloatArray, News, Notify

KNEELS, ON_FLOOR, JUMPS = "kneels", "lies or sits on the floor", "jumps"
INSTEAD: Mapping[str, str] = {KNEELS: "squats", ON_FLOOR: "squats", JUMPS: "stays on its soles"}
"""The posture of the robot meanwhile."""
SHOWING_JOINTS = (*(f"{side}_{part}" for part in ("hip", "knee", "ankle", "toe") for side in "lr"), "neck")

LEAST_S = 0.3
"""Shortest posture, s, that is reported, because a robot needs longer to squat and rise. Shorter breaks do not end a
posture."""
FLOOR_PERCENTILE = 5.0
"""Percentile of the lower foot's height at which the floor lies, because bad frames may be lower."""
KNEE_SHARE = 0.12
"""Height of a kneeling knee above standing ankles, as a share of the leg: 0.1 m. In the deepest squat it is 0.3 m."""
HIP_SHARE = 0.12
"""The same for the hips of a performer on the floor: 0.05 m sitting, 0.13 m and more in a deep squat."""
FOOT_SHARE = 0.04
"""Rise of ankles and toes in a jump, as a share of the leg: 0.03 m, more than noise and the roll of a foot."""
FALLING = 0.5
"""Least acceleration of the hips in a jump, as a share of gravity; swinging limbs take part of it."""
UPRIGHT = 0.5
"""Least height of the neck above the hips, as a share of the trunk, which excludes crawls and cartwheels."""


def unfollowed_of(run: RunResult, reference: ReferenceMotion | None) -> tuple[Unfollowed, ...] | None:
    """The postures that the robot of a run could not follow, by time; None for a robot without planted soles, or whose
    legs do not follow. A complete recorded body counts before the reconstructed one."""
    rows = run.record.following
    if reference is None or run.robot is None or not run.robot.stands or run.setup.parts != "whole":
        return None
    columns = [reference.joint_names.index(name) for name in SHOWING_JOINTS]
    truth, joints = run.truth_of(SHOWING_JOINTS, rows), reference.joints[rows][:, columns]
    if truth is not None and np.isfinite(truth).any(axis=(0, 2)).all():
        joints = truth
    time = run.record.time[rows]
    found = unfollowed(joints, leg_length(reference.dimensions), run.clip.motion_dt)
    named = [Unfollowed(what, float(time[first]), float(time[last])) for what, first, last in found]
    return tuple(sorted(named, key=lambda one: one.from_s))


def unfollowed(joints: FloatArray, leg: float, dt: float) -> Iterator[tuple[str, int, int]]:
    """Yield each posture with its first and last row. joints (T, m, 3) m: `SHOWING_JOINTS`; leg: m; dt: s of the
    performer's time."""
    heights = _heights(joints)
    if not np.isfinite(heights.ankle).any():
        return
    floor, toes_floor = (float(np.nanpercentile(feet, FLOOR_PERCENTILE)) for feet in (heights.ankle, heights.toe))
    on_the_floor, off = _seen(heights, floor, toes_floor, leg)
    for what, holds in on_the_floor.items():
        closed = holds.copy()
        for (_, before), (after, _) in pairwise(spans(holds)):
            if (after - before + 1) * dt < LEAST_S:
                closed[before:after] = True
        for first, end in spans(closed):
            if (end - 1 - first) * dt >= LEAST_S:
                yield what, first, end - 1
    for first, end in spans(off):
        if heights.upright[first:end].all() and _is_jump(heights.hips[first:end], dt):
            yield JUMPS, first, end - 1


@dataclass(frozen=True, eq=False)
class _Heights:
    """Heights (T,) m of the lower ankle, toe, hip and knee, and of the middle of the hips. upright (T,): of the
    trunk."""

    ankle: FloatArray
    toe: FloatArray
    hip: FloatArray
    knee: FloatArray
    hips: FloatArray
    upright: BoolArray


def _heights(joints: FloatArray) -> _Heights:
    at = dict(zip(SHOWING_JOINTS, np.moveaxis(joints, 1, 0), strict=True))
    lower = {part: np.minimum(at[f"l_{part}"][:, 2], at[f"r_{part}"][:, 2]) for part in ("ankle", "toe", "hip", "knee")}
    hips = 0.5 * (at["l_hip"] + at["r_hip"])
    trunk = at["neck"] - hips
    upright = trunk[:, 2] > UPRIGHT * np.linalg.norm(trunk, axis=1)
    return _Heights(**lower, hips=hips[:, 2], upright=upright)


def _seen(heights: _Heights, floor: float, toes_floor: float, leg: float) -> tuple[Mapping[str, BoolArray], BoolArray]:
    """Rows (T,) of each posture on the floor, and those with both feet off it. floor, toes_floor: standing heights, m,
    of ankles and toes."""
    on_floor = heights.hip - floor < HIP_SHARE * leg
    kneels = (heights.knee - floor < KNEE_SHARE * leg) & heights.upright & ~on_floor
    off = (heights.ankle - floor > FOOT_SHARE * leg) & (heights.toe - toes_floor > FOOT_SHARE * leg)
    return {KNEELS: kneels, ON_FLOOR: on_floor}, off


def _is_jump(hips: Sequence[float] | FloatArray, dt: float) -> bool:
    """True if the hips, (T,) m, fall freely for about as long as a jump takes."""
    lasts, bulge = (len(hips) - 1) * dt, float(np.mean(hips)) - 0.5 * (hips[0] + hips[-1])
    free_fall = GRAVITY * lasts**2 / 12.0  # mean of g t (T - t) / 2 over T
    return LEAST_S <= lasts <= LONGEST_FLIGHT_S and bool(bulge > FALLING * free_fall)


FLOOR_M_S = 0.4
"""Rate of the estimate of the floor: 2 cm/s up, as a foot rises with each step, and 38 cm/s down."""
AGAIN_S = 10.0
"""Least time, s, between two reports of a posture."""


class UnfollowedNotice:
    """Reports a posture that the robot does not follow while it happens, a jump after it."""

    def __init__(self, dimensions: HumanDimensions, *, dt: float, notify: Notify) -> None:
        """dt: s of the performer's time between rows."""
        self._columns = [POINTS.index(name) for name in SHOWING_JOINTS]
        self._leg, self._dt, self._notify = leg_length(dimensions), dt, notify
        self._floors: tuple[float, float] | None = None
        self._lasted, self._flight = dict.fromkeys((KNEELS, ON_FLOOR), 0.0), list[float]()
        self._time, self._named = 0.0, dict.fromkeys(INSTEAD, -inf)  # [s]

    def __call__(self, record: Record, row: int) -> None:
        """Look at a filled row."""
        if record.phase[row] != Phase.FOLLOW:
            return
        heights = _heights(record.human_joints[row : row + 1, self._columns])
        feet = float(heights.ankle[0]), float(heights.toe[0])
        floors = feet if self._floors is None else self._floors
        self._floors = floor, toes_floor = self._risen(floors[0], feet[0]), self._risen(floors[1], feet[1])
        self._time += self._dt
        on_the_floor, off = _seen(heights, floor, toes_floor, self._leg)
        for what, holds in on_the_floor.items():
            self._lasted[what] = self._lasted[what] + self._dt if holds[0] else 0.0
            if self._lasted[what] >= LEAST_S:
                self._name(what)
        if off[0] and heights.upright[0]:
            self._flight.append(float(heights.hips[0]))
        elif self._flight:
            if _is_jump(self._flight, self._dt):
                self._name(JUMPS)
            self._flight.clear()

    def _risen(self, floor: float, foot: float) -> float:
        share = 0.01 * FLOOR_PERCENTILE
        return floor + FLOOR_M_S * self._dt * (share if foot > floor else share - 1.0)

    def _name(self, what: str) -> None:
        if self._time - self._named[what] > AGAIN_S:
            self._notify(News(f"the performer {what}: the robot {INSTEAD[what]} instead"))
        self._named[what] = self._time


def leg_length(dimensions: HumanDimensions) -> float:
    """Mean length of thigh and shank, m, of both legs."""
    return 0.5 * sum(dimensions.length(f"{side}_{part}") for side in "lr" for part in ("knee", "ankle"))
