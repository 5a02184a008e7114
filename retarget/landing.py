"""A robot on its own soles stands before it is parked: legs and trunk as in its stance, its arms aside.

The way to the posture of rest is straight in its joints. From legs that lean or twist, two planted soles cannot go it:
they would tip; and from arms that are anywhere it leads through the body. So the follower goes to a stand first, on
locked soles, within its balance, limbs kept off each other; a foot that is lifted is put down on the way. What is asked
is one posture, by every level alike: its landmarks, and last its joints. Its legs and trunk are those of the stance at
once; its arms go straight, slowly, from where they are to where they are in posture `attractor`. Hands yield to the
pelvis and the trunk: one that does not get there would draw the body along. So from its end the rest of the way is
always the same.
"""

from dataclasses import replace

import numpy as np

from retarget.hierarchy import Hierarchy
from retarget.landmarks import AskedLandmarks
from retarget.robot_body import TRUNK, RobotBody
from retarget.robot_reader import RobotReader, standing_dofs
from retarget.rotations import FloatArray
from retarget.stance import Stance
from retarget.standing_balance import StandingBalance

__all__ = ["Landing", "landing_of"]

RESTING_SPEED, RESTS_S = 0.1, 0.3
"""A robot none of whose coordinates is faster (rad/s, m/s) for so long (s) rests. One tick alone is none: where limbs
meet, all stand still for one, and the next goes on."""
LONGEST_S = 15.0
"""After so long (s) it is parked from where it is."""
ASIDE_SPEED = 1.0
"""rad/s of the joint of an arm that has the longest way."""


class Landing:
    """One way to a stand; then the next, from where the robot is then."""

    def __init__(self, robot: RobotBody, stance: Stance, standing: AskedLandmarks) -> None:
        """standing: what asks for the stance."""
        hands = frozenset(row for row, name in enumerate(robot.profile.landmarks) if name != "pelvis")
        self._reader, self._asked = RobotReader(robot, stance), replace(standing, yielding=hands)
        single, address = robot.body.scalar_joints()
        self._arms = address[single & ~standing_dofs(robot, TRUNK)]
        self._aside = robot.posture(robot.profile.postures.attractor)[self._arms]
        self._posture = stance.q.copy()
        self._begin()

    def _begin(self) -> None:
        self._begun = False
        self.arrived = False
        """Whether arms that are asked for are aside."""
        self._lasted = self._rested = 0.0

    def goes_on(self, velocity: FloatArray, dt: float, *, stands: bool) -> bool:
        """Whether a robot is still on its way, called for another `dt` s. velocity (nv,): of it, per s. stands: whether
        it has both feet on the floor and its weight between them."""
        self._lasted += dt
        rests = self.arrived and float(np.abs(velocity).max()) < RESTING_SPEED
        self._rested = self._rested + dt if rests and stands else 0.0
        if self._lasted < LONGEST_S and self._rested < RESTS_S:
            return True
        self._begin()
        return False

    def ask(self, q: FloatArray, dt: float, hierarchy: Hierarchy, targets: FloatArray) -> AskedLandmarks:
        """What is asked, for another `dt` s, of a robot that was at posture q (nq,) when it was asked first. The
        posture is written into the target vector of its hierarchy."""
        if not self._begun:
            self._begun = True
            self._posture[self._arms] = q[self._arms]
        way = self._aside - self._posture[self._arms]
        share = min(ASIDE_SPEED * dt / max(float(np.abs(way).max(initial=0.0)), 1e-9), 1.0)
        self._posture[self._arms] += share * way
        self.arrived = share == 1.0
        hierarchy.set_posture(targets, self._posture)
        return replace(self._asked, landmarks=self._reader.read(self._posture).landmarks)


def landing_of(
    robot: RobotBody, stance: Stance, standing: AskedLandmarks, balance: StandingBalance | None
) -> Landing | None:
    """Of a robot; None without a pelvis, and where priorities look at no mass in motion."""
    if balance is None or not balance.looks_at_motion or "pelvis" not in robot.profile.landmarks:
        return None
    return Landing(robot, stance, standing)
