"""Walker: guides a robot from a stand, step by step, to another stand.

The robot is always on a path that ends standing, and the gate verifies each goal with its rest. The next path is made
during a step; without it the robot stays on its path.
"""

from math import ceil, sqrt

import numpy as np

from retarget.arithmetic import hypot, norm
from retarget.ik.support_polygon import Stance
from retarget.model.body import JointLimits
from retarget.model.robot import RobotBody
from retarget.robot.walking.gait import MOST_EASE_S, clipped, walking_heights
from retarget.robot.walking.path import PathPlanner, Sketch, WalkPath
from retarget.robot.walking.pattern import (
    CATCH,
    EASE,
    LEFT,
    PEAK,
    RIGHT,
    Foothold,
    Gait,
    Request,
    Step,
    Swing,
    next_foothold,
    standing,
    walk,
)
from retarget.types import BoolArray, FloatArray

ROWS = 24
"""Postures of the next path that are made in a tick, at 0.05 ms each."""
EARLY_S = 0.35
"""Time by which the next path is early, so that arms can make room for the legs, s."""
EASE_ACCELERATION, EASE_TURN = 0.4, 6.0
"""Accelerations to the walking height and an upright trunk, m/s^2 and rad/s^2."""
FORESEEN_S = 0.056
"""Time between the postures of legs that arms keep clear of, s."""


