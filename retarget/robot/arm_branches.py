"""Arm branches: moves an arm out of a branch of postures in which it cannot look like the performer's.

An arm may have several postures with nearly the same lines, and the path between them passes through worse ones, where
the solver does not go. A descent from the present posture, without speed limits, finds out: the branch is wrong if it
ends far from the desired lines and one from elsewhere much nearer. The arm is then driven there in joint space while
the performer's is still. A deviating arm would bend the trunk, which gets more weight.
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
"""Landmarks of each side whose lines are an arm."""
SPREAD = 2_000
"""Number of random postures of an arm."""
STARTS = 6
"""Number of these from which descents start."""
ITERATIONS = 40
"""Iterations of a descent: a limb can turn half round."""
DAMPING = 0.5
"""Damping as for two iterations a frame."""
CAUGHT = 0.26
"""Least deviation of a wrong branch, and least improvement, rad."""
ARRIVED = 0.09
"""Greatest difference of descents in one branch, rad."""
UNLIKE_S, CHECK_S = 1.0, 0.05
"""Time of deviation before a check, and between checks, s."""
STRAY_S, TRUNK_RISE_S, TRUNK_WEIGHT = 0.3, 0.3, 2.0
"""Time after which a deviation is no lag, rise time of the trunk's weight, s, and that weight."""
TRUNK_TASKS = ((SlotKind.LIMB, TRUNK), (SlotKind.ORIENTATION, TRUNK), (SlotKind.POSITION, PELVIS))
"""Line, twist and place of the trunk."""
STILL_ARM = 0.35
"""Greatest movement of a still arm of the performer, rad."""
SECOND_COSTS = 0.3
"""Deviation that outweighs a second of path, rad/s."""
DRIVE_SPEED, DRIVE_RISE_S, DRIVE_JERK_S = 0.35, 0.3, 0.04
"""Speed relative to the servos', and times of acceleration and jerk, s: faster arms tip light robots."""
LONGEST_DRIVE_S = 3.0
"""Time after which a driven arm counts as blocked, s."""


class ArmBranches:
    """Drives the arms of one robot out of wrong branches."""

    def __init__(self, robot: RobotBody, priorities: Priorities, stance: Stance, build: Build) -> None:
        """build: of a hierarchy with ITERATIONS and without speed limits."""
        tasks = [task for level in priorities.levels for task in level.tasks if isinstance(task, LimbTask)]
        weights = {name: task.weight for task in tasks for name in task.of if name in limb_names(robot.profile)}
        sides = [{name: weights[name] for part in PARTS if (name := f"{side}_{part}") in weights} for side in "lr"]
        self._arms = [_Arm(_Descent(robot, priorities, stance, limbs, build)) for limbs in sides if limbs]

    def restart(self) -> None:
        """Drive no arm."""
        for arm in self._arms:
            arm.restart()

    def reset(self, q: FloatArray) -> None:
        """Go on from posture q (nq,), that was sent instead."""
        for arm in self._arms:
            arm.reset(q)

    def release(self, hierarchy: Hierarchy, targets: FloatArray) -> bool:
        """Drive no arm in a tick in which hands go to places. Returns False, as `step`."""
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
        """Set the targets for a tick of `dt` s from posture q (nq,); True if an arm is driven.

        limbs: desired lines, m, which are set already. speed_override: (0, 1], share of all speeds.
        """
        hierarchy.reset_posture(targets)
        driven = [arm for arm in self._arms if arm.look(q, dt, speed_override, limbs=limbs, reached=reached)]
        for arm in driven:
            arm.drive(hierarchy, targets, speed_override)
        stray = max((arm.stray for arm in self._arms), default=0.0)
        if stray > 0.0:
            for kind, name in TRUNK_TASKS:
                hierarchy.weigh(targets, kind, name, 1.0 + stray * (TRUNK_WEIGHT - 1.0))
        return bool(driven)


