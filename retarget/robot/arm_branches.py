"""Arm branches: leads an arm out of a branch of postures in which it cannot look like the performer's.

An arm may have several postures with nearly the same lines: its shoulder turned half round in all of its joints, or
wound up by a whole turn. The way from one to another leads through postures that are less like the performer, so the
solver, which improves from tick to tick, does not take it. The arm goes on in its branch until joints are at their
limits, and stays there however wrong it looks.

A descent tells such an arm from one that only lags: the same limb tasks, observers and limits of position, without
limits of speed, solved on from where the arm is. Where it ends far from what is asked, and a descent from elsewhere
ends much nearer, the branch is wrong. The arm is led to the better posture in joint space, without its limb tasks,
until a descent from where it is ends near what is asked. While the performer's arm moves nothing is led: the way takes
a second, in which a moving arm would have gone on.

Until then an arm that stays unlike, caught or at its limits, would bend and twist the trunk that carries it. So the
trunk weighs twice as much.
"""

from collections.abc import Callable, Container, Mapping, Sequence
from itertools import takewhile
from math import inf

import numpy as np

from retarget._solver import TrajectoryGenerator
from retarget.arithmetic import Dwell, norm
from retarget.ik.hierarchy import Build, Hierarchy
from retarget.ik.support_polygon import Stance
from retarget.ik.tasks import SlotKind
from retarget.model.robot import TRUNK, RobotBody
from retarget.robot.landmarks import PELVIS, Reached, limb_names
from retarget.rotations import Quat, Vector, as_vector, inverse, rotated
from retarget.schema.priorities import LimbTask, PreventiveTask, Priorities, ReactiveTask, Task
from retarget.types import FloatArray

PARTS = ("hand", "upper_arm", "forearm")
"""Landmarks of each side whose lines are an arm: the whole of it, and its limbs."""
SPREAD = 2_000
"""Postures of an arm, spread over all ranges: 8 to 25 degrees apart for three to five joints."""
STARTS = 6
"""Postures of these, the most like, from which a descent begins."""
ITERATIONS = 40
"""Iterations of a descent, of at most 0.05 m of a limb's line each: a limb can turn round."""
DAMPING = 0.5
"""Of the solver, as in a frame of two iterations: each of a descent goes as far."""
CAUGHT = 0.26
"""[rad] A branch is wrong that ends farther from what is asked, and by so much farther than another: 15 degrees are
seen at once, and less is not worth a way that is seen as well."""
ARRIVED = 0.09
"""[rad] An arm is in the branch of its goal if descents from both end as far from what is asked, to 5 degrees."""
UNLIKE_S, CHECK_S = 1.0, 0.05
"""[s] For so long an arm is unlike before its branch is looked at: a jump by 2 rad is caught up with by then. The time
between two looks at an arm."""
STRAY_S, RISE_S, TRUNK_WEIGHT = 0.3, 0.3, 2.0
"""[s] An arm that has been unlike for so long does not only lag; time in which the weight of the trunk rises then, and
how many times as much it weighs at last."""
TRUNK_TASKS = ((SlotKind.LIMB, TRUNK), (SlotKind.ORIENTATION, TRUNK), (SlotKind.POSITION, PELVIS))
"""What is asked of the trunk: its line, its twist and its place."""
STILL = 0.35
"""[rad] A performer's arm that moves by no more than this, for as long as an arm is to be unlike, is not on its way."""
SECOND_COSTS = 0.3
"""[rad/s] Of two branches that differ by this, the one is taken that is a second nearer."""
LED_SPEED, LED_RISE_S, LED_JERK_S = 0.35, 0.3, 0.04
"""Share of its servos' speeds at which an arm is led; s until it has that, and its acceleration. An arm's mass that is
thrown round tips a light robot: with mass, Poppy fell at full speed and ToddlerBot at half of it; both stand so."""
MOST_LED_S = 3.0
"""[s] An arm that has not arrived by then is led no longer: something is in its way."""


