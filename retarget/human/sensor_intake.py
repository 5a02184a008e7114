"""Sensor intake: goals of the body that follow the sensors without jumps, within the reach of a body.

The goal of a lost sensor stands still for a while, as does that of a sensor that jumps: most jumps come back. A sensor
that is back, or stays where it jumped to, is blended in: its goal goes from where it was to the sensor.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import fsum

import numpy as np

from retarget import rotations
from retarget.arithmetic import exp, low_pass, norm, norms, soft_cap, squares
from retarget.model.human_dimensions import POINTS, HumanDimensions
from retarget.types import BoolArray, FloatArray

FASTEST_M_S = 15.0  # the fist of a boxer reaches about 10 m/s
HARDEST_M_S2, SPIKE_M = 300.0, 0.04
"""Greatest acceleration of a sensor on a person, heel strikes included, and noise beside its motion. In 17 recordings
without faults it is 36 mm at most at 120 Hz; 50 mm is allowed."""
FASTEST_RAD_S = 30.0  # no head or pelvis turns faster
FADED = 1e-6  # [m or rad] a nearer goal has arrived
VELOCITY_SETTLE_S = 0.02  # low-pass on a sensor's velocity
DOUBT_S = 0.1  # [s] a sensor that jumped must stay this long before it is blended in


@dataclass(frozen=True)
class IntakeTimes:
    """Times of the intake. hold: s for which the goal of a lost sensor stands still. fade: time constant of the blend,
    s, at most at `speed`, m/s, and `turn`, rad/s."""

    hold: float = 0.2
    fade: float = 0.05
    speed: float = FASTEST_M_S
    turn: float = FASTEST_RAD_S


SLOW_INTAKE = IntakeTimes(hold=0.08, fade=0.25, speed=0.25, turn=2.0)
"""For streams, and for all sensors after a hold: an elbow then uses at most half of its servo's speed. A stream's
sensor becomes invalid within 0.2 s, and takes no part after 0.3 s."""


class SensorIntake:
    """The goals of k sensors: `position` (k, 3) m, world, and `orientation` (k, 4) wxyz, NaN where unknown.

    present (k,): mask of sensors that have a goal. away: greatest distance, m, of a goal from its sensor.
    """

    def __init__(self, count: int, times: IntakeTimes | None = None) -> None:
        self._times, self._slow_times = times or IntakeTimes(), SLOW_INTAKE
        self.position = np.zeros((count, 3))
        self.present: BoolArray = np.zeros(count, dtype=bool)
        self.all_present = False
        self.measured = np.zeros((count, 3))
        self._velocity = np.zeros((count, 3))  # [m/s]
        self._sent = np.zeros((count, 3))  # last valid position of each
        self._doubt = np.zeros(count)  # [s] for which a sensor that jumped must still stay
        self._begun = np.full((count, 3), np.inf)  # position at which the last jump began
        self._lost_for = np.full(count, np.inf)
        self._has_lost = True
        self.away = 0.0
        self.orientation: FloatArray = np.full((count, 4), np.nan)
        self._turn = self.orientation  # last goal of each
        self._offset = np.zeros((count, 3))  # from each sensor to its goal
        self._blending: BoolArray = np.zeros(count, dtype=bool)  # sensors that are being blended in
        self._slow: BoolArray = np.zeros(count, dtype=bool)  # sensors that have not arrived since a hold

    def start(self, position: FloatArray, orientation: FloatArray, valid: BoolArray) -> None:
        """Take the valid sensors of the first sample as they are."""
        self.position[:] = np.where(valid[:, None], position, 0.0)
        self.measured[:] = self._sent[:] = self.position
        self._velocity[:] = np.nan
        self.present[:] = valid
        self._doubt[:], self._begun[:] = 0.0, np.inf
        self.all_present = bool(valid.all())
        self._lost_for[:] = np.where(valid, 0.0, np.inf)
        self._has_lost = not self.all_present
        self._offset[:], self._blending[:], self._slow[:], self.away = 0.0, False, False, 0.0
        self.orientation = self._turn = np.where(valid[:, None], orientation, np.nan)

    def resume(self, speed: float = 1.0) -> None:
        """Begin again after a hold, from where the body has the sensors. speed: of the performer's time."""
        self.present[:], self._lost_for[:], self._velocity[:] = False, np.inf, np.nan
        self._doubt[:], self._begun[:] = 0.0, np.inf
        self.all_present, self._has_lost = False, True
        self._slow[:] = True
        slow = SLOW_INTAKE
        self._slow_times = replace(slow, fade=slow.fade * speed, speed=slow.speed / speed, turn=slow.turn / speed)

    def step(
        self, position: FloatArray, orientation: FloatArray, valid: BoolArray, *, reached: FloatArray, dt: float
    ) -> None:
        """Take the sample `dt` s later: (k, 3) m, (k, 4) wxyz. reached (k, 3): where the body has the sensors."""
        moved, since = position - self.measured, dt + np.where(np.isfinite(self._lost_for), self._lost_for, 0.0)
        calm = squares(moved) <= np.square(FASTEST_M_S * since)
        most = SPIKE_M + 0.5 * HARDEST_M_S2 * since * since
        on_path = (
            (squares(moved - self._velocity * since[:, None]) <= most * most)
            | ~self.present
            | ~calm
            | np.isnan(self._velocity[:, 0])
        )
        believed = valid
        if self._has_lost or np.count_nonzero(calm & on_path & valid) != len(calm):
            believed = self._believed(position, valid, dt) & on_path
            self._take_irregular(position, believed, calm, reached=reached, dt=dt)
        else:
            self.measured[:] = position
        self._sent[valid] = position[valid]
        now, anew = moved / since[:, None], (since > dt) | np.isnan(self._velocity[:, 0])
        old = np.where(anew[:, None], now, self._velocity)
        smooth = low_pass(old, now, dt / VELOCITY_SETTLE_S)
        self._velocity = np.where(believed[:, None], np.where(calm[:, None], smooth, np.nan), self._velocity)
        known = believed & np.isfinite(orientation[:, 0])
        before, self.orientation = self.orientation, np.where(known[:, None], orientation, np.nan)
        # An orientation that is new, or turns faster than a human, is blended in. NaN compares false.
        alike = np.abs((before * self.orientation).sum(axis=1))  # cosine of half of the angle between them
        half = 0.5 * FASTEST_RAD_S * dt
        goes_on = 2.0 - 2.0 * alike <= half * half
        self._blending |= known & ~goes_on & np.isfinite(self._turn[:, 0])
        if self._blending.any():
            self._blend(dt)
        else:
            self.position[:], self.away = self.measured, 0.0
        self._turn = np.where(known[:, None], self.orientation, self._turn)

    def _blend(self, dt: float) -> None:
        """Move goals towards their sensors by one common share, so that a body between two feasible postures is
        feasible."""
        offset, angles = self.position - self.measured, np.zeros(len(self.present))
        grown = squares(offset) > squares(self._offset)
        offset[grown] = self._offset[grown]
        turning = self._blending & np.isfinite(self.orientation[:, 0]) & np.isfinite(self._turn[:, 0])
        angles[turning] = rotations.angle_between(self._turn[turning], self.orientation[turning])
        for is_slow, times in ((False, self._times), (True, self._slow_times)):
            rows = self._blending & self.present & (self._slow == is_slow)
            if not rows.any():
                continue
            share = exp(-dt / times.fade)
            for sizes, fastest in ((norms(offset), times.speed * dt), (angles, times.turn * dt)):
                share = max(share, 1.0 - fastest / max(float(sizes[rows].max()), fastest))
            goes_on = rows & (share * np.maximum(norms(offset), angles) > FADED)
            offset *= np.where(goes_on, share, np.where(rows, 0.0, 1.0))[:, None]
            turned = turning & goes_on
            self.orientation[turned] = rotations.slerp(
                self.orientation[turned], self._turn[turned], np.full(np.count_nonzero(turned), share)
            )
            self._blending &= goes_on | ~rows
            self._slow &= goes_on | ~rows
        self._offset, self.away = offset, float(norms(offset[self.present]).max(initial=0.0))
        np.add(self.measured, offset, out=self.position)

    def _believed(self, position: FloatArray, valid: BoolArray, dt: float) -> BoolArray:
        """Mask (k,) of valid sensors that have not just jumped."""
        step = squares(position - self._sent)
        jumps = valid & (step > np.square(FASTEST_M_S * (dt + self._lost_for)))
        # A jump that ends much nearer to where the one before began leads back.
        back = jumps & (squares(position - self._begun) < 0.25 * step)
        leaves = jumps & ~back & (self._doubt == 0.0)
        self._begun[leaves] = self.measured[leaves]
        self._begun[back] = np.inf
        self._doubt = np.where(jumps, DOUBT_S, np.maximum(self._doubt - dt, 0.0))
        self._doubt[back | (self._doubt < 1e-9)] = 0.0
        return np.asarray(valid & (self._doubt == 0.0))

    def _take_irregular(
        self, position: FloatArray, valid: BoolArray, calm: BoolArray, *, reached: FloatArray, dt: float
    ) -> None:
        absent_before = ~self.present
        back = valid & (absent_before | (self._lost_for > 0.0))
        goal_before = np.where(absent_before[:, None], reached, self.position)
        changed = back | (valid & ~calm)
        self.position[changed] = goal_before[changed]
        self._offset[changed] = goal_before[changed] - position[changed]
        self._blending |= changed
        self.measured[valid] = position[valid]
        self._lost_for[valid] = 0.0
        self._lost_for[~valid] += dt
        self._has_lost = not valid.all()
        self.present[:] = self._lost_for <= self._times.hold
        self.all_present = bool(self.present.all())


