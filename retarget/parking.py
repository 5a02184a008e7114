"""A robot that stopped goes where it is parked: to a stand, then home, around what is in the way."""

import numpy as np

from retarget.planted_root import plant_root
from retarget.robot_body import RobotBody
from retarget.rotations import FloatArray
from retarget.stages import FollowingStage
from retarget.ways_home import Way, ways_home

__all__ = ["Parking"]

PACE = 0.5
"""Share of all speeds at which the follower brings the robot to a stand: nobody waits for it, and what its mass does to
the soles goes with the square."""
SETTLE_S = 0.2
"""So long (s) it stands after a refusal: servos are behind their goals, and the gate looks at both."""


class Parking:
    """One way to posture `rest`, tick by tick of `dt` s.

    First the follower brings the robot to a stand (see `landing`), then it goes straight home. Where something is in
    the way, it goes to a stand once more from there. After that come the other ways of `ways_home`, and after the last
    it stays.
    """

    def __init__(self, robot: RobotBody, follower: FollowingStage, *, dt: float) -> None:
        self._robot, self._follower, self._dt = robot, follower, dt
        self._ways = ways_home(robot, dt=dt)
        self._way: Way | None = None
        self._lands, self._again = True, True  # now, and once more
        self._waits = 0
        """Ticks that it stands before it goes on."""
        self._refused = False
        """Whether a landing stands because it was refused."""
        self.begun = False
        """Whether the robot has set off, and perhaps arrived."""
        self._arrived = False

    def next(self, q: FloatArray, *, passed: bool, stands: bool) -> FloatArray | None:
        """The next posture (nq,); None: it is there, cannot go on, or has to come to a stand first.

        q (nq,): where the robot was sent last; passed: whether that is what was asked for; stands: whether nothing is
        left to brake.
        """
        if not self.begun:
            self.begun = True
            self._follower.reseed(q.copy(), np.zeros(self._robot.body.nv))  # perhaps it has not followed yet
            self._follower.keep_pace(PACE)
        if self._waits > 0:
            self._waits -= 1
            return q.copy()
        if self._arrived:
            return None
        if self._lands:
            there = self._landed(q, passed=passed, stands=stands)
            if there is not None:
                return there
        elif not passed and self._way is not None:  # something is in the way
            if not stands:
                return None
            return self._blocked(q)
        self._lands = False
        return self._gone(q)

    def _wait(self, q: FloatArray) -> FloatArray:
        """Where it stands (nq,), from here on."""
        self._waits = round(SETTLE_S / self._dt)
        return q.copy()

    def _blocked(self, q: FloatArray) -> FloatArray:
        """Where it stands (nq,): the way at hand is none."""
        self._way, self._lands, self._again = None, self._again, False
        self._refused = False
        return self._wait(q)

    def _landed(self, q: FloatArray, *, passed: bool, stands: bool) -> FloatArray | None:
        """The next posture (nq,) of a landing; None: it is over."""
        if stands and not passed:
            if self._refused:
                return self._blocked(q)
            self._refused = True
            self._follower.halt(self._dt)  # it stands, and so its next thought is of parting limbs
            return self._wait(q)
        self._refused &= stands
        return self._follower.land(self._dt)

    def _gone(self, q: FloatArray) -> FloatArray | None:
        """The next posture (nq,) of a way home; None: it is there, or there are no more ways."""
        columns = self._robot.servo_columns
        if self._way is None:
            begin = next(self._ways, None)
            if begin is None:
                return None
            self._way = begin(q[columns])
        goal = next(self._way, None)
        if goal is None:
            self._arrived = True
            return None
        there = q.copy()
        there[columns] = goal
        plant_root(self._robot, q, there)
        return there