class ArmBranches:
    """Leads the arms of one robot. `restart`, then one `step` per tick."""

    def __init__(self, robot: RobotBody, priorities: Priorities, stance: Stance, build: Build) -> None:
        """build: a hierarchy of ITERATIONS without limits of speed. Limb tasks of `priorities` are what is weighed."""
        tasks = [task for level in priorities.levels for task in level.tasks if isinstance(task, LimbTask)]
        weights = {name: task.weight for task in tasks for name in task.of if name in limb_names(robot.profile)}
        sides = [{name: weights[name] for part in PARTS if (name := f"{side}_{part}") in weights} for side in "lr"]
        self._arms = [_Arm(_Descent(robot, priorities, stance, limbs, build)) for limbs in sides if limbs]

    def restart(self) -> None:
        """Lead no arm."""
        for arm in self._arms:
            arm.restart()

    def reset(self, q: FloatArray) -> None:
        """Go on from posture q (nq,): another goal was sent than was asked."""
        for arm in self._arms:
            arm.reset(q)

    def release(self, hierarchy: Hierarchy, targets: FloatArray) -> bool:
        """Lead no arm in a tick whose hands go to places, and not by the lines of arms. Returns False, as `step`."""
        hierarchy.reset_posture(targets)
        self.restart()
        return False

    def step(
        self,
        hierarchy: Hierarchy,
        targets: FloatArray,
        q: FloatArray,
        dt: float,
        *,
        limbs: Sequence[Vector],
        reached: Reached,
        speed_override: float,
    ) -> bool:
        """Set the targets of a hierarchy for a tick of `dt` s from posture q (nq,), where an arm is led. limbs: lines
        asked, m, as in `limb_names`; they are set already. speed_override: (0, 1], share
        of all speeds. Returns whether an arm is led."""
        hierarchy.reset_posture(targets)
        led = [arm for arm in self._arms if arm.look(q, dt, speed_override, limbs=limbs, reached=reached)]
        for arm in led:
            arm.lead(hierarchy, targets, speed_override)
        stray = max((arm.stray for arm in self._arms), default=0.0)
        if stray > 0.0:
            for kind, name in TRUNK_TASKS:
                hierarchy.weigh(targets, kind, name, 1.0 + stray * (TRUNK_WEIGHT - 1.0))
        return bool(led)


