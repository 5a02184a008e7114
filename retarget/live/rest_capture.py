"""Calibration of a live performer: a second of standing still in the rest pose gives size, floor and heading."""

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np

from retarget import rotations
from retarget.arithmetic import arctan2, cos, matmul, norm, norms, sin
from retarget.errors import InputError
from retarget.frames import SensorSample
from retarget.human.pose_validation import ValidityState
from retarget.human.rest_pose import ALIKE_RAD, REQUIRED, fit_rest_pose
from retarget.human.stance import TURNED, facing_of, refuse_crooked, refuse_stance
from retarget.live.advice import refusal
from retarget.live.stream import StreamReading
from retarget.model.human_dimensions import FRACTIONS, POINTS, HumanDimensions, proportional_dimensions
from retarget.types import BoolArray, FloatArray


@dataclass(frozen=True, eq=False)
class Alignment:
    """Maps the stream's world to ours: `origin` (3,) m becomes (0, 0, 0), then a turn by `yaw` (rad, about z)."""

    yaw: float = 0.0
    origin: FloatArray = field(default_factory=lambda: np.zeros(3))

    @cached_property
    def _matrix(self) -> FloatArray:
        cosine, sine = cos(self.yaw), sin(self.yaw)
        return np.array([[cosine, sine, 0.0], [-sine, cosine, 0.0], [0.0, 0.0, 1.0]])

    @cached_property
    def _product(self) -> FloatArray:
        half = 0.5 * self.yaw
        return rotations.multiply(np.array([cos(half), 0.0, 0.0, sin(half)]), np.eye(4))

    def positions(self, sent: FloatArray) -> FloatArray:
        """Positions (..., 3) m of the stream's world -> ours."""
        return matmul(sent - self.origin, self._matrix)

    def orientations(self, sent: FloatArray) -> FloatArray:
        """Orientations (..., 4) wxyz of the stream's world -> ours."""
        return matmul(sent, self._product)

    def turned(self, yaw: float, about: FloatArray) -> "Alignment":
        """This alignment, then a turn by `yaw` rad about the vertical through (3,) m of our world."""
        about = np.array([about[0], about[1], 0.0])
        # The point p that comes to the origin: turn(yaw) @ (R (p - o) - about) + about = 0.
        back = matmul(Alignment(yaw)._matrix, about)
        return Alignment(self.yaw + yaw, self.origin + matmul(self._matrix, about - back))


def align(names: tuple[str, ...], position: FloatArray, *, where: str = "") -> Alignment:
    """The alignment in which an upright performer faces x, on the floor, above the origin.

    position (k, 3) m: of k sensors, stream's world, z up, NaN where unknown. Without ankles the stream's own floor is
    used. Raises InputError if left and right show no direction.
    """
    at = _located(names, position)
    forward = facing_of(at)
    if forward is None:
        raise refusal(InputError, "no direction", where, found=", ".join(at) or "no sensor")
    ankles = [at[name] for name in ("l_ankle", "r_ankle") if name in at]
    middle = np.mean(ankles or list(at.values()), axis=0)
    floor = 0.0
    if len(ankles) == 2 and "head" in at:
        above = at["head"][2] - middle[2]
        floor = middle[2] - FRACTIONS.ankle_height / (FRACTIONS.head_height - FRACTIONS.ankle_height) * above
    return Alignment(yaw=-arctan2(forward[1], forward[0]), origin=np.array([middle[0], middle[1], floor]))


CAPTURE_S = 1.0  # time of standing still
KNOWN_CAPTURE_S = 0.5  # the same for a known size, when only floor and heading are measured
OTHER_SHARE = 0.1  # a stature that differs more from the known one is another person's, or a bent one's
SWAY_M = 0.03  # distance of a sensor from its mean; breathing and swaying move a head by a centimetre
LIVE_STATURE_M = (1.2, 2.2)  # a smaller performer crouches, kneels or sits, or the unit is wrong
FRESH_SHARE = 0.9  # of the capture, in which a sensor must be fresh to count
FEWEST_SAMPLES = 20  # samples of a capture
MOST_SAMPLES = 1000  # samples that are kept


@dataclass(frozen=True, eq=False)
class Calibrated:
    """The result of a calibration: size, alignment, and missing (not fresh) sensors.

    position (k, 3) m: joints of the k sensors in our world, NaN for missing ones. offset (k, 3) m: from the joint to
    each sensor beyond the known offset, in the sensor's canonical axes.
    """

    dimensions: HumanDimensions
    alignment: Alignment
    sensors: tuple[str, ...]
    position: FloatArray
    missing: tuple[str, ...]
    offset: FloatArray


def _located(names: Sequence[str], position: FloatArray) -> dict[str, FloatArray]:
    return {name: at for name, at in zip(names, position, strict=True) if np.isfinite(at).all()}


def frozen_as_fresh(reading: StreamReading) -> StreamReading:
    """Count frozen sensors as fresh ones, as those of a performer who stands still may be."""
    states = np.where(reading.states == ValidityState.FROZEN, ValidityState.FRESH, reading.states)
    return replace(reading, states=states.astype(np.uint8))


