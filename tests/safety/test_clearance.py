"""What touches at the start is named, and refused unless it may be let out."""

from pathlib import Path

import numpy as np
import pytest

from followers import DT, op3
from gated_robot import GatedRobot, sphere
from gated_robot import scene_of as scene
from gates import sent
from hardware.clock import VirtualClock
from messages import refuses
from retarget._solver import Braking
from retarget.cli.buses import make_bus
from retarget.errors import UsageError
from retarget.human.samples import Playback
from retarget.ik.support_polygon import plant
from retarget.model.observers import Contact, contacts, placed, robot_observers
from retarget.run.options import RunOptions
from retarget.run.prepare import prepare
from retarget.safety.clearance import KEPT_SHARE, FollowingError, refuse_contact
from retarget.schema.catalogue import Kind, find
from retarget.types import FloatArray
from sim.performer import synthetic_performer

BALL = """
name: swallowed
description: a ball around a hand
obstacles:
  ball: {shape: {sphere: {radius: 0.06}}, at: {pos: [%f, %f, %f]}, influence: 0.1}
"""


def standing() -> FloatArray:
    return plant(op3(), op3().profile.postures.stand).q


def hand() -> FloatArray:
    place: FloatArray = op3().points(standing()[None], ("l_hand",))[0, 0]
    return place


def test_a_robot_that_stands_touches_nothing() -> None:
    assert contacts(op3().body, robot_observers(op3()), None, standing()) == ()


def test_the_deepest_comes_first_with_its_depth() -> None:
    observers, q = robot_observers(op3()), standing()
    torso, forearm = placed(op3().body, observers, q)[0][[observers.names.index(n) for n in ("torso", "l_forearm")]]
    state = scene(far=sphere([2.0, 0.0, 0.0], 0.1), ball=sphere(torso, 0.02), grain=sphere(forearm, 0.001))
    found = contacts(op3().body, observers, state, q)
    assert found[0].part == "torso" and found[0].other == "ball" and 0.02 < found[0].depth < 0.2
    assert {contact.other for contact in found} == {"ball", "grain"}
    assert np.all(np.diff([contact.depth for contact in found]) <= 0.0)


def test_the_message_names_all_of_them() -> None:
    refuse_contact((), where="op3")
    both = (Contact("torso", "ball", 0.012), Contact("head", "ball", 0.003))
    with refuses(UsageError, "12.0", "head", "3.0", "--allow-contact"):
        refuse_contact(both, where="op3, standing")


@pytest.mark.long
@pytest.mark.parametrize("robot", ["op3", "human"])
def test_a_swallowed_start_is_refused_before_anything_moves(robot: str, tmp_path: Path) -> None:
    frames = synthetic_performer()
    # An ankle of the paper's human is where its sensor says, whatever touches it.
    at = hand() if robot == "op3" else frames.position[0, frames.index("l_ankle")]
    priorities = None if robot == "op3" else str(tmp_path / "lines.yaml")
    paper = find(Kind.PRIORITIES, "paper").read_text(encoding="utf-8")
    lines = [line for line in paper.splitlines() if not line.startswith("observers:")]
    (tmp_path / "lines.yaml").write_text("\n".join([*lines, "observers: {human: lines}"]))
    file = tmp_path / "swallowed.yaml"
    file.write_text(BALL % tuple(at))

    def options(*, allow: bool) -> RunOptions:
        return RunOptions(
            robot=robot, priorities=priorities, scene=str(file), allow_contact=allow, playback=Playback(end=0.2)
        )

    with (
        refuses(UsageError, "--allow-contact"),
        prepare(
            lambda: frames,
            options(allow=False),
            clock=VirtualClock(),
            make_bus=lambda robot, clock: make_bus("mock", robot, clock),
        ),
    ):
        pass
    with prepare(
        lambda: frames,
        options(allow=True),
        clock=VirtualClock(),
        make_bus=lambda robot, clock: make_bus("mock", robot, clock),
    ) as prepared:
        assert len(prepared.run().record) > 0


TICK = np.array([0.0015, -0.0015])


def test_lag_is_explained_and_the_rest_is_not() -> None:
    following = FollowingError(TICK, dt=DT)
    following.seed(np.zeros(2))
    for k in range(10):
        following.sent(np.array([0.02 * k, -0.02 * k]))
    assert following.unexplained(np.array([0.1, -0.1])).tolist() == [0.0, 0.0]
    assert following.unexplained(np.array([0.182, 0.002])).tolist() == [0.0, 0.0]  # rounding
    np.testing.assert_allclose(following.unexplained(np.array([0.2, 0.02])), [0.017, 0.017])