class _Arm:
    """One arm: for how long it has been unlike, and the way on which it is led, if it is."""

    def __init__(self, descent: "_Descent") -> None:
        self._descent, self._servos = descent, descent.servos
        self.restart()

    def restart(self) -> None:
        """Lead it no longer: a new performance begins."""
        self._stray_s = 0.0
        self.release()

    def release(self) -> None:
        """Lead it no longer, and forget what was seen."""
        self._goal: FloatArray | None = None
        self._moves: TrajectoryGenerator | None = None
        self._seen_at: FloatArray | None = None
        self._unlike, self._led, self._looked_s = Dwell(), Dwell(), 0.0

    @property
    def stray(self) -> float:
        """How surely it does not only lag: 0 to 1, as long as it is unlike rising, else falling."""
        return min(max(self._stray_s - STRAY_S, 0.0) / RISE_S, 1.0)

    def reset(self, q: FloatArray) -> None:
        """Go on from posture q (nq,)."""
        if self._moves is not None:
            self._moves.reset(q[self._servos])

    def look(
        self, q: FloatArray, dt: float, speed_override: float, *, limbs: Sequence[Vector], reached: Reached
    ) -> bool:
        """Whether the arm of posture q (nq,) is led in the tick of `dt` s that comes. limbs: lines asked, m."""
        passed = speed_override * dt  # a slower arm is given as much longer
        self._looked_s += passed
        self._led.step(passed, holds=self._moves is not None)
        if self._looked_s >= CHECK_S:
            passed, self._looked_s = self._looked_s, 0.0
            wanted = np.array([limbs[row] for row in self._descent.rows])
            self._judge(wanted, np.array([reached.limbs[row] for row in self._descent.rows]), passed)
            if self._unlike.held > UNLIKE_S or self._moves is not None:
                self._choose(q, wanted, reached.trunk, dt)
        return self._moves is not None

    def _judge(self, wanted: FloatArray, lines: FloatArray, passed: float) -> None:
        """Note for how long lines (k, 3) m have been unlike those wanted, `passed` s after the last time."""
        if self._seen_at is None or self._descent.unlike(wanted, self._seen_at) > STILL:
            self._seen_at, self._unlike.held = wanted, 0.0
        unlike = self._descent.unlike(lines, wanted) > CAUGHT
        self._unlike.step(passed, holds=unlike)
        self._stray_s = min(max(self._stray_s + (passed if unlike else -passed), 0.0), STRAY_S + RISE_S)
        if self._led.held > MOST_LED_S:
            self.release()
            self._seen_at, self._unlike.held = wanted, -inf  # not again until the performer's arm has moved

    def lead(self, hierarchy: Hierarchy, targets: FloatArray, speed_override: float) -> None:
        """Go on with the way: no limb tasks for the arm, and its joints drawn to where they are to be."""
        assert self._moves is not None and self._goal is not None, "the arm is led"
        for name in self._descent.names:
            hierarchy.weigh(targets, SlotKind.LIMB, name, 0.0)
        hierarchy.set_joints(targets, self._servos, self._moves.step(self._goal, speed_override))

    def _choose(self, q: FloatArray, wanted: FloatArray, trunk: Quat, dt: float) -> None:
        """Choose where the arm of posture q (nq,) is led from the next tick of `dt` s on, if its branch is wrong."""
        here, _ = self._descent.end(q, wanted)
        if self._goal is not None:
            goal = q.copy()
            goal[self._servos] = self._goal
            if self._descent.end(goal, wanted)[0] < min(CAUGHT, here - ARRIVED):
                return  # it is on its way
        end = self._descent.better(q, wanted, trunk, than=here) if here >= CAUGHT else None
        if end is None:
            self.release()
            return
        self._goal = end[self._servos]
        if self._moves is None:
            speed = self._descent.speed
            self._moves = TrajectoryGenerator(speed, speed / LED_RISE_S, speed / LED_RISE_S / LED_JERK_S, dt=dt)
            self._moves.reset(q[self._servos])


class _Descent:
    """Descents of one arm, from where it is and from postures spread over all that it can do."""

    def __init__(
        self, robot: RobotBody, priorities: Priorities, stance: Stance, weights: Mapping[str, float], build: Build
    ) -> None:
        """weights: of its limbs, by name."""
        self.names = list(weights)
        marks, body = [robot.profile.landmarks[name] for name in self.names], robot.body
        self.rows = [limb_names(robot.profile).index(name) for name in self.names]
        """Of the arm's lines in `limb_names`."""
        ends, begins = tuple(mark.frame for mark in marks), tuple(mark.anchor[0] for mark in marks)
        self._lines: Callable[[FloatArray], FloatArray] = lambda q: robot.points(q, ends) - robot.points(q, begins)
        moving = body.joint_dof[list(chain_to_anchor(robot, self.names[0]))]
        locked = np.ones(body.nv, dtype=np.bool_)
        locked[moving] = False
        hierarchy = build(arm_priorities(priorities, self.names), locked)
        self._solver, self._targets = hierarchy.solver, hierarchy.blank()
        self._source, self._slots = hierarchy.position_slots(self.names, SlotKind.LIMB)
        self._columns = body.scalar_joints()[1][moving]
        servos = np.isin(robot.servo_columns, self._columns)
        self.servos, self.speed = robot.servo_columns[servos], LED_SPEED * robot.joint_map.max_velocity[servos]
        """Places of its servos in q, and the speeds, rad/s, at which they are led."""
        # With this scale the distance of all lines together is the root of the mean square of their angles, weighed.
        share = np.array(list(weights.values()))
        self._scale = (share / norm(share) / [mark.robot_length for mark in marks])[:, None]
        self._spread = arm_postures(robot, stance, self.names[0], SPREAD)
        self._seen = self._scale * self._lines(self._spread)

    def unlike(self, lines: FloatArray, wanted: FloatArray) -> float:
        """How unlike lines (k, 3) m are to those wanted, rad."""
        return norm((self._scale * (lines - wanted)).ravel())

    def end(self, q: FloatArray, wanted: FloatArray) -> tuple[float, FloatArray]:
        """Where a descent from posture q (nq,) ends: how unlike, rad, and the posture (nq,)."""
        self._targets[self._slots] = np.column_stack([np.ones(len(wanted)), wanted])[self._source]
        self._solver.reset(q)
        end = self._solver.frame(self._targets, 1.0)
        return self.unlike(self._lines(end[None])[0], wanted), end

    def better(self, q: FloatArray, wanted: FloatArray, trunk: Quat, *, than: float) -> FloatArray | None:
        """A posture (nq,) in another branch than q (nq,) that is less unlike than `than`, by CAUGHT, rad, if any is."""
        seen = self._scale * as_carried(trunk, wanted)
        ways = []
        unlike = np.square(self._seen - seen).sum(axis=(1, 2))
        for start in self._spread[np.argsort(unlike, kind="stable")[:STARTS]]:
            tried = q.copy()
            tried[self._columns] = start[self._columns]
            there, end = self.end(tried, wanted)
            if there < than - CAUGHT:
                seconds = float((np.abs(end - q)[self.servos] / self.speed).max())
                ways.append((there + SECOND_COSTS * seconds, end))
        return min(ways, key=lambda way: way[0])[1] if ways else None


