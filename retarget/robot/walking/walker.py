"""Walker: leads a robot from a stand, step by step, to another stand.

It is always on a path that ends standing (`WalkPath`), and the gate verifies each goal with the rest of that path.
While a step is under way, the path of the next one, with its own end, is made; the robot goes over to it where that
step ends. Where none was asked for, or the gate refuses it, the robot stays on the path that it is on: so it stands
after at most two more steps.
"""

from math import sqrt

import numpy as np

from retarget.ik.support_polygon import Stance
from retarget.model.body import JointLimits
from retarget.model.robot import RobotBody
from retarget.robot.walking.gait import ramped
from retarget.robot.walking.path import PathPlanner, Sketch, WalkPath
from retarget.robot.walking.pattern import (
    LEFT,
    RIGHT,
    STOPPING,
    Foothold,
    Gait,
    PatternState,
    Pendulum,
    Request,
    Step,
    moment,
    next_step,
    standing,
    stepped,
    sway,
    way_to_stand,
)
from retarget.types import BoolArray, FloatArray

ROWS = 8
"""Postures of the next path that are made in a tick: a path of three steps and an end is there in half a step."""
EARLY_S = 0.15
"""Time (s) before it is needed at which a path is there: arms get out of the way of the legs meanwhile."""
EASE_ACCELERATION, EASE_TURN, LEAST_EASE_S = 0.4, 6.0, 0.3
"""m/s^2 and rad/s^2 with which a robot that begins to walk gets to its walking height, upright, its mass mid-way
between its feet, so that its zero-moment point is moved by less than 1 cm; and the least time for that."""
FORESEEN = 10
"""Postures of a step in which arms are to keep off the legs."""
RETRY_S = 0.2
"""After a refusal a robot that stands waits so long (s) before it tries again: arms get out of the way meanwhile."""
NEAR_M, NEAR_RAD = 0.005, 0.02
"""A robot that is so near to there sways to its first step."""
PEAK = 5.78
"""Largest acceleration of a minimum jerk, by its way over the square of its time."""


