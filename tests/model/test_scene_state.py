"""Obstacles of a scene: canonical shapes, motions by the file, live poses, and where they are at a time."""

import math
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal

from messages import refuses
from retarget import rotations
from retarget.errors import UsageError
from retarget.model.scene_shapes import ShapeKind, canonical, scene_shapes
from retarget.model.scene_state import (
    LIVE_SPEED,
    LIVE_TURN,
    VELOCITY_HOLDS,
    LivePose,
    ObstacleMotion,
    ObstaclePoses,
    SceneState,
    motion_of,
)
from retarget.rotations import turn
from retarget.schema.scene import NO_MOTION, MovingPose, Obstacle, ObstacleShape, Pose, Scene, load_scene

Triple = tuple[float, ...]
COORDINATES = st.tuples(*[st.floats(-2, 2)] * 3)


def scene(**obstacles: Any) -> Scene:
    return Scene.model_validate({"name": "a", "description": "b", "obstacles": obstacles})


def shape(**measures: object) -> ObstacleShape:
    return ObstacleShape.model_validate(measures)


@given(COORDINATES, COORDINATES)
def test_rods_lie_between_their_points_and_half_spaces_below_their_plane(start: Triple, end: Triple) -> None:
    length = float(np.linalg.norm(np.subtract(end, start)))
    if length < 1e-3:
        return
    line = {"from": start, "to": end}
    for rod, kind, radius in (
        (shape(segment=line), ShapeKind.CAPSULE, 0.0),
        (shape(capsule=line | {"radius": 0.2}), ShapeKind.CAPSULE, 0.2),
        (shape(cylinder=line | {"radius": 0.2}), ShapeKind.CYLINDER, 0.2),
    ):
        found, sizes, pose = canonical(rod)
        assert found == kind
        assert sizes == pytest.approx((radius, 0.5 * length, 0.0))
        for end_z, point in ((-sizes[1], start), (sizes[1], end)):
            assert_allclose(pose.position + rotations.rotate(pose.quat, [0, 0, end_z]), point, atol=1e-12)
    normal = np.subtract(end, start) / length
    kind, sizes, pose = canonical(shape(half_space={"point": start, "normal": tuple(3.0 * normal)}))
    assert (kind, sizes) == (ShapeKind.HALF_SPACE, (0, 0, 0))
    assert pose.position == pytest.approx(start)
    assert_allclose(rotations.rotate(pose.quat, [0, 0, 1]), normal, atol=1e-12)


def test_arrays_in_the_order_of_the_file() -> None:
    wall = {"shape": {"half_space": {"normal": [1, 0, 0]}}, "influence": 0.3}
    shapes = scene_shapes(scene(wall=wall, ball={"shape": {"sphere": {"radius": 0.1}}, "margin": 0.0}))
    assert shapes.names == ("wall", "ball")
    assert_array_equal(shapes.kinds, [3, 0])
    assert_array_equal(shapes.sizes, [[0, 0, 0], [0.1, 0, 0]])
    assert_array_equal(shapes.influence, [0.3, 0.1])
    assert_array_equal(shapes.margin, [0.01, 0.0])
    state = SceneState(load_scene("table"))
    now = state.at(0.0)
    parts = (now.position, now.quat, now.linear_velocity, now.angular_velocity)
    assert [part.shape for part in parts] == [(5, 3), (5, 4), (5, 3), (5, 3)]
    assert all(part.flags.c_contiguous for part in parts[:3])
    now.position[:] = 9.0
    assert_array_equal(state.at(0.0).position[0], [0.31, 0, 0.212])


UPRIGHT = (1.0, 0.0, 0.0, 0.0)
NAN, INF = math.nan, math.inf
ANY = st.floats(allow_nan=True, allow_infinity=True)


def seen(live: LivePose, time: float) -> MovingPose:
    moving = live.at(time)
    assert moving is not None
    return moving


