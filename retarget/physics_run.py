"""What a simulation knows of a run that a robot cannot know of itself: falls, pressure, slip, torque, heat."""

from dataclasses import dataclass

import numpy as np

from retarget.rotations import FloatArray

__all__ = ["Fallen", "PhysicsRun"]


@dataclass(frozen=True)
class Fallen:
    """A fall. time: s, on the run's time. how: in words, and whether that was without torque."""

    time: float
    how: str


@dataclass(frozen=True, eq=False)
class PhysicsRun:
    """A run of n servos and k soles, looked at T times from the first torque on.

    mount: what the robot was on. seed, trouble: of what was different on purpose. fall: the first, None while it
    stands; toppled: what a parked robot did when its torque went off, if it did not stay sitting. time (T,) s, on the
    run's time. com (T, 3), pressure (T, 2): centre of mass and centre of pressure of the soles, m, world, the latter
    NaN where none carried; margin (T,): of it inside the hull of the soles that carried, m. slip (k,) m: horizontal
    way of each sole while it carried. tilt: worst of a sole that carried, rad. torque (T, n) N m; hottest (n,) degrees
    Celsius, by a stated model that nobody has calibrated. self_contacts, fixture_contacts: looks with any.
    """

    mount: str
    seed: int
    trouble: tuple[str, ...]
    fall: Fallen | None
    toppled: Fallen | None
    time: FloatArray
    com: FloatArray
    pressure: FloatArray
    margin: FloatArray
    slip: FloatArray
    tilt: float
    torque: FloatArray
    hottest: FloatArray
    self_contacts: int
    fixture_contacts: int

    @property
    def least_margin(self) -> float | None:
        """Of the centre of pressure until a fall, m; None where no sole carried."""
        standing = np.isfinite(self.margin) & (self.time <= (np.inf if self.fall is None else self.fall.time))
        known = self.margin[standing]
        return float(known.min()) if known.size else None