BETWEEN = 1e-4
"""What rows keep on top, m; as much is lost in all when a pair is let out."""


def place_of_hand(robot: GatedRobot, rows: FloatArray, name: str = "l_hand") -> FloatArray:
    """Where a hand is (T, 3) m, for servo angles (T, n)."""
    return robot.robot.points(robot.standing(rows), (name,))[:, 0]


def joint(name: str) -> FloatArray:
    """One rad of one joint (n,)."""
    return np.array([float(servo.joint == name) for servo in op3().joint_map.servos])


def is_clear(robot: GatedRobot, path: FloatArray) -> bool:
    return robot.clearance(np.ascontiguousarray(path), path[:1].repeat(len(path), axis=0), robot.q)


def obstacles(rng: np.random.Generator, count: int = 5) -> GatedRobot:
    """OP3 among spheres in reach that it does not touch."""
    while True:
        places = [
            sphere(rng.uniform([-0.1, -0.3, 0.1], [0.3, 0.3, 0.5]), rng.uniform(0.005, 0.05)) for _ in range(count)
        ]
        robot = GatedRobot(scene(**{f"s{k}": keys for k, keys in enumerate(places)}))
        if robot.distances(robot.sent[None]).min() > 0.0025:
            return robot


def push(robot: GatedRobot, rng: np.random.Generator, direction: FloatArray) -> FloatArray:
    """A goal within every limit of the joints, as far in a direction (n,) of signs as they let it."""
    servos, gate = robot.robot.joint_map, robot.gate
    limits = servos.lower, servos.upper, servos.max_velocity, servos.max_acceleration
    lo, hi = Braking(*limits, dt=DT).bounds(sent(gate), gate.goal.displacement)
    whim = np.where(rng.random(lo.size) < 0.1, rng.uniform(lo, hi), np.where(direction > 0, hi, lo))
    return sent(gate) + np.where(direction == 0.0, np.clip(0.0, lo, hi), whim)


@pytest.mark.parametrize("seed", range(4))
def test_whatever_is_asked_nothing_comes_nearer_than_is_kept(seed: int) -> None:
    """Goals that go fast at an obstacle and never brake; judged at 20 places of every tick."""
    rng = np.random.default_rng(seed)
    robot = obstacles(rng)
    keep, refused = robot.kept(), 0
    start = robot.distances(robot.sent[None])[0]
    floor = np.minimum(keep, start - 2.0 * BETWEEN)
    arms = np.array(["sho" in s.joint or "el" in s.joint for s in robot.robot.joint_map.servos])
    direction = np.zeros(arms.size)
    for tick in range(150):
        if tick % 30 == 0:
            moving = arms if seed % 2 else np.ones_like(arms)
            direction = np.where(moving, rng.choice([-1.0, 0.0, 1.0], arms.size), 0.0)
        before = robot.sent
        standing = robot.q
        refused += not robot.ask(push(robot, rng, direction))
        after, robot.q = robot.q, standing  # the judge walks from where it stood
        worst = (robot.distances(robot.between(np.stack([before, after[robot.robot.servo_columns]]))) - floor).min()
        robot.q = after
        assert worst > -1e-9, f"seed {seed}, tick {tick}: {1e3 * worst:.3f} mm too near"
    assert refused > 0


def test_without_the_look_the_same_goals_collide() -> None:
    rng = np.random.default_rng(1)
    state = obstacles(rng).state
    robot = GatedRobot(state, watched=False)
    least = np.inf
    direction = rng.choice([-1.0, 1.0], robot.sent.size)
    for _ in range(60):
        robot.ask(push(robot, rng, direction))
        least = min(least, robot.distances(robot.sent[None]).min())
    assert least < 0.0


