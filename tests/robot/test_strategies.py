"""Hands get to places by the cheapest strategy: the map that says so is measured, kept, and true; goals stay smooth."""

import re
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from benchmarks.reach import REACHED_M, Bench
from followers import DT, dimensions, op3, performer, shipped
from messages import refuses
from retarget.errors import ConfigError
from retarget.model.robot import load_robot
from retarget.pictures.reach import draw_reach, reach_numbers
from retarget.robot import reach_map
from retarget.robot.follower import Follower
from retarget.robot.reach_map import HANDS, load_map, map_path, save_map
from retarget.robot.strategies import Strategy, arms_alone, at_height, nearest_height
from retarget.schema.priorities import PositionTask, load_priorities


@pytest.fixture(scope="module")
def bench(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Bench]:
    """The OP3 with a coarse map, which is measured in seconds."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("XDG_CACHE_HOME", str(tmp_path_factory.mktemp("cache")))
        patch.setattr(reach_map, "NODES", 3)
        patch.setattr(reach_map, "HEIGHTS", 3)
        yield Bench("op3", "hands_first")


def test_what_the_map_says_is_reachable_is_reached(bench: Bench) -> None:
    found = [place for place in bench.places(14, seed=5) if place.named is not Strategy.STEP]
    assert len(found) >= 5
    assert np.mean([place.missed < REACHED_M for place in found]) >= 0.85  # the map is coarse


def test_each_strategy_takes_a_hand_where_the_cheaper_ones_do_not(bench: Bench) -> None:
    reach = bench.strategies.reach.hands[0]
    nodes, (by_arm, *heights) = reach.nodes.reshape(-1, 3), reach.field.reshape(-1, reach.field.shape[3]).T[:-3]
    far = 0.04  # m beyond the reach of the cheaper ones
    depths = {
        Strategy.ARM: by_arm,
        Strategy.TRUNK: np.where(by_arm > far, heights[-1], np.inf),
        # A trunk that leans reaches much beside the legs: on the ground ahead it does not.
        Strategy.CROUCH: np.where((heights[-1] > far) & (nodes[:, 0] > 0.1) & (nodes[:, 2] < far), heights[0], np.inf),
    }
    for strategy, depth in depths.items():
        place = nodes[np.argmin(depth)]
        assert bench.judge({"l_hand": place})[::2] == (strategy, strategy)


def test_beyond_all_reach_a_step_is_named_and_the_hand_goes_to_the_edge(bench: Bench) -> None:
    far = bench.follower.stance.points["l_shoulder"] + (0.6, 0.0, 0.0)
    missed = bench.go({"l_hand": far})
    assert bench.strategies.strategy is Strategy.STEP
    reached = bench.follower.hierarchy.solver.q
    hand = op3().points(reached[None], ("l_hand",))[0, 0]
    edge = bench.strategies.reach.hands[0]
    assert missed > 0.1 and abs(min(edge.at(edge.inside(hand))[1:-3])) < 0.5 * edge.spacing


def test_goals_stay_smooth_where_the_strategy_changes(bench: Bench) -> None:
    reach = bench.strategies.reach.hands[0]
    begin, end = reach.nodes.reshape(-1, 3)[reach.field[..., 0].argmin()], np.array([0.5, 0.1, 0.1])
    bench.strategies.forced = None
    bench.follower.start(bench.stands)
    named, joints = [], []
    for tick in range(500):
        share = 0.5 - 0.5 * np.cos(2.0 * np.pi * tick / 500)  # there and back
        posture = bench.follower.step(bench.human({"l_hand": begin + share * (end - begin)}), DT)
        named.append(bench.strategies.strategy)
        joints.append(posture.joint_positions)
    assert {*named} == {*Strategy}
    changes = sum(one is not other for one, other in pairwise(named))
    assert changes <= 10  # up to the step and back again, without flicker
    limits = op3().limits
    acceleration = np.abs(np.diff(joints, n=2, axis=0)) / DT**2
    assert (acceleration <= limits.max_acceleration * (1.0 + 1e-6)).all()
    assert bench.strategies.seconds[Strategy.STEP] == pytest.approx(DT * named.count(Strategy.STEP))


def test_the_map_is_drawn_with_its_numbers(bench: Bench, tmp_path: Path) -> None:
    path = tmp_path / "op3.png"
    draw_reach(op3(), bench.follower.stance, bench.strategies, path)
    assert path.read_bytes().startswith(b"\x89PNG")
    left, right = reach_numbers(bench.strategies)
    rooms = [float(room) for room in re.findall(r"(?:arm|trunk|crouch) ([\d.]+)", left)]
    assert len(rooms) == 3 and min(rooms) > 5.0  # litres
    assert left.startswith("l_hand") and right.startswith("r_hand")


def test_a_map_is_kept_and_one_that_is_damaged_is_measured_anew(bench: Bench, tmp_path: Path) -> None:
    kept, path = bench.strategies.reach, tmp_path / "kept" / "map.npz"
    assert load_map(path) is None
    save_map(kept, path)
    again = load_map(path)
    assert again is not None and again.heights == kept.heights
    for one, other in zip(again.hands, kept.hands, strict=True):
        np.testing.assert_array_equal(one.field, other.field)
    path.write_bytes(path.read_bytes()[:1000])
    assert load_map(path) is None
    files = ("hands_first", "balanced_hands_first")
    paths = {map_path(shipped(robot), load_priorities(name)) for robot in ("op3", "poppy") for name in files}
    assert len(paths) == 4  # of each robot and each file its own


def test_robots_without_strategies_have_none_of_their_tasks() -> None:
    priorities = load_priorities("hands_first")
    alone = arms_alone(priorities)
    tasks = [task.of for *_, task in alone.tasks() if isinstance(task, PositionTask)]
    assert not alone.strategies and not {*HANDS} & {name for of in tasks for name in of}
    size = dimensions(performer())
    for follower in (
        Follower(op3(), priorities, size, parts="upper"),
        Follower(load_robot("op3", root="fixed"), priorities, size),
    ):
        assert follower.strategies is None and not follower.hierarchy.position_slots(["l_hand"])[0].size


def test_a_file_with_strategies_needs_their_tasks(tmp_path: Path) -> None:
    path = tmp_path / "mine.yaml"
    path.write_text("name: mine\ndescription: Mine\nextends: servo\nstrategies: [trunk]\n")
    with refuses(ConfigError, "mine.yaml", "l_hand, r_hand"):
        load_priorities(path)


def test_the_height_of_a_crouch_is_the_nearest_one() -> None:
    heights, edges = (0.1, 0.2, 0.3), (0.05, -0.05, 0.05)
    assert at_height(heights, edges, 0.25) == pytest.approx(0.0)
    assert nearest_height(heights, edges, 0.3, 0.0) == pytest.approx(0.25)
    assert nearest_height(heights, edges, 0.1, 0.0) == pytest.approx(0.15)
    assert nearest_height(heights, edges, 0.22, 0.0) == pytest.approx(0.22)
    assert nearest_height(heights, edges, 0.3, -0.2) == pytest.approx(0.2)  # none is deep enough: the best