def without_spikes(time: FloatArray, position: FloatArray) -> FloatArray:
    """Return positions (T, k, 3) m, at times (T,) s, without single frames that are farther from both neighbours than a
    human accelerates. Laid on ticks first, such a spike would be a ramp."""
    if len(time) < 3:
        return position
    before, after, half = position[:-2], position[2:], 0.5 * (time[2:] - time[:-2])[:, None]
    middle = 0.5 * (before + after)
    off = np.sqrt(squares(position[1:-1] - middle))
    spike = (off > SPIKE_M + 0.5 * HARDEST_M_S2 * half * half) & (np.sqrt(squares(after - before)) < off)
    cleared = position.copy()
    cleared[1:-1][spike] = middle[spike]
    return cleared


# A faulty tracker may report a wrist metres away, and the hierarchy would stretch the whole body after it. So a goal is
# drawn in to where a body of this size could have it.

TRUNK_STRETCH = 1.25  # greatest distance of two points of the trunk, as a multiple of that at rest
REACH_SOFT_ZONE = 0.05  # share of the greatest distance, at its end, into which farther goals are drawn

# The joint at which each limb begins, and its joints from there on.
_LIMB_CHAINS = {
    "shoulder": ("elbow", "wrist", "hand"),
    "hip": ("knee", "ankle", "toe"),
}


