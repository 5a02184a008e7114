"""Walker: leads a robot from a stand, step by step, to another stand.

It is always on a path that ends standing (`WalkPath`), and the gate verifies each goal with the rest of that path.
While a step is under way, the path of the next one, with its own end, is made; the robot goes over to it where that
step ends. Where none was asked for, or the gate refuses it, the robot stays on the path that it is on: so it stands
after at most one more step, and tries again from there.
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
    landing,
    standing,
    walk,
)
from retarget.types import BoolArray, FloatArray

ROWS = 24
"""Postures of the next path that are made in a tick, 0.05 ms each: a path is there in 0.1 s."""
EARLY_S = 0.35
"""Time (s) before it is needed at which the path of a next step is there: arms get out of the way of legs meanwhile.
With 0.15 s, paths were refused in the middle of a walk with hanging arms (CMU 02_01). A first step is tried at once."""
EASE_ACCELERATION, EASE_TURN = 0.4, 6.0
"""m/s^2 and rad/s^2 with which a robot that begins to walk gets to its walking height, and upright: so its zero-moment
point is moved by less than 1 cm."""
FORESEEN_S = 0.056
"""Time (s) from one to the next of the postures that arms are to keep off."""


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
        self.drop()

    def drop(self) -> None:
        """Go nowhere from the path."""
        self._sketch: Sketch | None = None
        self._next: WalkPath | None = None
        self._refused: WalkPath | None = None
        self._stands = True  # whether it is to

    def begin(self, stop: FloatArray) -> None:
        """Begin to walk: come to rest first, on a path of postures (k, nq) from the one in which the robot is."""
        pattern = standing(self.feet, self._planner.mass(stop[-1]), len(stop))
        self.path, self.row = WalkPath(stop, pattern, None, len(stop) - 1, Request(), 0), 0
        self._before = self.path, 0

    @property
    def speed(self) -> Request:
        """The velocity of its present step."""
        return Request() if self.path is None or self.row > self.path.landed else self.path.speed

    @property
    def is_over(self) -> bool:
        """True where the robot is at the end of its path, and is to go nowhere from there."""
        return self._stands and self.path is not None and self.row == len(self.path.postures) - 1

    def step(self, asked: Request | None, q: FloatArray, swing: Swing | None = None) -> None:
        """Go on by a tick, to `row` of `path`. asked: velocity in the robot's own frame, m/s and rad/s; None: it is to
        stand. q (nq,): its posture. swing: of the performer with whom it is to keep step; None: with nobody."""
        path = self.path
        assert path is not None, "it walks"
        self._before = path, self.row
        if asked is None:
            self.drop()
        else:
            self._stands = False
            self._plan(path, asked, q, swing)
        if self._next is not None and self.row == self._next.since:
            path, self.row = self._next, 0
            self.path, self.steps, self._next, self._refused = path, self.steps + 1, None, None
        self.row = min(self.row + 1, len(path.postures) - 1)

    def through(self) -> FloatArray:
        """Postures (k, nq), world, through which the next path leads, or the one that was refused, or the rest of this
        one."""
        ahead = self._next or self._refused
        path, row = (self.path, self.row) if ahead is None else (ahead, 0)
        assert path is not None, "it walks"
        return path.postures[row :: max(round(FORESEEN_S / self.gait.dt), 1)].copy()

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
                if path is not self.path:  # it was refused: where the robot stands, another one is made
                    self.steps -= 1
                    self._sketch, self._next, self._refused = None, None, self.path
                self.path, self.row = path, row
                break
        else:  # what was sent is on no path: before a step it stands where it is
            if self.path.step is None:
                self.stand()
        self._before = self.path, self.row

    def _plan(self, path: WalkPath, asked: Request, q: FloatArray, swing: Swing | None) -> None:
        """Go on making the next path, or begin one not long before it is needed: then what is asked is new."""
        for ahead in (self._next, None if self._sketch is None else self._sketch.path):
            if ahead is not None and ahead.since < self.row:  # it is late, and the robot goes on to its stand
                self._next = self._sketch = None
        if self._next is not None:
            return
        if self._sketch is not None:
            self._next = self._planner.advance(self._sketch, ROWS)
            self._sketch = None if self._next is not None else self._sketch
        elif (since := self._since(path)) is not None:
            self._sketch = self._sketched(path, since, asked, q, swing)

    def _since(self, path: WalkPath) -> int | None:
        """The row from which another step is to begin, if that is to be made now."""
        gait, end = self.gait, len(path.postures) - 1
        early = self.row + ceil((2 * gait.most_ticks + gait.natural(CATCH + EASE)) / ROWS) + round(EARLY_S / gait.dt)
        since = path.landed if self.row <= path.landed else end
        return since if since <= early else None

    def _sketched(self, path: WalkPath, since: int, asked: Request, q: FloatArray, swing: Swing | None) -> Sketch:
        """A path that goes on from row `since` of another: a step as it is asked for, one that brings the feet
        together, and a stand."""
        gait, planner = self.gait, self._planner
        first = path.postures[since].copy()
        first[self.others] = q[self.others]
        velocity = planner.velocity(path.postures[max(since - 1, 0)], path.postures[since])
        rests = since > path.landed or path.step is None  # else it goes on from a step that has landed
        begun, row = (standing(path.feet, planner.mass(first), 1), 0) if rests else (path.pattern, since)

        def off(heights: tuple[float, float]) -> tuple[FloatArray, FloatArray]:
            return planner.off(first, np.array([*begun.mass[row, :2], heights[0]]), float(begun.yaws[row]))

        double = gait.double_ticks
        if rests:  # its mass is pushed to one side before the foot on the other is lifted, and comes to its height
            double = max(gait.natural(CATCH), self._ease_ticks(*off(self._heights(asked, gait.ticks))))
        feet = self._feet(None if rests else path.step, left=asked.left > 0.0)
        swinging, ticks = self._in_time(feet, since - self.row + double, swing)
        time = ticks * gait.dt
        speed, heights = clipped(gait, asked, time), self._heights(asked, ticks)
        target = landing(gait, begun.feet(row)[1 - swinging], speed, swinging, time)
        beside = landing(gait, target, Request(), 1 - swinging, gait.period)
        step = Step(1 - swinging, target, double, ticks - gait.double_ticks)
        last = Step(swinging, beside, gait.double_ticks, gait.ticks - gait.double_ticks)
        pattern, landed = walk(gait, begun, row, (step, last), heights), step.double + step.single
        speed = Request(*(ticks / landed * one for one in (speed.forward, speed.left, speed.turn)))
        made = WalkPath(first[None], pattern, step, landed, speed, since)
        return Sketch(made, [first], velocity, *off(heights), double if rests else ticks)

    def _heights(self, asked: Request, ticks: int) -> tuple[float, float]:
        """Heights of the mass, m, in a step of so many ticks, as `walking_heights` says."""
        time = ticks * self.gait.dt
        speed = clipped(self.gait, asked, time)
        return walking_heights(self.gait, hypot(speed.forward, speed.left) * time)

    def _ease_ticks(self, offset: FloatArray, turned: FloatArray) -> int:
        """Ticks in which a robot that begins to walk gets to its walking height, upright."""
        ease = max(sqrt(PEAK * norm(offset) / EASE_ACCELERATION), sqrt(PEAK * norm(turned) / EASE_TURN))
        return round(min(ease, MOST_EASE_S) / self.gait.dt)

    def _feet(self, before: Step | None, *, left: bool) -> tuple[int, ...]:
        """The feet that may make the next step, the better one first. before: the step that it follows; None: the robot
        rests."""
        if before is not None:
            return (before.carrying,)
        if self._refused is not None and self._refused.step is not None:  # arms get out of the way of that foot
            return (1 - self._refused.step.carrying,)
        return (LEFT, RIGHT) if left else (RIGHT, LEFT)

    def _in_time(self, feet: tuple[int, ...], lift: int, swing: Swing | None) -> tuple[int, int]:
        """The foot that makes the next step, and the ticks of that step: in time with the performer's feet, where those
        are neither too fast nor too slow for that. lift: ticks from now until the robot lifts that foot."""
        gait = self.gait
        if swing is None or not gait.least_ticks <= (ticks := round(swing.period / gait.dt)) <= gait.most_ticks:
            return feet[0], gait.ticks
        middle = round(swing.since / gait.dt) + lift + (ticks - gait.double_ticks) // 2

        def late(foot: int) -> int:
            """Ticks by which the middle of that foot's swing is later than the performer's, or earlier."""
            return (middle - (0 if foot == swing.foot else ticks) + ticks) % (2 * ticks) - ticks

        def cure(foot: int) -> float:
            """Steps after which it would be in time: they can be longer by much, and shorter by little."""
            ticks_late = late(foot)
            return max(ticks_late / (ticks - gait.least_ticks + 1), -ticks_late / (gait.most_ticks - ticks + 1))

        foot = min(feet, key=cure)
        return foot, min(max(ticks - late(foot), gait.least_ticks), gait.most_ticks)