class Walker:
    """Walks one robot. `path`: the one that it is on, at row `row`; None: it stands. `feet`: where its soles are while
    it stands, world. `steps`: made so far."""

    def __init__(self, robot: RobotBody, stance: Stance, limits: JointLimits, carrying: BoolArray, gait: Gait) -> None:
        """limits (nv,): which the paths keep. carrying (nv,): the root and the joints of the legs."""
        self.gait = gait
        self._planner = PathPlanner(robot, stance, limits, carrying, gait)
        legs = carrying[[robot.body.dof_index(joint) for joint in robot.joint_map.joints]]
        self._legs, self.others = robot.servo_columns[legs], robot.servo_columns[~legs]
        left, right = (sole.outline.mean(axis=0) for sole in stance.soles)
        self.feet, self.steps = (Foothold(left, 0.0), Foothold(right, 0.0)), 0
        self.path: WalkPath | None = None
        self.row = 0
        self.stand()

    def stand(self) -> None:
        """Leave the path, at whose end the robot stands."""
        if self.path is not None:
            self.feet = self.path.feet
        self.path = None
        self._before: tuple[WalkPath | None, int] = (None, 0)  # where the robot is if the last row was not taken
        self._sketch: Sketch | None = None
        self._next: WalkPath | None = None
        self._wait = 0  # ticks

    def begin(self, stop: FloatArray) -> None:
        """Begin to walk: come to rest first, on a path of postures (k, nq) from the one in which the robot is."""
        count = len(stop)
        yaw = 0.5 * (self.feet[0].yaw + self.feet[1].yaw)
        both, yaws = np.ones((count, 2), dtype=np.bool_), np.full(count, yaw)
        self.path, self.row = WalkPath(stop, both, yaws, self.feet, None, Request(), count - 1, 0), 0
        self._before = self.path, 0

    @property
    def speed(self) -> Request:
        """At which its present step goes."""
        return Request() if self.path is None or self.row > self.path.branch else self.path.speed

    @property
    def is_over(self) -> bool:
        """Whether the robot is at the end of its path, and goes nowhere from there."""
        at_end = self.path is not None and self.row == len(self.path.postures) - 1
        return at_end and self._sketch is None and self._next is None

    def step(self, asked: Request | None, q: FloatArray) -> None:
        """Go on by a tick, to `row` of `path`. asked: velocity in the robot's own frame, m/s and rad/s; None: it is to
        stand. q (nq,): its posture."""
        path = self.path
        assert path is not None, "it walks"
        self._before = path, self.row
        if asked is None:
            self._sketch = self._next = None
        else:
            self._plan(path, asked, q)
        self._wait = max(self._wait - 1, 0)
        if self._next is not None and self.row == self._next.since and not self._wait:
            path, self.row, self._next = self._next, 0, None
            self.path, self.steps = path, self.steps + (path.step is not None)
        self.row = min(self.row + 1, len(path.postures) - 1)

    def through(self) -> FloatArray:
        """Postures (k, nq), world, through which the next path leads, or the rest of this one."""
        path, row = (self._next, 0) if self._next is not None else (self.path, self.row)
        assert path is not None, "it walks"
        return path.postures[row :: self.gait.ticks // FORESEEN].copy()

    def locate(self, q: FloatArray) -> None:
        """Go on from a posture (nq,) to which the robot was sent instead of the last row: on the path before, where the
        gate refused the new one, or further on this one."""
        if self.path is None:
            return
        for path, row in ((self.path, self.row), (self.path, self.row + 1), (self._before[0], self._before[1] + 1)):
            if path is None:
                continue
            row = min(row, len(path.postures) - 1)
            if np.array_equal(path.postures[row, self._legs], q[self._legs]):
                if path is not self.path:  # where it stands, it tries again
                    self.steps -= self.path.step is not None
                    self._sketch, self._next = None, self.path if row == self.path.since else None
                    self._wait = round(RETRY_S / self.gait.dt)
                self.path, self.row = path, row
                break
        else:  # what was sent is on no path: before a step it stands where it is
            if self.path.step is None:
                self.stand()
        self._before = self.path, self.row

    def drop(self) -> None:
        """Go nowhere from the path."""
        self._sketch = self._next = None

    def _plan(self, path: WalkPath, asked: Request, q: FloatArray) -> None:
        """Go on making the next path, or begin one not long before it is needed: then what is asked is new."""
        if self._next is not None:
            return
        if self._sketch is None:
            end = len(path.postures) - 1
            since = path.branch if path.step is not None and self.row <= path.branch else end
            rows = (STOPPING + 1) * self.gait.ticks + round(1.0 / self.gait.dt)
            if since - self.row > rows // ROWS + round(EARLY_S / self.gait.dt):
                return
            self._sketch = self._continued(path, asked, q) if since != end else self._from_stand(path, asked, q)
        if self._sketch.since < self.row:  # it is late, and the robot has begun to stop
            self._sketch = None
        elif self._planner.advance(self._sketch, ROWS):
            self._next, self._sketch = self._planner.whole(self._sketch), None

    def _continued(self, path: WalkPath, asked: Request, q: FloatArray) -> Sketch:
        """The path that follows the step of a path."""
        assert path.step is not None, "it makes a step"
        gait, speed = self.gait, ramped(self.gait, path.speed, asked)
        step = next_step(gait, path.step, speed)
        return self._sketched(path, path.branch, q, moment(gait, step, 0.0), [], step, speed, ease=gait.ticks)

    def _from_stand(self, path: WalkPath, asked: Request, q: FloatArray) -> Sketch:
        """The path from the end of a path to where steps may begin, the mass mid-way between the feet, at its walking
        height; or from there that of a first step, to which it sways."""
        gait, feet, end = self.gait, path.feet, len(path.postures) - 1
        middle = 0.5 * (feet[0].place + feet[1].place)
        start = standing(feet, Pendulum(middle, middle), middle)
        moved, turned = self._planner.off(path.postures[end], start)
        if moved < NEAR_M and turned < NEAR_RAD:
            swayed, step = sway(gait, feet, LEFT if asked.left < 0.0 else RIGHT)
            return self._sketched(path, end, q, start, swayed, step, Request(), ease=len(swayed))
        ease = max(sqrt(PEAK * moved / EASE_ACCELERATION), sqrt(PEAK * turned / EASE_TURN), LEAST_EASE_S)
        ticks = round(ease / gait.dt)
        return self._sketched(path, end, q, start, [start] * (ticks + 1), None, Request(), ease=ticks)

    def _sketched(
        self,
        path: WalkPath,
        since: int,
        q: FloatArray,
        start: PatternState,
        before: list[PatternState],
        step: Step | None,
        speed: Request,
        *,
        ease: int,
    ) -> Sketch:
        """A path that goes on from row `since` of another, through moments before a step, that step if there is one, at
        a speed, and to a stand."""
        first = path.postures[since].copy()
        first[self.others] = q[self.others]
        velocity = self._planner.velocity(path.postures[max(since - 1, 0)], path.postures[since])
        moments = before if step is None else before + stepped(self.gait, step)
        branch = len(moments)
        moments = moments if step is None else moments + way_to_stand(self.gait, step)
        return self._planner.sketch(first, velocity, start, moments, ease, (step, speed, branch, since))
