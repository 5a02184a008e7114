"""A robot on its own soles stands before it is parked: legs and trunk as in its stance, its arms aside.

The way to the posture of rest is straight in its joints. From legs that lean or twist, two planted soles cannot go it:
they would tip; and from arms that are anywhere it leads through the body. So the follower goes to a stand first, on
locked soles, within its balance, limbs kept off each other; a foot that is lifted is put down on the way. Its pelvis
and trunk are asked for as in the stance; all joints are led straight, slowly, from where they are to legs and trunk of
the stance and to the arms of posture `attractor`. Hands may be anywhere: one that does not get where it is asked would
draw the body along, or get there with its elbow elsewhere. So from its end the rest of the way is always the same.
"""

from dataclasses import replace

import numpy as np

from retarget.landmarks import AskedLandmarks
from retarget.robot_body import TRUNK, RobotBody
from retarget.robot_reader import standing_dofs
from retarget.rotations import FloatArray
from retarget.stance import Stance
from retarget.standing_balance import StandingBalance

__all__ = ["LED_SETTLE", "LED_SPEED", "Landing", "landed_angles", "landing_of"]

RESTING_SPEED, RESTS_S = 0.1, 0.3
"""A robot none of whose coordinates is faster (rad/s, m/s) for so long (s) rests. One tick alone is none: where limbs
meet, all stand still for one, and the next goes on."""
LED_SPEED, LED_SETTLE = 1.0, 0.1
"""rad/s of the joint that is led the longest way, and s by which the robot follows, of its own time."""


class Landing:
    """A way to a stand."""

    def __init__(self, robot: RobotBody, stance: Stance, standing: AskedLandmarks) -> None:
        """standing: what asks for the stance."""
        others = frozenset(row for row, name in enumerate(robot.profile.landmarks) if name != "pelvis")
        self.asked = replace(standing, open=others)
        """What is asked besides the joints."""
        single, address = robot.body.scalar_joints()
        self._joints = address[single]
        self._end = robot.posture(landed_angles(robot))[self._joints]
        self._posture = stance.q.copy()
        self.arrived = False
        """Whether joints are led no further."""
        self._rested = 0.0

    def begin(self, q: FloatArray) -> None:
        """From posture q (nq,)."""
        self._posture[self._joints] = q[self._joints]
        self.arrived = False

    def goes_on(self, velocity: FloatArray, dt: float, *, stands: bool) -> bool:
        """Whether a robot is still on its way, called for another `dt` s. velocity (nv,): of it, per s. stands: whether
        it has both feet on the floor and its weight between them."""
        rests = self.arrived and float(np.abs(velocity).max()) < RESTING_SPEED
        self._rested = self._rested + dt if rests and stands else 0.0
        return self._rested < RESTS_S

    def lead(self, dt: float) -> FloatArray:
        """The posture (nq,) in which joints are to be `dt` s later."""
        way = self._end - self._posture[self._joints]
        share = min(LED_SPEED * dt / max(float(np.abs(way).max(initial=0.0)), 1e-9), 1.0)
        self._posture[self._joints] += share * way
        self.arrived = share == 1.0
        return self._posture


def landed_angles(robot: RobotBody) -> dict[str, float]:
    """Where a landing ends, rad by joint, 0 elsewhere: legs and trunk as in `stand`, the others as in `attractor`."""
    postures, carrying = robot.profile.postures, standing_dofs(robot, TRUNK)
    return {
        joint: (postures.stand if carrying[robot.body.dof_index(joint)] else postures.attractor).get(joint, 0.0)
        for joint in postures.stand | postures.attractor
    }


def landing_of(
    robot: RobotBody, stance: Stance, standing: AskedLandmarks, balance: StandingBalance | None
) -> Landing | None:
    """Of a robot; None without a pelvis, and where priorities look at no mass in motion."""
    if balance is None or not balance.looks_at_motion or "pelvis" not in robot.profile.landmarks:
        return None
    return Landing(robot, stance, standing)