def test_a_goal_is_refused_in_the_last_tick_that_can_stop() -> None:
    robot = GatedRobot()
    turn = joint("l_sho_pitch")
    forward = place_of_hand(robot, (robot.sent + 0.8 * turn)[None])[0]
    robot = GatedRobot(scene(ball=sphere(forward, 0.02)))
    rng = np.random.default_rng(0)
    goal = push(robot, rng, turn)
    for _ in range(200):
        reached = robot.distances(robot.way_through(goal))[-1].min()
        if not robot.ask(goal):
            break
        goal = push(robot, rng, turn)
    else:
        pytest.fail("nothing was refused")
    assert reached < robot.kept().max() + 2.0 * BETWEEN
    while robot.gate.goal.displacement.any():
        robot.ask(np.full(turn.size, np.nan))
    assert robot.kept().max() < robot.distances(robot.sent[None]).min() < 0.02
    assert robot.kept().max() >= 0.001, "a quarter of the margin of the ball"


def test_a_thin_obstacle_between_two_clear_rows_is_found() -> None:
    robot = GatedRobot()
    path = robot.sent + np.array([[0.0], [0.6]]) * joint("l_sho_pitch")
    middle = place_of_hand(robot, path.mean(axis=0)[None])[0]
    # The shell of the forearm ends 3 mm before the hand.
    among = GatedRobot(scene(wire=sphere(middle, 0.0035, margin=0.0001, influence=0.01)))
    assert among.distances(path).min() > among.kept().max() + BETWEEN
    assert is_clear(robot, path) and robot.clearance.limiting_pair(robot.observers.names) == ""
    assert not is_clear(among, path)
    part, obstacle = among.clearance.limiting_pair(among.observers.names).split(" and ")
    assert part == "l_forearm" and obstacle == "wire"
    assert is_clear(among, path[[0, 0]]) and among.clearance.limiting_pair(among.observers.names) == "", "nothing now"


def test_the_ticks_in_which_a_pair_was_refused_are_counted() -> None:
    robot = GatedRobot()
    path = robot.sent + np.array([[0.0], [0.6]]) * joint("l_sho_pitch")
    middle = place_of_hand(robot, path.mean(axis=0)[None])[0]
    among = GatedRobot(scene(wire=sphere(middle, 0.0035, margin=0.0001, influence=0.01)))
    for _ in range(3):
        among.clearance.measure(among.sent, among.sent)
        assert not is_clear(among, path) and not is_clear(among, path) and is_clear(among, path[[0, 0]])
    among.clearance.measure(among.sent, among.sent)
    ((pair, ticks),) = among.clearance.refusals.items()
    assert ticks == 3 and among.clearance.names_of(pair, among.observers.names) == ("l_forearm", "wire")


@pytest.mark.long
@pytest.mark.parametrize("seed", range(3))
def test_the_verdict_is_that_of_looking_everywhere(seed: int) -> None:
    """Quick or not: what is cleared is clear, and what is refused misses at most by what rows keep on top."""
    rng = np.random.default_rng(seed)
    robot = obstacles(rng)
    keep = np.minimum(robot.kept(), robot.distances(robot.sent[None])[0] - 2.0 * BETWEEN)
    verdicts = []
    for _ in range(40):
        aim = rng.standard_normal(robot.sent.size) * rng.choice([0.02, 0.2])
        rise = np.cumsum(np.sort(rng.random((8, 1)) * np.ones_like(aim), axis=0)[::-1] * aim / 4.0, axis=0)
        path = np.vstack([robot.sent, robot.sent + rise])
        room = (robot.distances(robot.between(path, 10)) - keep).min()
        clear = is_clear(robot, path)
        verdicts.append(clear)
        assert room > -1e-9 if clear else room < 5.0 * BETWEEN, f"seed {seed}: {clear}, {1e3 * room:.3f} mm"
    assert 0 < sum(verdicts) < len(verdicts)


def test_what_touches_is_only_let_out() -> None:
    robot = GatedRobot()
    middle = place_of_hand(robot, robot.sent[None])[0]
    robot = GatedRobot(scene(ball=sphere(middle + np.array([0.0, 0.03, 0.0]), 0.04)))
    rng = np.random.default_rng(0)
    start = robot.distances(robot.sent[None]).min()
    assert start < -0.01
    sway, least = joint("l_sho_pitch"), start
    for tick in range(400):  # sneak in, by less than rounding a tick
        robot.ask(robot.sent + 2e-5 * (sway if tick % 2 else joint("l_sho_roll")))
        robot.ask(robot.sent + 2e-5 * (-sway if tick % 2 else -joint("l_el")))
        least = min(least, robot.distances(robot.sent[None]).min())
    assert least > start - 2.0 * BETWEEN
    ways = [joint(name) * sign for name in ("l_sho_pitch", "l_sho_roll", "l_el") for sign in (-1, 1)]
    for _ in range(300):
        near = robot.distances(robot.sent[None]).min()
        goals = [push(robot, rng, way) for way in ways]
        goals = [goal for goal in goals if robot.distances(goal[None]).min() > near] or goals
        robot.ask(max(goals, key=lambda goal: float(robot.distances(goal[None]).min())))
        assert robot.distances(robot.sent[None]).min() > min(near, KEPT_SHARE * 0.004) - 2.0 * BETWEEN
    assert robot.distances(robot.sent[None]).min() > 0.0