@pytest.mark.parametrize(
    "bad",
    [
        {"position": (NAN, 0, 0)},
        {"position": (0, -INF, 0)},
        {"position": (0, 0, 1001)},
        {"position": (0, 0)},
        {"position": (0, 0, 0, 0)},
        {"position": ("a", 0, 0)},
        {"position": None},
        {"position": (10**400, 0, 0)},
        {"quat": (0, 0, 0, 0)},
        {"quat": (1, 0, NAN, 0)},
        {"quat": (1, 0, 0)},
        {"time": NAN},
        {"time": INF},
        {"time": 0.99},
        {"velocity": (NAN, 0, 0)},
        {"angular_velocity": (0, INF, 0)},
        {"angular_velocity": 3},
    ],
)
def test_bad_updates_are_dropped_and_the_last_good_pose_stays(bad: dict[str, Any]) -> None:
    live = LivePose()
    assert live.update((1, 2, 3), UPRIGHT, time=1.0, velocity=(0.5, 0, 0))
    good: dict[str, Any] = {"position": (4, 5, 6), "quat": UPRIGHT, "time": 1.1}
    held = seen(live, 1.1)
    assert not live.update(**(good | bad))
    assert live.dropped == 1
    assert seen(live, 1.1) == held
    assert live.age(1.1) == pytest.approx(0.1)
    assert live.update(**good)
    assert (live.dropped, seen(live, 1.1).pose) == (1, Pose((4, 5, 6), UPRIGHT))
    assert live.age(1.1) == 0.0


def test_the_velocity_is_that_of_the_last_two_good_poses_and_bounded() -> None:
    live = LivePose()
    live.update((0, 0, 0), UPRIGHT, time=1.0)
    assert seen(live, 1.0) == MovingPose(Pose((0, 0, 0), UPRIGHT))
    live.update((NAN, 0, 0), UPRIGHT, time=1.05)
    live.update((0.1, 0, 0), rotations.from_rotation_vector([0, 0, 0.2]), time=1.1)
    assert seen(live, 1.1).linear == pytest.approx((1, 0, 0))
    assert seen(live, 1.1).angular == pytest.approx((0, 0, 2))
    live = LivePose()
    live.update((0, 0, 0), UPRIGHT, time=1.0)
    live.update((3, 4, 0), rotations.from_rotation_vector([0, 0, 3]), time=1.0 + 1e-9)
    assert seen(live, 1.0).linear == pytest.approx((0.6 * LIVE_SPEED, 0.8 * LIVE_SPEED, 0))
    assert seen(live, 1.0).angular == pytest.approx((0, 0, LIVE_TURN))
    live.update((3, 4, 0), UPRIGHT, time=2.0, velocity=(0, 0, -1e6))
    assert seen(live, 2.0).linear == pytest.approx((0, 0, -LIVE_SPEED))


def test_between_updates_it_goes_on_and_in_silence_it_comes_to_rest() -> None:
    """Of what moves at 1 m/s and turns at 2 rad/s, 30 poses a second are followed at 125 ticks, at most a pose late."""
    live = LivePose()
    live.update((1, 0, 0), UPRIGHT, time=1.0, velocity=(1, 0, 0))
    soon, late = (seen(live, 1.0 + share * VELOCITY_HOLDS) for share in (0.5, 1.1))
    assert (soon.linear, late.linear) == ((1, 0, 0), NO_MOTION)
    assert_allclose(soon.pose.position, (1.0 + 0.5 * VELOCITY_HOLDS, 0, 0))
    assert_allclose(late.pose.position, (1.0 + VELOCITY_HOLDS, 0, 0))
    slow = LivePose()
    for tick in range(125):
        time = tick / 125.0
        last = int(time * 30.0 + 1e-9) / 30.0
        slow.update((last, 0, 0), (np.cos(last), 0, 0, np.sin(last)), time=last)
        there = seen(slow, time).pose
        assert tick <= 10 or max(abs(there.position[0] - time), abs(there.quat[3] - np.sin(time))) < 1e-9