class Walker:
    """Guides one robot. path, row: its place; None: it stands. feet: while it stands, world."""

    def __init__(self, robot: RobotBody, stance: Stance, limits: JointLimits, carrying: BoolArray, gait: Gait) -> None:
        """limits (nv,): for the paths. carrying (nv,): the root and the joints of the legs."""
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
        """Leave the path at its end."""
        if self.path is not None:
            self.feet = self.path.feet
        self.path = None
        self._before: tuple[WalkPath | None, int] = (None, 0)  # place before the last tick
        self.drop()

    def drop(self) -> None:
        """Drop the next path."""
        self._sketch: Sketch | None = None
        self._next: WalkPath | None = None
        self._refused: WalkPath | None = None
        self._stands = True  # no step is requested

    def begin(self, stop: FloatArray) -> None:
        """Begin to walk, with a stop along postures (k, nq)."""
        pattern = standing(self.feet, self._planner.mass(stop[-1]), len(stop))
        self.path, self.row = WalkPath(stop, pattern, None, len(stop) - 1, Request(), 0), 0
        self._before = self.path, 0

    @property
    def speed(self) -> Request:
        """Velocity of the present step."""
        return Request() if self.path is None or self.row > self.path.touchdown else self.path.speed

    @property
    def is_over(self) -> bool:
        """True at the end of the path if no step is requested."""
        return self._stands and self.path is not None and self.row == len(self.path.postures) - 1

    def step(self, request: Request | None, q: FloatArray, swing: Swing | None = None) -> None:
        """Go on by a tick. request: None to stand. q (nq,): the posture. swing: to keep step with."""
        path = self.path
        assert path is not None, "it walks"
        self._before = path, self.row
        if request is None:
            self.drop()
        else:
            self._stands = False
            self._plan(path, request, q, swing)
        if self._next is not None and self.row == self._next.since:
            path, self.row = self._next, 0
            self.path, self.steps, self._next, self._refused = path, self.steps + 1, None, None
        self.row = min(self.row + 1, len(path.postures) - 1)

    def through(self) -> FloatArray:
        """Postures (k, nq), world, of the next or a refused path, or of the rest of this one."""
        ahead = self._next or self._refused
        path, row = (self.path, self.row) if ahead is None else (ahead, 0)
        assert path is not None, "it walks"
        return path.postures[row :: max(round(FORESEEN_S / self.gait.dt), 1)].copy()

    def locate(self, q: FloatArray) -> None:
        """Go on from a posture (nq,) that was sent instead: on the path before, or later on this one."""
        if self.path is None:
            return
        for path, row in ((self.path, self.row), (self.path, self.row + 1), (self._before[0], self._before[1] + 1)):
            if path is None:
                continue
            row = min(row, len(path.postures) - 1)
            if np.array_equal(path.postures[row, self._legs], q[self._legs]):
                if path is not self.path:  # the gate refused the new path
                    self.steps -= 1
                    self._sketch, self._next, self._refused = None, None, self.path
                self.path, self.row = path, row
                break
        else:  # on no path
            if self.path.step is None:
                self.stand()
        self._before = self.path, self.row

    def _plan(self, path: WalkPath, request: Request, q: FloatArray, swing: Swing | None) -> None:
        for ahead in (self._next, None if self._sketch is None else self._sketch.path):
            if ahead is not None and ahead.since < self.row:  # too late: the robot goes on to its stand
                self._next = self._sketch = None
        if self._next is not None:
            return
        if self._sketch is not None:
            self._next = self._planner.advance(self._sketch, ROWS)
            self._sketch = None if self._next is not None else self._sketch
        else:
            gait, end = self.gait, len(path.postures) - 1
            early = (
                self.row + ceil((2 * gait.most_ticks + gait.natural(CATCH + EASE)) / ROWS) + round(EARLY_S / gait.dt)
            )
            since = path.touchdown if self.row <= path.touchdown else end
            if since <= early:
                self._sketch = self._sketched(path, since, request, q, swing)

    def _sketched(self, path: WalkPath, since: int, request: Request, q: FloatArray, swing: Swing | None) -> Sketch:
        """Begin a path from row `since`: the requested step, one that brings the feet together, and a stand."""
        gait, planner = self.gait, self._planner
        first = path.postures[since].copy()
        first[self.others] = q[self.others]
        velocity = planner.velocity(path.postures[max(since - 1, 0)], path.postures[since])
        rests = since > path.touchdown or path.step is None
        begun, row = (standing(path.feet, planner.mass(first), 1), 0) if rests else (path.pattern, since)

        def off(heights: tuple[float, float]) -> tuple[FloatArray, FloatArray]:
            return planner.off(first, np.array([*begun.mass[row, :2], heights[0]]), float(begun.yaws[row]))

        double = gait.double_ticks
        if rests:  # the mass moves before the other foot is lifted
            offset, turned = off(self._heights(request, gait.ticks))
            ease = max(sqrt(PEAK * norm(offset) / EASE_ACCELERATION), sqrt(PEAK * norm(turned) / EASE_TURN))
            double = max(gait.natural(CATCH), round(min(ease, MOST_EASE_S) / gait.dt))
        feet = self._feet(None if rests else path.step, left=request.left > 0.0)
        swinging, ticks = self._in_time(feet, since - self.row + double, swing)
        time = ticks * gait.dt
        speed, heights = clipped(gait, request, time), self._heights(request, ticks)
        target = next_foothold(gait, begun.feet(row)[1 - swinging], speed, swinging, time)
        beside = next_foothold(gait, target, Request(), 1 - swinging, gait.period)
        step = Step(1 - swinging, target, double, ticks - gait.double_ticks)
        last = Step(swinging, beside, gait.double_ticks, gait.ticks - gait.double_ticks)
        pattern, touchdown = walk(gait, begun, row, (step, last), heights), step.double + step.single
        speed = Request(*(ticks / touchdown * one for one in (speed.forward, speed.left, speed.turn)))
        made = WalkPath(first[None], pattern, step, touchdown, speed, since)
        return Sketch(made, [first], velocity, *off(heights), double if rests else ticks)

    def _heights(self, request: Request, ticks: int) -> tuple[float, float]:
        time = ticks * self.gait.dt
        speed = clipped(self.gait, request, time)
        return walking_heights(self.gait, hypot(speed.forward, speed.left) * time)

    def _feet(self, before: Step | None, *, left: bool) -> tuple[int, ...]:
        if before is not None:
            return (before.carrying,)
        if self._refused is not None and self._refused.step is not None:  # arms make room for that foot
            return (1 - self._refused.step.carrying,)
        return (LEFT, RIGHT) if left else (RIGHT, LEFT)

    def _in_time(self, feet: tuple[int, ...], lift: int, swing: Swing | None) -> tuple[int, int]:
        """Foot and ticks of the next step, in time with the performer if their pace allows. lift: ticks until then."""
        gait = self.gait
        if swing is None or not gait.least_ticks <= (ticks := round(swing.period / gait.dt)) <= gait.most_ticks:
            return feet[0], gait.ticks
        middle = round(swing.since / gait.dt) + lift + (ticks - gait.double_ticks) // 2

        def late(foot: int) -> int:
            """Ticks by which the middle of its swing is late."""
            return (middle - (0 if foot == swing.foot else ticks) + ticks) % (2 * ticks) - ticks

        def cure(foot: int) -> float:
            """Number of steps that make up for that."""
            ticks_late = late(foot)
            return max(ticks_late / (ticks - gait.least_ticks + 1), -ticks_late / (gait.most_ticks - ticks + 1))

        foot = min(feet, key=cure)
        return foot, min(max(ticks - late(foot), gait.least_ticks), gait.most_ticks)
