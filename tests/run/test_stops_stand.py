"""From every tick of a run the robot can stop: the stop of each goal that is sent keeps the limits of the servos, its
soles, its balance and its distance, judged by geometry of the tests' own."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np
import pytest
from scipy.spatial import ConvexHull

from benchmarks.golden.matrix import CLIP, ROBOTS
from benchmarks.physics_runs import play
from hardware.guard import CheckedGoal
from retarget.frames import SensorFrames
from retarget.human.samples import Playback
from retarget.ik.support_polygon import Stance, plant
from retarget.model.observers import contacts, robot_observers
from retarget.model.robot import RobotBody, load_robot, plant_roots
from retarget.model.scene_state import SceneState
from retarget.run.controllers import Commanded, RobotMotion, Target
from retarget.run.options import RunOptions
from retarget.schema.scene import load_scene, on_floor
from retarget.sources.open import open_source
from retarget.types import FloatArray
from sim.faults.judge import When, run_row
from sim.faults.rows import ROWS
from sim.performer import synthetic_performer

SHARED = Path(__file__).resolve().parents[3] / "shared"


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


def jumping(frames: SensorFrames, seed: int) -> SensorFrames:
    """Wrists and head displaced together by about 0.35 m an axis, for 0.1 to 0.6 s, about each 1.2 s."""
    random, position = np.random.default_rng(seed), frames.position.copy()
    rows = [frames.index(name) for name in ("head", "l_wrist", "r_wrist")]
    time = 1.0
    while time < frames.time[-1]:
        ends = time + random.uniform(0.1, 0.6)
        leap, there = random.normal(0.0, 0.35, 3), (frames.time >= time) & (frames.time < ends)
        for row in rows:
            position[there, row] += leap
        time = ends + random.exponential(1.2)
    return replace(frames, position=position)


def assert_stops_stand(frames: SensorFrames, options: RunOptions, *, every: int = 1) -> int:
    """Follow the stops of a run. Returns how many goals were sent."""
    robot = load_robot(options.robot)
    with witnessed() as sent:
        play(frames, options)
    scene = None if options.scene is None else SceneState(on_floor(load_scene(options.scene)))
    stance = plant(robot, robot.profile.postures.stand)
    wrong = failures(robot, stance, sent, dt=1.0 / robot.profile.safety.rate_hz, scene=scene, every=every)
    assert not wrong, f"{len(wrong)} of {len(sent)}: {wrong[:3]}"
    return len(sent)


@pytest.mark.parametrize("robot", ROBOTS)
def test_every_goal_has_a_stop_that_stands_and_is_clear(robot: str) -> None:
    options = RunOptions(robot=robot, playback=Playback(speed=2.0, start=4.0, end=7.0))
    assert assert_stops_stand(synthetic_performer(), options, every=5) > 150


def test_also_of_sensors_that_jump() -> None:
    options = RunOptions(robot="op3", playback=Playback(end=4.0))
    assert assert_stops_stand(jumping(synthetic_performer(), 3), options, every=5) > 400


@pytest.mark.long
@pytest.mark.skipif(not (SHARED / CLIP).is_file(), reason=f"no {CLIP} in ../shared")
@pytest.mark.parametrize("bus", ["mock", "physics"])
@pytest.mark.parametrize("robot", ROBOTS)
def test_also_in_a_recording_with_and_without_mass(robot: str, bus: str) -> None:
    frames = open_source(str(SHARED / CLIP))
    assert assert_stops_stand(frames, RunOptions(robot=robot, bus=bus, playback=Playback(end=8.0))) > 300
    assert_stops_stand(jumping(frames, 5), RunOptions(robot=robot, bus=bus, playback=Playback(end=8.0)))


@pytest.mark.long
def test_from_500_random_ticks_of_runs_with_live_faults_the_stop_stands() -> None:
    robot, random = load_robot("op3"), np.random.default_rng(51)
    stance, looked = plant(robot, robot.profile.postures.stand), 0
    for row in random.permutation(np.array(list(ROWS), dtype=object)):
        with witnessed() as sent:
            run_row(row, when=When.MOVING)
        ticks = random.choice(len(sent), size=min(25, len(sent)), replace=False)
        wrong = failures(robot, stance, [sent[tick] for tick in ticks], dt=1.0 / robot.profile.safety.rate_hz)
        assert not wrong, f"{row.name}: {wrong[:3]}"
        looked += len(ticks)
        if looked >= 500:
            break
    assert looked >= 500