def arm_priorities(priorities: Priorities, limbs: Container[str]) -> Priorities:
    """What an arm with these limbs is asked in its own frame: not to touch the robot, and its limb tasks."""

    def kept(task: Task) -> Task | None:
        if isinstance(task, LimbTask):
            of = tuple(name for name in task.of if name in limbs)
            return task.model_copy(update={"of": of}) if of else None
        return task if isinstance(task, ReactiveTask | PreventiveTask) and task.against != "scene" else None

    levels = [(level, tuple(filter(None, map(kept, level.tasks)))) for level in priorities.levels]
    asked = tuple(level.model_copy(update={"tasks": tasks}) for level, tasks in levels if tasks)
    return priorities.model_copy(update={"levels": asked})


def as_carried(trunk: Quat, lines: FloatArray) -> FloatArray:
    """Lines (k, 3) as a trunk sees them that is turned from its stance by `trunk`, wxyz."""
    back = inverse(trunk)
    return np.array([rotated(back, as_vector(line)) for line in lines])


def position_limits(robot: RobotBody) -> tuple[FloatArray, FloatArray]:
    """Limits (nv,) of the DoFs, rad or m: of the servos, where there are any."""
    body = robot.body
    lower, upper = body.lower.copy(), body.upper.copy()
    dofs = [body.dof_index(joint) for joint in robot.joint_map.joints]
    lower[dofs], upper[dofs] = robot.joint_map.lower, robot.joint_map.upper
    return lower, upper


def arm_postures(robot: RobotBody, stance: Stance, landmark: str, count: int) -> FloatArray:
    """Postures (count, nq) with the limb of a landmark anywhere within its limits, and the rest in its stance."""
    body, moving = robot.body, robot.body.joint_dof[list(chain_to_anchor(robot, landmark))]
    (lower, upper), (_, columns) = position_limits(robot), body.scalar_joints()
    postures = np.tile(stance.q, (count, 1))
    spread = np.random.default_rng(0).uniform(lower[moving], upper[moving], (count, moving.size))
    postures[:, columns[moving]] = spread
    return postures


def chain_to_anchor(robot: RobotBody, landmark: str) -> tuple[int, ...]:
    """Joints between a landmark's frame and the link that carries its first anchor, or the root of the body."""
    entry, body = robot.profile.landmarks[landmark], robot.body
    base = robot.frame(entry.anchor[0]).body
    links = takewhile(lambda link: link != base, body.chain_to_root(robot.frame(entry.frame).body))
    return tuple(joint for link in links for joint in np.flatnonzero(body.joint_body == link).tolist())