def test_it_may_get_out_of_the_way_of_what_comes_and_not_into_it() -> None:
    robot = GatedRobot()
    at = place_of_hand(robot, robot.sent[None])[0]
    to = place_of_hand(robot, (robot.sent + 0.05 * joint("l_sho_pitch"))[None])[0] - at
    forward = to / np.linalg.norm(to)
    ball = sphere(at + 0.09 * forward, 0.02, velocity=(-1.0 * forward).tolist())
    for sign, passes in ((1.0, False), (-1.0, True)):
        robot = GatedRobot(scene(ball=ball))
        robot.obstacles.begin()
        robot.obstacles.tick(None, DT)
        passed = []
        for _ in range(7):
            passed.append(robot.ask(push(robot, np.random.default_rng(0), sign * joint("l_sho_pitch"))))
            robot.obstacles.tick(None, DT)
        assert all(passed) if passes else not all(passed)


def test_an_obstacle_is_where_it_will_be_then() -> None:
    """A goal into free space that will not be free, and one into space that will be."""
    robot = GatedRobot()
    path = robot.sent + np.linspace(0.0, 0.8, 18)[:, None] * joint("l_sho_pitch")
    there = place_of_hand(robot, path[-1:])[0]
    away = np.array([0.0, 0.3, 0.0])
    time = 17.0 * DT
    comes, goes = (there + away, -away / time), (there, away / (0.5 * time))
    for (at, velocity), clear in ((comes, False), (goes, True)):
        robot = GatedRobot(scene(ball=sphere(at, 0.02, velocity=velocity.tolist())))
        assert is_clear(robot, path) != clear  # it stands until `begin`
        robot.obstacles.begin()
        robot.obstacles.tick(None, DT)
        assert robot.clearance(path, path, robot.q) if clear else not is_clear(robot, path)


def test_what_servos_are_off_their_way_is_off_the_whole_way() -> None:
    robot = GatedRobot()
    pitch = joint("l_sho_pitch")
    path = robot.sent + np.minimum(np.arange(8), 6)[:, None] * 0.003 * pitch
    at = place_of_hand(robot, (path[-1] + 0.3 * pitch)[None])[0]
    while True:  # bring it to where the path leaves it 3 mm
        robot = GatedRobot(scene(bar=sphere(at, 0.02)))
        room = robot.distances(path)[-1].min()
        if room < 0.003:
            break
        at = at + 0.5 * (room - 0.0025) * (place_of_hand(robot, path[-1:])[0] - at) / np.linalg.norm(
            place_of_hand(robot, path[-1:])[0] - at
        )
    assert room > robot.kept().max() + BETWEEN
    for off, clear in ((0.0, True), (-0.06, True), (0.06, False)):
        robot.clearance.measure(robot.sent + off * pitch, robot.sent)
        assert is_clear(robot, path) == clear, off
    # The same offset is but a lag where the robot was sent there lately.
    robot.clearance.measure(robot.sent, robot.sent + 0.06 * pitch)
    robot.clearance.measure(robot.sent + 0.06 * pitch, robot.sent)
    assert robot.clearance._following.unexplained(robot.sent + 0.06 * pitch).tolist() == [0.0] * 20


def test_nonsense_is_refused_by_name() -> None:
    robot = GatedRobot()
    checker, q = robot.clearance._checker, robot.q
    for path in (np.zeros((0, 20)), np.zeros((3, 19)), np.full((3, 20), np.nan)):
        with refuses(ValueError):
            checker.is_clear(q, path, dt=DT, share=0.5)
    with refuses(ValueError):
        checker.is_clear(q, np.zeros((2, 20)), dt=0.0, share=0.5)
    with refuses(ValueError):
        checker.is_clear(q, np.zeros((2, 20)), dt=DT, share=2.0)
