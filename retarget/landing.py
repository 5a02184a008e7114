"""A robot on its own soles stands before it is parked: upright over them, with its arms as they are.

The way to the posture of rest is straight in its joints. From legs that lean or twist, two planted soles cannot go it:
they would tip. So the follower brings the trunk upright and the pelvis to where it stands first, on locked soles and
within its balance; a foot that is lifted is put down on the way. Arms stay as they are to the trunk: hands that went
where they are in the stance would take the body along, the more so where the torso is between.
"""

import numpy as np

from retarget.chase import Reached
from retarget.landmarks import AskedLandmarks, LandmarkMap
from retarget.rotations import FloatArray
from retarget.scalar_rotations import inverse, minus, plus, rotated
from retarget.standing_balance import StandingBalance

__all__ = ["Landing", "landing_of"]

RESTING_SPEED, RESTS_S = 0.1, 0.3
"""A robot none of whose coordinates is faster (rad/s, m/s) for so long (s) rests. One tick alone is none: where limbs
meet, all stand still for one, and the next goes on."""
LONGEST_S = 8.0
"""After so long (s) it is parked from where it is."""


class Landing:
    """One way to a stand. standing: what asks for the stance; pelvis: row of that landmark."""

    def __init__(self, standing: AskedLandmarks, *, pelvis: int) -> None:
        self._standing, self._pelvis = standing, pelvis
        self._asked: AskedLandmarks | None = None
        self._lasted = self._rested = 0.0

    def goes_on(self, velocity: FloatArray, dt: float, *, stands: bool) -> bool:
        """Whether a robot is still on its way, called for another `dt` s. velocity (nv,): of it, per s. stands: whether
        it has both feet on the floor and its weight between them."""
        self._lasted += dt
        rests = float(np.abs(velocity).max()) < RESTING_SPEED
        self._rested = self._rested + dt if rests and stands else 0.0
        return self._lasted < LONGEST_S and self._rested < RESTS_S

    def ask(self, at: Reached) -> AskedLandmarks:
        """What is asked of a robot that was `at` there when it was asked first."""
        if self._asked is None:
            there, here = self._standing.landmarks[self._pelvis], at.landmarks[self._pelvis]
            upright = inverse(at.trunk)
            borne = [plus(there, rotated(upright, minus(place, here))) for place in at.landmarks]
            self._asked = AskedLandmarks(borne, self._standing.trunk, self._standing.gaze)
        return self._asked


def landing_of(landmarks: LandmarkMap, balance: StandingBalance | None) -> Landing | None:
    """Of a robot with these landmarks; None without a pelvis, and where priorities look at no mass in motion."""
    if balance is None or not balance.looks_at_motion or "pelvis" not in landmarks.names:
        return None
    return Landing(landmarks.standing, pelvis=landmarks.names.index("pelvis"))
