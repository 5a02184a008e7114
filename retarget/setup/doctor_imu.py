"""Whether an IMU is mounted as the profile says: a person tilts the robot, and three signs must agree with it."""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from hardware.imu import STANDARD_GRAVITY, ImuSample
from retarget.setup.doctor_machine import DoctorFinding, finding

STILL_S, TILT_S = 1.0, 5.0
"""Time, s, in which the robot stands still, and in which it is tilted."""
PERIOD = 0.01
"""[s] Between two readings."""
LAST = 0.2
"""Share of a time whose mean counts: the robot is held by then."""


@dataclass(frozen=True)
class Tilt:
    """A movement of the hands. axis: of the turn, 0 about x, 1 about y; sign: of that turn, x forward, y left, z up."""

    words: str
    axis: int
    sign: float


TILTS = (Tilt("forward", 1, 1.0), Tilt("to its left", 0, -1.0))
"""Bowing forward turns it to the left about y, leaning to its left turns it backwards about x."""


@dataclass(frozen=True)
class Held:
    """A held posture: roll and pitch, rad, by orientation and by acceleration; the turn that led there, rad about x, y
    and z by the gyroscope; and the share of one g along z."""

    oriented: tuple[float, float]
    weighed: tuple[float, float]
    turned: tuple[float, float, float]
    up: float


def tilt_findings(
    read: Callable[[], ImuSample],
    sleep_until: Callable[[float], object],
    now: Callable[[], float],
    ask: Callable[[str], object],
) -> list[DoctorFinding]:
    """Findings on the signs of orientation, accelerometer and gyroscope. read: gives the newest sample; ask: tells the
    person what to do, and returns when that begins."""

    def held(seconds: float) -> Held | None:
        samples, end = [], now() + seconds
        while now() < end:
            samples.append(read())
            sleep_until(now() + PERIOD)
        return held_of(samples)

    ask(f"Hold the robot upright and still for {STILL_S:g} s")
    upright = held(STILL_S)
    if upright is None:
        return [finding("IMU/silent")]
    found = [finding("IMU/upright", up=upright.up, g=f"{upright.up:+.2f}")]
    for tilt in TILTS:
        ask(f"Tilt it {tilt.words} by about 30 degrees within {TILT_S:g} s, and keep it there")
        tilted = held(TILT_S)
        if tilted is None:
            return [*found, finding("IMU/silent")]
        angles = (
            tilted.oriented[tilt.axis] - upright.oriented[tilt.axis],
            tilted.weighed[tilt.axis] - upright.weighed[tilt.axis],
            tilted.turned[tilt.axis],
        )
        degrees = [math.degrees(tilt.sign * angle) for angle in angles]
        facts = {"least": min(degrees), "most": max(degrees), "orientation": degrees[0], "weight": degrees[1]}
        found.append(finding("IMU/tilt", subject=f"IMU, {tilt.words}", **facts, gyroscope=degrees[2]))
    return found


def held_of(samples: list[ImuSample]) -> Held | None:
    """What samples of equal times say; None: fewer than half of them are valid."""
    valid = [sample for sample in samples if sample.valid]
    if 2 * len(valid) < len(samples) or not valid:
        return None
    last = valid[-max(round(LAST * len(valid)), 1) :]
    weighed = np.array([replace(sample, orientation=None).tilt for sample in last]).mean(axis=0)
    oriented = np.array([sample.tilt for sample in last]).mean(axis=0)
    spans = np.diff([sample.time for sample in valid], append=valid[-1].time)
    turned = (spans[:, None] * np.array([sample.angular_velocity for sample in valid])).sum(axis=0)
    up = float(np.mean([sample.acceleration[2] for sample in last])) / STANDARD_GRAVITY
    return Held(tuple(oriented.tolist()), tuple(weighed.tolist()), tuple(turned.tolist()), up)
