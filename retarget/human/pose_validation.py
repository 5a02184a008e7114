"""Pose validation: limits of the poses that a person can have, and jump detection by them."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from enum import IntEnum
from math import inf

import numpy as np
from numpy.typing import NDArray

from retarget._solver import Validity
from retarget.frames import SensorFrames, SensorSample, mirrored_name
from retarget.human.sensor_intake import FASTEST_M_S
from retarget.rotations import NORM_TOLERANCE
from retarget.types import BoolArray, IntArray


@dataclass(frozen=True, kw_only=True)
class ValidityLimits:
    """Limits of a performer's sensors, in m and in s of capture.

    One pose. reach: horizontal distance from the origin, by axis. low, high: of the height. norm_tolerance: of
    quaternions.

    Speed. fastest: m/s. shortest_step: least time between poses, as stamps of arrival are off by 15 ms. swap, hardest
    (m/s^2): a sensor that is reported at the place of its other side has jumped if it is farther than swap + hardest /
    2 * time^2 from its own. back_within: age at which its place counts no more. settled_after: time of moving on after
    a jump.

    Age, on the local clock. silent_after: time without a frame before a hold. stale_after: the same of one sensor; a
    feed of 20 Hz may lose one pose of three. frozen_after: time of repeating a value while another sensor moves by
    noticeable (m, parts of a unit quaternion; 0.0087 is one degree). not_in_use_after: since the start. healthy: good
    data before a sensor comes back, and before a hold ends.
    """

    reach: float = 10.0
    low: float = -1.0
    high: float = 3.0
    norm_tolerance: float = NORM_TOLERANCE
    fastest: float = FASTEST_M_S
    shortest_step: float = 1.0 / 60.0
    swap: float = 0.08
    hardest: float = 50.0
    back_within: float = 0.1
    settled_after: float = 0.5
    silent_after: float = 0.13
    stale_after: float = 0.142
    frozen_after: float = 0.2
    noticeable: tuple[float, float] = (0.01, 0.0087)
    not_in_use_after: float = 3.0
    healthy: float = 0.5


LIMITS = ValidityLimits()


StateArray = NDArray[np.uint8]  # one ValidityState per sensor, (k,)


class ValidityState(IntEnum):
    """Validity of a sensor. Only a FRESH sensor is used."""

    FRESH = 0  # its last accepted pose is recent, and no other state applies
    STALE = 1  # no pose was accepted for too long, or ever
    FROZEN = 2  # it repeats a value to the bit while others move, as senders do with a lost tracker
    JUMPED = 3  # it went farther than a human can and stays there, or changed places with its other side
    NOT_IN_USE = 4  # it was not received since the start
    OUT_OF_RANGE = 5  # its position is outside the room


def other_sides(names: Sequence[str]) -> IntArray:
    """Rows (k,) of the sensors on the other side of each; -1 for none."""
    sides = [mirrored_name(name) for name in names]
    rows = [
        names.index(side) if side != name and side in names else -1 for name, side in zip(names, sides, strict=True)
    ]
    return np.array(rows, dtype=np.int64)


# A recording may leave any room, and marks its lost sensors itself.
MOVEMENT = ValidityLimits(reach=inf, low=-inf, high=inf, norm_tolerance=inf, frozen_after=inf, not_in_use_after=inf)


class JumpDetection:
    """Takes a sensor out of samples while it moves as no person can, until it is back or has stayed.

    Its value stays for a moment, as most jumps come back. Then it is invalid and in the mask `jumped` (k,).
    """

    def __init__(self, names: Sequence[str]) -> None:
        self._validity = Validity(other_sides(names), MOVEMENT)
        self._rows = np.arange(len(names))
        self._none: BoolArray = np.zeros(len(names), dtype=bool)
        self._position, self._orientation = np.full((len(names), 3), np.nan), np.full((len(names), 4), np.nan)
        self.jumped = self._none

    def step(self, time: float, sample: SensorSample) -> SensorSample:
        """The sample of `time`, s, without jumps; the same object if there is none."""
        position, orientation = np.ascontiguousarray(sample.position), np.ascontiguousarray(sample.orientation)
        verdicts = self._validity.take(self._rows, time, position, orientation, sample.valid)
        if verdicts is None:
            self._position, self._orientation, self.jumped = position, orientation, self._none
            return sample
        usable = verdicts == 0
        refused = sample.valid & ~usable
        self._position = np.where(usable[:, None], position, self._position)
        self._orientation = np.where(usable[:, None], orientation, self._orientation)
        self.jumped = refused & (self._validity.judge(time) == ValidityState.JUMPED)
        if not refused.any():
            return sample
        position = np.where(refused[:, None], self._position, position)
        orientation = np.where(refused[:, None], self._orientation, orientation)
        position[self.jumped], orientation[self.jumped] = np.nan, np.nan
        return replace(sample, position=position, orientation=orientation, valid=sample.valid & ~self.jumped)


def without_jumps(frames: SensorFrames) -> SensorFrames:
    """The frames of a recording without jumps; the same object if there is none.

    Laid on ticks first, a jump from one frame to the next would be a ramp.
    """
    jumps = JumpDetection(frames.names)
    position, orientation, valid = frames.position, frames.orientation, frames.valid
    for row, time in enumerate(frames.time.tolist()):
        sample = SensorSample(frames.names, frames.position[row], frames.orientation[row], frames.valid[row])
        kept = jumps.step(time, sample)
        if kept is sample:
            continue
        if position is frames.position:
            position, orientation, valid = position.copy(), orientation.copy(), valid.copy()
        position[row], orientation[row], valid[row] = kept.position, kept.orientation, kept.valid
    if position is frames.position:
        return frames
    return replace(frames, position=position, orientation=orientation, valid=valid)
