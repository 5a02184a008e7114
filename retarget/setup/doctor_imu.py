"""Check of how an IMU is mounted: a person tilts the robot, and three signs must agree with the tilt."""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from hardware.imu import STANDARD_GRAVITY, ImuSample
from retarget.setup.doctor_machine import DoctorFinding, finding

STILL_S, TILT_S = 1.0, 5.0
"""Times in which the robot stands still, and in which it is tilted, s."""
PERIOD = 0.01
"""Time between two readings, s."""
LAST = 0.2
"""Final share of the readings, in which the robot is held still, and whose mean is taken."""


@dataclass(frozen=True)
class Tilt:
    """A tilt of the robot. axis: 0 about x (forward), 1 about y (left); sign: of the turn about it."""

    words: str
    axis: int
    sign: float


TILTS = (Tilt("forward", 1, 1.0), Tilt("to its left", 0, -1.0))
"""Bowing forward is a positive turn about y, leaning to the left a negative one about x."""


@dataclass(frozen=True)
class HeldTilt:
    """A held tilt. oriented, weighed: roll and pitch by orientation and by acceleration, rad. turned: angles about x, y
    and z by the gyroscope, rad. up: acceleration along z, g."""

    oriented: tuple[float, float]
    weighed: tuple[float, float]
    turned: tuple[float, float, float]
    up: float


def tilt_findings(
    read: Callable[[], ImuSample],
    sleep_until: Callable[[float], object],
    now: Callable[[], float],
    instruct: Callable[[str], object],
) -> list[DoctorFinding]:
    """Findings on the signs of orientation, accelerometer and gyroscope. read: returns the newest sample. instruct:
    shows an instruction, and returns when the person begins."""

    def held(seconds: float) -> HeldTilt | None:
        samples, end = [], now() + seconds
        while now() < end:
            samples.append(read())
            sleep_until(now() + PERIOD)
        return held_tilt(samples)

    instruct(f"Hold the robot upright and still for {STILL_S:g} s")
    upright = held(STILL_S)
    if upright is None:
        return [finding("IMU/silent")]
    found = [finding("IMU/upright", up=upright.up, g=f"{upright.up:+.2f}")]
    for tilt in TILTS:
        instruct(f"Tilt it {tilt.words} by about 30 degrees within {TILT_S:g} s, and keep it there")
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


def held_tilt(samples: list[ImuSample]) -> HeldTilt | None:
    """The tilt of equally spaced samples; None if fewer than half of them are valid."""
    valid = [sample for sample in samples if sample.valid]
    if 2 * len(valid) < len(samples) or not valid:
        return None
    last = valid[-max(round(LAST * len(valid)), 1) :]
    weighed = np.array([replace(sample, orientation=None).tilt for sample in last]).mean(axis=0)
    oriented = np.array([sample.tilt for sample in last]).mean(axis=0)
    spans = np.diff([sample.time for sample in valid], append=valid[-1].time)
    turned = (spans[:, None] * np.array([sample.angular_velocity for sample in valid])).sum(axis=0)
    up = float(np.mean([sample.acceleration[2] for sample in last])) / STANDARD_GRAVITY
    return HeldTilt(tuple(oriented.tolist()), tuple(weighed.tolist()), tuple(turned.tolist()), up)