class RestCapture:
    """Collects the last `seconds` s of samples of the stream's world. `take` them; once `done`, read the `result`."""

    def __init__(
        self,
        *,
        where: str,
        seconds: float = CAPTURE_S,
        loose: tuple[str, ...] = (),
        needed: tuple[str, ...] = REQUIRED,
        oriented: bool = True,
    ) -> None:
        """loose: sensors that may sit beside their joints. needed: sensors that must be fresh where they are worn.
        oriented: orientations are in canonical axes, and show the front."""
        self._oriented = oriented
        self._where, self._seconds, self._loose, self._needed = where, seconds, loose, needed
        self._times: deque[float] = deque()
        self._samples: deque[SensorSample] = deque()
        self._began = np.inf  # [s] the first sample of all

    @property
    def done(self) -> bool:
        """True if there are samples of long enough."""
        return len(self._times) >= FEWEST_SAMPLES and self._times[-1] - self._began >= self._seconds

    def take(self, time: float, sample: SensorSample) -> None:
        """Take a sample at `time`, s, and drop those older than the capture."""
        self._began = min(self._began, time)
        self._times.append(time)
        self._samples.append(sample)
        while self._times[0] < time - self._seconds or len(self._times) > MOST_SAMPLES:
            self._times.popleft()
            self._samples.popleft()

    def result(self, *, stature: float | None = None, size: HumanDimensions | None = None) -> Calibrated:
        """Return size (m) and alignment of the performer. stature: m, if known. size: the known size, which is only
        checked.

        Raises InputError: no fresh data, not still, crossed limbs, swapped sides, no rest pose, or another size.
        """
        if not self._samples:
            raise self._refused("no data", "no fresh sample")
        names = self._samples[0].names
        track = np.array([sample.position for sample in self._samples])  # (T, k, 3)
        fresh = np.array([sample.valid for sample in self._samples])
        track[~fresh] = np.nan
        counts = fresh.mean(axis=0) >= FRESH_SHARE
        if stale := [name for name, ok in zip(names, counts, strict=True) if not ok and name in self._needed]:
            raise self._refused("not fresh", ", ".join(stale))
        mean = np.full((len(names), 3), np.nan)
        mean[counts] = np.nanmean(track[:, counts], axis=0)
        away = norms(track - mean)
        farthest = np.where(np.isnan(away), 0.0, away).max(axis=0).tolist()
        far = [f"{name} moved by {100 * by:.0f} cm" for name, by in zip(names, farthest, strict=True) if by > SWAY_M]
        if far:
            raise self._refused("not still", ", ".join(far))
        where, sent = f"{self._where}, calibration", self._turns(counts)
        front = {name: turn for name, turn in zip(names, sent, strict=True) if name in TURNED and self._oriented}
        refuse_stance(_located(names, mean), where=where, turns=front)
        alignment = align(names, mean, where=self._where)
        known = proportional_dimensions(stature) if size is None and stature is not None else size
        if known is not None:
            beyond = self._refuse_other(_located(names, alignment.positions(mean)), known)
            # Without ankles the floor is as far below the head as this person is tall.
            alignment = replace(alignment, origin=alignment.origin + np.array([0.0, 0.0, beyond]))
        standing, offset = alignment.positions(mean), np.zeros((len(names), 3))
        at = _located(names, standing)
        if size is None:
            turns = alignment.orientations(sent)
            rows = [row for row, ok in enumerate(counts) if ok]
            loose = [names[row] for row in rows if names[row] in self._loose and np.isfinite(turns[row]).all()]
            counted = [names[row] for row in rows]
            try:
                fit = fit_rest_pose(counted, standing[rows], loose=loose, stature=stature, source=self._where)
            except InputError:
                refuse_crooked(at, where=where)
                raise
            size, (low, high) = fit.dimensions, LIVE_STATURE_M
            if not low <= size.stature <= high:
                raise self._refused("not upright", f"{size.stature:.2f} m tall", low=low, high=high)
            left, right = np.rad2deg(fit.arms).tolist()
            if abs(fit.arms[0] - fit.arms[1]) > ALIKE_RAD:
                both = f"the left one {left:.0f} degrees from hanging, the right one {right:.0f}"
                raise self._refused("arms not alike", both, most=np.rad2deg(ALIKE_RAD))
            standing[rows] -= fit.offset
            offset[rows] = np.nan_to_num(rotations.rotate(rotations.conjugate(turns[rows]), fit.offset))
        refuse_crooked(at, where=where)
        missing = tuple(name for name, ok in zip(names, counts, strict=True) if not ok)
        return Calibrated(size, alignment, names, standing, missing, offset)

    def _turns(self, counts: BoolArray) -> FloatArray:
        track = np.array([np.where(one.valid[:, None], one.orientation, np.nan) for one in self._samples])
        known = counts & np.isfinite(track).any(axis=(0, 2))
        mean = np.full(track.shape[1:], np.nan)
        for row in np.flatnonzero(known):
            sent = track[np.isfinite(track[:, row]).all(axis=1), row]
            total = (sent * np.where(matmul(sent, sent[0]) < 0.0, -1.0, 1.0)[:, None]).sum(axis=0)
            mean[row] = total / norm(total)
        return mean

    def _refuse_other(self, at: dict[str, FloatArray], size: HumanDimensions) -> float:
        """Height, m, by which the head is above that of a person of this size; 0 with ankles."""
        points = dict(zip(POINTS, size.standing(), strict=True))
        ankles = [name for name in ("l_ankle", "r_ankle") if name in at and np.isfinite(at[name]).all()]
        expected = points["head"][2] - np.mean([points["l_ankle"][2], points["r_ankle"][2]])
        if ankles:
            found = at["head"][2] - np.mean([at[name][2] for name in ankles])
        else:
            found, expected = at["head"][2], expected + FRACTIONS.ankle_height * size.stature
        low, high = (1.0 - OTHER_SHARE) * expected, (1.0 + OTHER_SHARE) * expected
        if not low <= found <= high:
            above = f"the head {found:.2f} m above the {'ankles' if ankles else 'floor'}"
            raise self._refused("other size", above, low=low, high=high, origin=size.origin)
        return 0.0 if ankles else float(found - expected)

    def _refused(self, symptom: str, found: str, **facts: Any) -> InputError:
        return refusal(InputError, symptom, f"{self._where}, calibration", found=found, **facts)