@given(st.lists(st.tuples(ANY, ANY, ANY, ANY, ANY, ANY), max_size=8))
def test_for_any_update_poses_are_finite(updates: list[tuple[float, ...]]) -> None:
    live = LivePose()
    for x, y, w, i, time, speed in updates:
        taken = live.update((x, y, 0), (w, i, 0, 0), time=time)
        taken_with_velocity = live.update((0, y, x), (w, i, 0, 0), time=time, velocity=(speed, 0, 0))
        moving = live.at(time)
        assert moving is not None or not (taken or taken_with_velocity)
        if moving is not None:
            numbers = (*moving.pose.position, *moving.pose.quat, *moving.linear, *moving.angular)
            assert all(map(math.isfinite, numbers))
            assert math.hypot(*moving.pose.quat) == pytest.approx(1.0)
            assert math.hypot(*moving.linear) <= LIVE_SPEED * (1 + 1e-12)
            assert math.hypot(*moving.angular) <= LIVE_TURN * (1 + 1e-12)
    assert live.dropped <= 2 * len(updates)


TILTED = Pose((1.0, -2.0, 0.5), turn((0.3, -1.0, 2.0)))
STAND = Pose((1.0, 2.0, 0.0), turn((0.0, 0.0, 0.5 * math.pi)))
ROD = {"capsule": {"from": [0, 0, 0], "to": [0, 0.4, 0], "radius": 0.1}}


def test_the_stand_carries_its_obstacles() -> None:
    keys = {"shape": ROD, "at": {"pos": [1, 0, 0]}, "velocity": [1, 0, 0]}
    state = SceneState(scene(here=keys, there=keys | {"frame": "stand"}), stand=STAND)
    now = state.at(1.0)
    assert_allclose(now.position, [[2, 0.2, 0], [0.8, 4, 0]], atol=1e-12)
    assert_allclose(now.linear_velocity, [[1, 0, 0], [0, 1, 0]], atol=1e-12)
    assert state.live("there").update((0, 0, 0), (1, 0, 0, 0), time=1.0, velocity=(0, 1, 0))
    now = state.at(1.0)
    assert_allclose(now.position[1], [0.8, 2, 0], atol=1e-12)
    assert_allclose(now.linear_velocity[1], [-1, 0, 0], atol=1e-12)


def differences(state: SceneState, time: float, step: float = 1e-6) -> tuple[ObstaclePoses, Any, Any]:
    before, now, after = (state.at(moment) for moment in (time - step, time, time + step))
    turned = rotations.log(rotations.multiply(after.quat, rotations.conjugate(before.quat)))
    return now, (after.position - before.position) / (2 * step), turned / (2 * step)


def test_velocities_of_shape_frames_are_derivatives() -> None:
    path = [{"time": 0, "pos": [0, 0, 0]}, {"time": 1, "pos": [1, 2, 3], "quat": [0.5, 0.5, 0.5, 0.5]}]
    spin = {"shape": ROD, "angular_velocity": [1, -2, 3], "velocity": [0.5, 0, 0], "frame": "stand"}
    now, linear, angular = differences(
        SceneState(scene(rod={"shape": ROD, "path": path}, spin=spin), stand=TILTED), 0.4
    )
    assert_allclose(now.linear_velocity, linear, atol=1e-8)
    assert_allclose(now.angular_velocity, angular, atol=1e-8)
    assert np.abs(linear).min(axis=0).max() > 0.1


@pytest.mark.parametrize("keys", [{}, {"velocity": [1, 0, 0]}], ids=["still", "moving"])
def test_a_live_update_overrides_the_file(keys: dict[str, Any]) -> None:
    state = SceneState(scene(other={"shape": ROD}, ball={"shape": {"sphere": {"radius": 0.1}}} | keys))
    assert state.live("ball").age(3.0) == math.inf
    assert not state.live("ball").update((math.nan, 0, 0), (1, 0, 0, 0), time=1.0)
    assert state.at(1.0).position[1, 0] == pytest.approx(1.0 if keys else 0.0)
    assert state.live("ball").update((5, 6, 7), (1, 0, 0, 0), time=2.0)
    assert not state.live("ball").update((9, 9, 9), (1, 0, 0, 0), time=1.0)
    assert_allclose(state.at(3.0).position, [[0.0, 0.2, 0.0], [5.0, 6.0, 7.0]])
    assert_array_equal(state.at(3.0).linear_velocity, np.zeros((2, 3)))
    assert (state.live("ball").age(3.0), state.live("ball").dropped, state.live("other").dropped) == (1.0, 2, 0)


def test_an_unknown_obstacle_is_refused_with_the_nearest_name() -> None:
    state = SceneState(load_scene("table"))
    with refuses(UsageError, found="'tpo'", allowed="l_front_leg", next_step="top"):
        state.live("tpo")