class Reach:
    """Largest distances of k sensors from the anchor: the pelvis if it has a sensor, else the head."""

    def __init__(self, sensors: Sequence[str], joints: Sequence[str], dimensions: HumanDimensions) -> None:
        self._anchor = next((sensors.index(name) for name in ("pelvis", "head") if name in sensors), None)
        anchor = joints[0 if self._anchor is None else self._anchor]
        self._furthest = np.array([_furthest(anchor, joint, dimensions) for joint in joints])

    def clamp(self, position: FloatArray, present: BoolArray) -> None:
        """Draw positions (k, 3) m in, in place. present (k,): mask."""
        if self._anchor is None or not present[self._anchor]:
            return
        away = position - position[self._anchor]
        distance = np.sqrt(squares(away))
        for row in np.flatnonzero(present & (distance > (1.0 - REACH_SOFT_ZONE) * self._furthest)).tolist():
            far = float(distance[row])
            share = soft_cap(far, float(self._furthest[row]), REACH_SOFT_ZONE) / far
            position[row] = position[self._anchor] + share * away[row]


def _furthest(anchor: str, joint: str, dimensions: HumanDimensions) -> float:
    start, first = _from_trunk(anchor, dimensions)
    end, second = _from_trunk(joint, dimensions)
    rest = dict(zip(POINTS, dimensions.standing(), strict=True))
    return TRUNK_STRETCH * norm(rest[start] - rest[end]) + first + second


def _from_trunk(joint: str, dimensions: HumanDimensions) -> tuple[str, float]:
    side, kind = (joint[:2], joint[2:]) if joint[1] == "_" else ("", joint)
    for root, chain in _LIMB_CHAINS.items():
        if kind in chain:
            return side + root, fsum(dimensions.length(side + part) for part in chain[: chain.index(kind) + 1])
    return joint, 0.0
