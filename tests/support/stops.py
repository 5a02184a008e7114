"""Whether the stop of every goal that is sent stands and is clear, judged without the gate: by geometry in NumPy."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any
from unittest.mock import patch

import numpy as np
from scipy.spatial import ConvexHull

from hardware.guard import CheckedGoal
from retarget.ik.support_polygon import Stance
from retarget.model.observers import contacts, robot_observers
from retarget.model.robot import RobotBody, plant_roots
from retarget.run.controllers import Commanded, RobotMotion, Target
from retarget.types import FloatArray

SLID_M = 0.0025
"""Most that a corner of a sole is off its place, seen from the lower one: the gate lets each be off by 1 mm."""
ROUND_OFF = 1e-6


@dataclass(frozen=True, eq=False)
class SentGoal:
    """A goal, from where the joints (n,) rad were, moved by `displacement` (n,) rad before. led: the robot stands, and
    a planner leads it on both soles."""

    goal: CheckedGoal
    before: FloatArray
    displacement: FloatArray
    led: bool


@contextmanager
def witnessed() -> Iterator[list[SentGoal]]:
    """The goals of all robots that are moved meanwhile, in their order."""
    sent, next_of = list[SentGoal](), RobotMotion.next

    def seen(motion: RobotMotion, commanded: Commanded, goal: CheckedGoal, target: Target | None) -> Commanded:
        after = next_of(motion, commanded, goal, target)
        stop = None if target is None else target.stop
        led = not motion.on_approach and (stop is not None or (bool(sent) and sent[-1].led and not goal.passed))
        last = sent[-1].goal.posture - sent[-1].before if sent else np.zeros_like(goal.posture)
        sent.append(SentGoal(goal, commanded.joints, last, led))
        return after

    with patch.object(RobotMotion, "next", seen):
        yield sent


@dataclass(frozen=True)
class Stopped:
    """How the stop of a goal ends, and what it loses on the way. fast: most that a joint is beyond its speed or
    acceleration, in shares of it. slip: of a sole, m; edge: least that the centre of mass is inside the soles, m;
    touches: parts that meet."""

    fast: float
    slip: float
    edge: float
    touches: tuple[str, ...]


def stopped(robot: RobotBody, stance: Stance, sent: SentGoal, *, dt: float, scene: Any = None) -> Stopped:
    """Follow the stop of a goal to its end."""
    servos, goal = robot.joint_map, sent.goal
    joints = np.vstack([sent.before, goal.posture, goal.stop])
    moved = np.vstack([np.diff(joints, axis=0), np.zeros_like(goal.posture)])
    changes = np.diff(moved, axis=0, prepend=sent.displacement[None])
    fast = max(
        float((np.abs(moved) / (servos.max_velocity * dt)).max()),
        float((np.abs(changes[1:]) / (servos.max_acceleration * dt * dt)).max()),
    )
    rows = np.tile(stance.q, (len(joints) - 1, 1))
    before = rows.copy()
    rows[:, robot.servo_columns] = joints[1:]
    if robot.stands:
        plant_roots(robot, before, rows)
    slip, edge = 0.0, np.inf
    if sent.led and stance.soles:
        slip = max(_off(robot, sole, rows) for sole in stance.soles)
        hull = ConvexHull(np.concatenate([sole.outline for sole in stance.soles])).equations
        com = robot.kinematics.centre_of_mass(rows)[:, :2]
        edge = float(-(com @ hull[:, :2].T + hull[:, 2]).max())
    looked = {len(rows) // 2, len(rows) - 1}
    touching = [one for row in looked for one in contacts(robot.body, robot_observers(robot), scene, rows[row])]
    return Stopped(fast - 1.0, slip, edge, tuple(f"{one.part} and {one.other}" for one in touching))


def _off(robot: RobotBody, sole: Any, rows: FloatArray) -> float:
    corners = robot.kinematics.points(rows, [sole.frame.body] * len(sole.corners), sole.corners)
    return float(np.linalg.norm(corners - np.insert(sole.outline, 2, 0.0, axis=1), axis=-1).max())


def failures(
    robot: RobotBody, stance: Stance, sent: list[SentGoal], *, dt: float, scene: Any = None, every: int = 1
) -> list[str]:
    """What is wrong with the stops of goals, in words."""
    wrong = list[str]()
    checks: list[tuple[str, Callable[[Stopped], bool]]] = [
        ("faster than its servos", lambda one: one.fast > ROUND_OFF),
        ("its soles slide", lambda one: one.slip > SLID_M),
        ("it falls", lambda one: one.edge <= 0.0),
        ("it touches", lambda one: bool(one.touches)),
    ]
    for tick in range(0, len(sent), every):
        one = stopped(robot, stance, sent[tick], dt=dt, scene=scene)
        wrong += [f"tick {tick}: {what}: {one}" for what, fails in checks if fails(one)]
    return wrong