class _Arm:
    def __init__(self, descent: "_Descent") -> None:
        self._descent, self._servos = descent, descent.servos
        self.restart()

    def restart(self) -> None:
        self._stray_s = 0.0
        self.release()

    def release(self) -> None:
        self._goal: FloatArray | None = None
        self._moves: TrajectoryGenerator | None = None
        self._seen_at: FloatArray | None = None
        self._unlike, self._driven, self._looked_s = Dwell(), Dwell(), 0.0

    @property
    def stray(self) -> float:
        """Certainty, 0 to 1, that a deviation is no lag."""
        return min(max(self._stray_s - STRAY_S, 0.0) / TRUNK_RISE_S, 1.0)

    def reset(self, q: FloatArray) -> None:
        if self._moves is not None:
            self._moves.reset(q[self._servos])

    def look(
        self, q: FloatArray, dt: float, speed_override: float, *, limbs: Sequence[Vector], reached: Reached
    ) -> bool:
        """True if the arm is driven in the next tick."""
        passed = speed_override * dt
        self._looked_s += passed
        self._driven.step(passed, holds=self._moves is not None)
        if self._looked_s >= CHECK_S:
            passed, self._looked_s = self._looked_s, 0.0
            desired = np.array([limbs[row] for row in self._descent.rows])
            self._judge(desired, np.array([reached.limbs[row] for row in self._descent.rows]), passed)
            if self._unlike.held > UNLIKE_S or self._moves is not None:
                self._choose(q, desired, reached.trunk, dt)
        return self._moves is not None

    def _judge(self, desired: FloatArray, lines: FloatArray, passed: float) -> None:
        if self._seen_at is None or self._descent.unlike(desired, self._seen_at) > STILL_ARM:
            self._seen_at, self._unlike.held = desired, 0.0
        unlike = self._descent.unlike(lines, desired) > CAUGHT
        self._unlike.step(passed, holds=unlike)
        self._stray_s = min(max(self._stray_s + (passed if unlike else -passed), 0.0), STRAY_S + TRUNK_RISE_S)
        if self._driven.held > LONGEST_DRIVE_S:
            self.release()
            self._seen_at, self._unlike.held = desired, -inf  # not again until the performer's arm has moved

    def drive(self, hierarchy: Hierarchy, targets: FloatArray, speed_override: float) -> None:
        assert self._moves is not None and self._goal is not None, "the arm is driven"
        for name in self._descent.names:
            hierarchy.weigh(targets, SlotKind.LIMB, name, 0.0)
        hierarchy.set_joints(targets, self._servos, self._moves.step(self._goal, speed_override))

    def _choose(self, q: FloatArray, desired: FloatArray, trunk: Quat, dt: float) -> None:
        here, _ = self._descent.end(q, desired)
        if self._goal is not None:
            goal = q.copy()
            goal[self._servos] = self._goal
            if self._descent.end(goal, desired)[0] < min(CAUGHT, here - ARRIVED):
                return  # the goal is still better
        end = self._descent.better(q, desired, trunk, than=here) if here >= CAUGHT else None
        if end is None:
            self.release()
            return
        self._goal = end[self._servos]
        if self._moves is None:
            speed = self._descent.speed
            self._moves = TrajectoryGenerator(speed, speed / DRIVE_RISE_S, speed / DRIVE_RISE_S / DRIVE_JERK_S, dt=dt)
            self._moves.reset(q[self._servos])


