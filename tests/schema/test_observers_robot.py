"""OP3 among obstacles: whatever they are and wherever they come from, they are evaded, and goals are reached after."""

from functools import cache

import numpy as np
import pytest

from followers import DT, assert_within_limits, op3
from observed import ZONE, Done, act, depth, human, observed, raised, robot, scene_of, sphere
from retarget.model.scene_state import SceneState
from retarget.schema.priorities import ReactiveTask, load_priorities
from retarget.types import FloatArray


@cache
def hand() -> FloatArray:
    """Where the right hand is when the performer stands, (3,) m."""
    return np.asarray(act(robot(None), None, [human()[0]]).reached("r_hand")[-1])


@cache
def free() -> Done:
    return act(robot(None), None, raised())


def plate(at: tuple[float, float, float], size: tuple[float, float, float]) -> dict[str, object]:
    return {"shape": {"box": {"size": size}}, "at": {"pos": at}, **ZONE}


def fixtures() -> dict[str, SceneState]:
    """In the way of the right hand, clear of where it begins and ends."""
    low, middle, high = (free().reached("r_hand")[tick] for tick in (150, 200, 250))
    furthest = free().reached("r_hand")[:, 0].max()
    wall = {"shape": {"half_space": {"point": (furthest - 0.02, 0.0, 0.0), "normal": (-1.0, 0.0, 0.0)}}, **ZONE}
    edge = plate((low[0] + 0.08, 0.0, low[2]), (0.1, 0.3, 0.008))
    gap = {
        side: plate((middle[0] + 0.04, middle[1] + sign * 0.025, middle[2]), (0.05, 0.015, 0.03))
        for side, sign in (("left", 1.0), ("right", -1.0))
    }
    return {
        "low sphere": scene_of(ball=sphere(low)),
        "sphere": scene_of(ball=sphere(middle)),
        "high sphere": scene_of(ball=sphere(high)),
        "sphere ahead": scene_of(ball=sphere(middle + np.array([0.02, 0.0, 0.0]))),
        "wall": scene_of(wall=wall),
        "table edge": scene_of(edge=edge),
        "gap narrower than the arm": scene_of(**gap),
    }


NAMES = ("low sphere", "sphere", "high sphere", "sphere ahead", "wall", "table edge", "gap narrower than the arm")


@pytest.mark.long
@pytest.mark.parametrize("name", NAMES)
def test_what_is_in_the_way_of_a_hand_is_evaded(name: str) -> None:
    state = fixtures()[name]
    unaware = min(observed(q, state, 0.0).min() for q in free().q[::4])
    done = act(robot(state), state, raised())
    assert unaware < -0.007 < 0.02 < done.distance[0].min()  # without observers it would be entered
    assert done.distance.min() > 0.0035 and done.geoms_apart() > 0.0 and done.self_apart() > 0.0
    assert_within_limits(done.joints)
    assert done.error("r_hand")[-1] < free().error("r_hand")[-1] + 0.005
    assert done.error("l_hand").mean() < free().error("l_hand").mean() + 0.001


def test_an_obstacle_that_appears_inside_the_arm_is_left_at_a_bounded_speed() -> None:
    state = scene_of(ball=sphere((0.0, -0.6, 0.2)))
    follower = robot(state)
    follower.start(human()[0])
    follower.settle(human()[0], DT)
    q, near = [follower.step(human()[0], DT).q], []
    depth_before = -np.inf
    for tick in range(400):
        if tick == 10:
            assert state.live("ball").update(hand() + np.array([0.0, -0.01, 0.0]), (1.0, 0.0, 0.0, 0.0), time=tick * DT)
            depth_before = float(observed(q[-1], state, tick * DT)[0])
        q.append(follower.step(human()[0], DT).q)
        near.append(float(observed(q[-1], state, tick * DT)[0]))
    assert depth_before < -0.01
    inside = np.array([depth_before, *near[10:]])
    gained = np.diff(inside[inside < 0.0])
    out = next(task.speed for _, _, task in load_priorities("servo").tasks() if isinstance(task, ReactiveTask))
    assert (gained >= -1e-6).all() and gained.max() <= out * DT * 1.1
    assert near[-1] > 0.0035
    assert_within_limits(np.array(q)[:, op3().servo_columns])


def test_among_random_obstacles_nothing_breaks() -> None:
    """100 scenes of four spheres, still, moving or already inside the robot; seed 0."""
    rng = np.random.default_rng(0)
    state = scene_of(**{f"o{k}": sphere((0.0, 2.0, k), radius=0.02 + 0.02 * k) for k in range(4)})
    follower = robot(state)
    for scene in range(100):
        follower.start(human()[0])
        speed = rng.normal(0.0, 0.2, (4, 3)) * (scene % 2)
        at = rng.uniform([-0.2, -0.3, 0.0], [0.3, 0.3, 0.5], (4, 3))
        done = []
        goal = human()[int(rng.integers(len(human())))]
        for tick in range(12):
            time = (100 * scene + tick) * DT
            for k in range(4):
                state.live(f"o{k}").update(
                    at[k] + tick * DT * speed[k], (1.0, 0.0, 0.0, 0.0), time=time, velocity=speed[k]
                )
            posture = follower.step(goal, DT)
            done.append((posture.q, depth(posture.q, state, time)))
        q, deep = np.array([q for q, _ in done]), np.array([d for _, d in done])
        assert np.isfinite(q).all()
        assert_within_limits(q[:, op3().servo_columns])
        if not scene % 2:
            assert np.diff(deep).max() < 5e-4, f"scene {scene}"  # links that are inside on two sides are traded