STEP = 1e-5
TURNS = st.tuples(*[st.floats(-1.5, 1.5)] * 3).map(lambda turn: tuple(rotations.from_rotation_vector(turn).tolist()))


def motion(**keys: Any) -> ObstacleMotion:
    return motion_of(Obstacle.model_validate({"shape": {"sphere": {"radius": 0.1}}} | keys))


@st.composite
def paths(draw: st.DrawFn, *, loop: bool = False) -> ObstacleMotion:
    count = draw(st.integers(2, 6))
    times = np.cumsum(draw(st.lists(st.floats(0.1, 2), min_size=count, max_size=count)))
    points = [{"time": float(time), "pos": draw(COORDINATES), "quat": draw(TURNS)} for time in times]
    if loop:
        points[-1] |= {"pos": points[0]["pos"], "quat": points[0]["quat"]}
    return motion(path=points, loop=loop)


def separation(a: MovingPose, b: MovingPose) -> float:
    """Distance and angle between two poses, the larger one."""
    distance = float(np.linalg.norm(np.subtract(a.pose.position, b.pose.position)))
    return max(distance, float(rotations.angle_between(a.pose.quat, b.pose.quat)))


def check_derivative(path: ObstacleMotion, time: float) -> None:
    before, now, after = path.at(time - STEP), path.at(time), path.at(time + STEP)
    rate = np.subtract(after.pose.position, before.pose.position) / (2 * STEP)
    assert_allclose(rate, now.linear, atol=1e-6)
    turn = rotations.log(rotations.multiply(after.pose.quat, rotations.conjugate(before.pose.quat)))
    assert_allclose(turn / (2 * STEP), now.angular, atol=1e-6)


@given(paths(), st.floats(0.01, 0.99), st.floats(0.001, 100))
def test_a_path_goes_through_its_points_without_a_jump_and_rests_before_and_after(
    path: ObstacleMotion, share: float, time: float
) -> None:
    for at, piece in zip(path.times, path.pieces, strict=True):
        assert separation(path.at(at), MovingPose(piece.pose)) < 1e-9
        assert separation(path.at(at - 1e-9), path.at(at)) < 1e-6
    for start, end in pairwise(path.times):
        check_derivative(path, start + share * (end - start))
    early, late = path.at(path.times[0] - time), path.at(path.times[-1] + time)
    assert (early.linear, early.angular, late.linear, late.angular) == (NO_MOTION,) * 4
    assert separation(early, MovingPose(path.pieces[0].pose)) < 1e-12
    assert separation(late, MovingPose(path.pieces[-1].pose)) < 1e-12


@given(paths(loop=True), st.floats(0, 1, exclude_max=True), st.integers(1, 1000), st.floats(0, 500))
def test_a_loop_begins_anew_and_never_rests_at_its_seam(
    path: ObstacleMotion, share: float, rounds: int, later: float
) -> None:
    period = path.times[-1] - path.times[0]
    time = path.times[0] + share * period
    assert separation(path.at(time), path.at(time + rounds * period)) < 1e-6
    assert separation(path.at(path.times[-1] - 1e-9), path.at(path.times[-1])) < 1e-6
    assert path.at(path.times[-1] + later).linear in [piece.linear for piece in path.pieces[:-1]]


@given(COORDINATES, COORDINATES, st.floats(0.1, 0.9))
def test_a_constant_velocity_lasts_from_until(
    velocity: tuple[float, ...], spin: tuple[float, ...], share: float
) -> None:
    place = {"pos": [1, 2, 3], "quat": [0.6, 0, 0.8, 0]}
    drift = motion(velocity=velocity, angular_velocity=spin, at=place, **{"from": 1, "until": 3})
    check_derivative(drift, 1 + 2 * share)
    assert drift.at(0.0) == drift.at(-5.0) == MovingPose(drift.pieces[0].pose)
    assert drift.at(3.0) == drift.at(100.0) == MovingPose(drift.at(3.0).pose)
    assert_allclose(drift.at(3.0).pose.position, [1, 2, 3] + 2 * np.array(velocity), atol=1e-12)