class _Descent:
    def __init__(
        self, robot: RobotBody, priorities: Priorities, stance: Stance, weights: Mapping[str, float], build: Build
    ) -> None:
        self.names = list(weights)
        marks, body = [robot.profile.landmarks[name] for name in self.names], robot.body
        self.rows = [limb_names(robot.profile).index(name) for name in self.names]
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
        self.servos, self.speed = robot.servo_columns[servos], DRIVE_SPEED * robot.joint_map.max_velocity[servos]
        """Columns of its servos in q, and their speeds, rad/s."""
        # The norm of all lines is then the weighted root mean square of their angles.
        share = np.array(list(weights.values()))
        self._scale = (share / norm(share) / [mark.robot_length for mark in marks])[:, None]
        self._spread = arm_postures(robot, stance, self.names[0], SPREAD)
        self._seen = self._scale * self._lines(self._spread)

    def unlike(self, lines: FloatArray, desired: FloatArray) -> float:
        """Deviation of lines (k, 3) m, rad."""
        return norm((self._scale * (lines - desired)).ravel())

    def end(self, q: FloatArray, desired: FloatArray) -> tuple[float, FloatArray]:
        """Deviation, rad, and posture (nq,) at the end of a descent."""
        self._targets[self._slots] = np.column_stack([np.ones(len(desired)), desired])[self._source]
        self._solver.reset(q)
        end = self._solver.frame(self._targets, 1.0)
        return self.unlike(self._lines(end[None])[0], desired), end

    def better(self, q: FloatArray, desired: FloatArray, trunk: Quat, *, than: float) -> FloatArray | None:
        """Posture (nq,) in a branch that is better than `than` by CAUGHT, rad; None: there is none."""
        seen = self._scale * as_carried(trunk, desired)
        better = []
        unlike = np.square(self._seen - seen).sum(axis=(1, 2))
        for start in self._spread[np.argsort(unlike, kind="stable")[:STARTS]]:
            tried = q.copy()
            tried[self._columns] = start[self._columns]
            there, end = self.end(tried, desired)
            if there < than - CAUGHT:
                seconds = float((np.abs(end - q)[self.servos] / self.speed).max())
                better.append((there + SECOND_COSTS * seconds, end))
        return min(better, key=lambda end: end[0])[1] if better else None


def arm_priorities(priorities: Priorities, limbs: Container[str]) -> Priorities:
    """Priorities of an arm by itself: no self-collisions, and its limb tasks."""

    def kept(task: Task) -> Task | None:
        if isinstance(task, LimbTask):
            of = tuple(name for name in task.of if name in limbs)
            return task.model_copy(update={"of": of}) if of else None
        return task if isinstance(task, ReactiveTask | PreventiveTask) and task.against != "scene" else None

    levels = [(level, tuple(filter(None, map(kept, level.tasks)))) for level in priorities.levels]
    kept_levels = tuple(level.model_copy(update={"tasks": tasks}) for level, tasks in levels if tasks)
    return priorities.model_copy(update={"levels": kept_levels})


def as_carried(trunk: Quat, lines: FloatArray) -> FloatArray:
    """Lines (k, 3) in the frame of a trunk turned by `trunk`, wxyz."""
    back = inverse(trunk)
    return np.array([rotated(back, as_vector(line)) for line in lines])


def position_limits(robot: RobotBody) -> tuple[FloatArray, FloatArray]:
    """Limits (nv,) of the DoFs, rad or m: the servos' where there are any."""
    body = robot.body
    lower, upper = body.lower.copy(), body.upper.copy()
    dofs = [body.dof_index(joint) for joint in robot.joint_map.joints]
    lower[dofs], upper[dofs] = robot.joint_map.lower, robot.joint_map.upper
    return lower, upper


def arm_postures(robot: RobotBody, stance: Stance, landmark: str, count: int) -> FloatArray:
    """Random postures (count, nq) of a landmark's limb, the rest in the stance."""
    body, moving = robot.body, robot.body.joint_dof[list(chain_to_anchor(robot, landmark))]
    (lower, upper), (_, columns) = position_limits(robot), body.scalar_joints()
    postures = np.tile(stance.q, (count, 1))
    spread = np.random.default_rng(0).uniform(lower[moving], upper[moving], (count, moving.size))
    postures[:, columns[moving]] = spread
    return postures


def chain_to_anchor(robot: RobotBody, landmark: str) -> tuple[int, ...]:
    """Joints from a landmark's frame to the link of its anchor, or to the root."""
    entry, body = robot.profile.landmarks[landmark], robot.body
    base = robot.frame(entry.anchor[0]).body
    links = takewhile(lambda link: link != base, body.chain_to_root(robot.frame(entry.frame).body))
    return tuple(joint for link in links for joint in np.flatnonzero(body.joint_body == link).tolist())
