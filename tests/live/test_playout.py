"""Sensors sent with jitter, out of order and at their own times, read on a steady tick."""

from bisect import bisect_right
from math import inf, nan, pi

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from messages import refuses
from recordings import How
from retarget import rotations
from retarget._solver import PoseFilter, PoseRing
from retarget.errors import UsageError
from retarget.live.playout import (
    DELAY_CAP_S,
    EXTRAPOLATION_S,
    Cutoffs,
    Playout,
    PlayoutDelay,
    PlayoutSample,
    pose_filter,
)
from retarget.live.roles import Rows
from retarget.rotations import IDENTITY
from retarget.types import BoolArray, FloatArray

COUNT = 12
ROWS = np.arange(COUNT)
ALL = np.ones(COUNT, dtype=bool)
RNG = np.random.default_rng(1)
PLACE, SPEED = RNG.normal(size=(2, COUNT, 3))
START = rotations.normalise(RNG.normal(size=(COUNT, 4)))
SPIN = RNG.normal(size=(COUNT, 3))


def pose(time: float) -> tuple[FloatArray, FloatArray]:
    """Every sensor moves straight and turns evenly."""
    return PLACE + time * SPEED, rotations.multiply(rotations.from_rotation_vector(time * SPIN), START)


class Lateness(PlayoutDelay):
    """The delay without the time between frames."""

    def note(self, arrival: float, *, lateness: float, gap: float) -> None:
        super().note(arrival, lateness=lateness, gap=inf)


def buffered(delay: type[PlayoutDelay] = PlayoutDelay) -> Playout:
    return Playout(COUNT, delay=delay())


def push(playout: Playout, time: float, *, late: float = 0.001, rows: Rows = ROWS, valid: BoolArray = ALL) -> None:
    position, orientation = pose(time)
    playout.push(rows, time, position[rows], orientation[rows], valid[rows], arrival=time + late)


def worst(played: PlayoutSample) -> float:
    """Largest error against the motion at the time of the played pose, m or rad."""
    errors = [0.0]
    for row in np.nonzero(played.how != How.NONE)[0]:
        position, orientation = pose(float(played.time[row]))
        errors.append(float(np.abs(played.position[row] - position[row]).max()))
        errors.append(float(rotations.angle_between(played.orientation[row], orientation[row])))
        assert np.linalg.norm(played.orientation[row]) == pytest.approx(1.0, abs=1e-9)
    return max(errors)


def test_straight_motion_is_played_exactly_whatever_the_jitter() -> None:
    rng, playout = np.random.default_rng(2), buffered()
    waiting = sorted((t + float(rng.uniform(0.0, 0.02)), t) for t in 5.0 + np.arange(400) / 120.0)
    kinds, shown = list[int](), list[FloatArray]()
    for now in 5.5 + np.arange(250) / 100.0:
        while waiting and waiting[0][0] <= now:
            arrival, time = waiting.pop(0)
            push(playout, time, late=arrival - time)
        played = playout.read(float(now))
        assert worst(played) < 1e-7
        assert (now - played.time <= DELAY_CAP_S + 1e-9).all()
        assert 0.0 < playout.delay <= DELAY_CAP_S + 1e-9
        kinds.extend(played.how.tolist())
        shown.append(played.time)
    assert (np.diff(shown, axis=0) >= 0.0).all()
    assert kinds.count(How.INTERPOLATED) > 0.97 * len(kinds)


def test_motion_is_extrapolated_for_50_ms_and_then_held() -> None:
    playout = buffered(delay=Lateness)
    for i in range(20):
        push(playout, 1.0 + 0.01 * i, late=0.0)
    newest = 1.19
    for ahead in (0.01, 0.03, EXTRAPOLATION_S - 1e-9):
        played = playout.read(newest + ahead)
        assert set(played.how) == {How.EXTRAPOLATED} and played.time == pytest.approx(newest + ahead)
        assert worst(played) < 1e-7
    end = played
    for ahead in (0.06, 0.5, 100.0):
        held = playout.read(newest + ahead)
        assert set(held.how) == {How.HELD} and held.age == pytest.approx(ahead)
        assert held.position == pytest.approx(end.position, abs=1e-6) and worst(held) < 1e-7
        assert held.valid.all()
    push(playout, 102.0, late=0.0)
    again = playout.read(102.0)
    assert set(again.how) == {How.LATEST} and worst(again) < 1e-9


def test_latest_wins_shows_the_newest_as_it_is() -> None:
    playout = Playout(COUNT)
    for time in (1.0, 1.02, 1.01):
        push(playout, time)
        played = playout.read(1.03)
        assert worst(played) < 1e-9 and set(played.how) == {How.LATEST}
    assert (played.time == 1.02).all() and played.age == pytest.approx(0.01)
    push(playout, 1.05)
    assert (played.time == 1.02).all() and playout.delay == 0.0
    assert set(playout.read(1.2).how) == {How.HELD}


def test_a_sensor_never_sent_is_nan() -> None:
    for playout in (buffered(), Playout(COUNT)):
        played = playout.read(1.0)
        assert set(played.how) == {How.NONE} and not played.valid.any() and (played.age == inf).all()
        push(playout, 2.0, rows=np.array([3, 5]))
        played = playout.read(2.01)
        sent = np.isin(ROWS, [3, 5])
        assert ((played.how != How.NONE) == sent).all() and (played.valid == sent).all()
        assert (np.isnan(played.position).all(axis=1) == ~sent).all()
        assert (np.isnan(played.time) == ~sent).all()


@settings(max_examples=20)
@given(st.integers(0, 2**32 - 1))
def test_the_sign_of_a_quaternion_does_not_matter(seed: int) -> None:
    rng = np.random.default_rng(seed)
    one, other = buffered(), buffered()
    before: FloatArray | None = None
    for i in range(30):
        time = 1.0 + 0.01 * i
        position, orientation = pose(6.0 * time)
        sign = rng.choice([-1.0, 1.0], COUNT)[:, None] if i else 1.0
        one.push(ROWS, time, position, orientation, ALL, arrival=time)
        other.push(ROWS, time, position, sign * orientation, ALL, arrival=time)
        a, b = one.read(time + 0.003), other.read(time + 0.003)
        assert np.abs(a.orientation - b.orientation).max() < 1e-7
        assert before is None or (np.sum(before * a.orientation, axis=1) > 0.9).all()
        before = a.orientation


def test_a_sensor_that_the_sender_lost_is_not_valid_until_it_is_back() -> None:
    playout = buffered()
    for i in range(10):
        push(playout, 1.0 + 0.01 * i)
    lost = ALL.copy()
    lost[4] = False
    for i in range(10, 20):
        push(playout, 1.0 + 0.01 * i, late=0.0, valid=lost)
    played = playout.read(1.2)
    assert (played.valid == lost).all() and np.isfinite(played.position).all() and played.how[4] == How.HELD
    push(playout, 1.2)
    push(playout, 1.21)
    assert playout.read(1.23).valid.all()


def test_nonsense_is_not_stored_and_a_missing_part_is_no_nonsense() -> None:
    playout, rows, yes = Playout(6), np.arange(6), np.ones(6, dtype=bool)
    position, orientation = np.zeros((6, 3)), np.tile(rotations.IDENTITY, (6, 1))
    position[0], orientation[1], position[2, 1], position[3, 1], orientation[4] = nan, nan, nan, inf, 0.0
    playout.push(rows, 1.0, position, orientation, yes, arrival=1.0)
    played = playout.read(1.0)
    assert played.valid.tolist() == [True, True, False, False, False, True]
    assert np.isnan(played.position[0]).all() and np.isfinite(played.orientation[0]).all()
    for time in (nan, inf, 5.0):
        playout.push(rows, time, position, orientation, yes, arrival=1.0)
    assert playout.dropped.reasons == {"not a capture time": 3} and playout.read(1.0).age[5] == 0.0


@pytest.mark.parametrize(
    ("pushes", "seed"), [(3_000, 4), *(pytest.param(100_000, seed, marks=pytest.mark.long) for seed in range(3))]
)
def test_a_storm_of_pushes(pushes: int, seed: int) -> None:
    """Random pushes and reads: nothing is raised, time and memory stay in bounds."""
    rng, playout = np.random.default_rng(seed), Playout(6, delay=PlayoutDelay())
    odd = np.array([0.0, nan, inf, -inf, 1e300, 1e-300, -1.0, 1e4])
    now, before = 0.0, np.full(6, -inf)
    for _ in range(pushes):
        now += float(rng.exponential(0.004))
        rows = np.flatnonzero(rng.random(6) < 0.6)
        position, orientation = rng.normal(size=(len(rows), 3)), rng.normal(size=(len(rows), 4))
        if rng.random() < 0.2:
            for part in (position, orientation):
                part[rng.random(part.shape) < 0.2] = rng.choice(odd)
        time = now - float(rng.choice([0.0, 0.01, 0.02, 1.0, -0.05])) * float(rng.random())
        playout.push(rows, time, position, orientation, rng.random(len(rows)) < 0.95, arrival=now)
        if rng.random() < 0.5:
            played = playout.read(now)
            settled = (played.how >= How.EXTRAPOLATED) | (played.how == How.INTERPOLATED)
            assert (played.time[settled] >= before[settled] - 1e-9).all()
            before[settled] = played.time[settled]
            assert (now - played.time[settled & (played.age < 0.05)] <= DELAY_CAP_S + 0.06).all()
            size = np.linalg.norm(played.orientation, axis=1)
            assert (np.isnan(size) | (np.abs(size - 1.0) < 1e-6)).all()
            assert not np.isinf(played.position).any()
    assert set(playout.dropped.reasons) <= {"repeated", "older than what is kept", "not a capture time"}


def test_the_delay_grows_at_once_shrinks_slowly_and_does_not_wait_for_a_rare_late_frame() -> None:
    delay, rng = PlayoutDelay(), np.random.default_rng(0)

    def run(first: int, frames: int, jitter: float) -> list[float]:
        """The delay after each frame at 100 Hz; within 10 frames the lateness reaches 0 and `jitter`."""
        found = []
        for i in range(first, first + frames):
            capture, lateness = 0.01 * i, jitter * (i % 10 == 0 or rng.random() * (i % 10 != 1))
            delay.note(capture + lateness, lateness=lateness, gap=0.01)
            found.append(delay.at(capture + 0.01))
        return found

    assert run(1000, 300, 0.002)[-1] == pytest.approx(0.012)
    late = run(1300, 300, 0.025)
    assert max(late[30:]) == pytest.approx(late[-1], abs=1e-3) and late[30] > 0.03
    after = run(1600, 1000, 0.002)
    assert after[100] > 0.03
    assert after[-1] == pytest.approx(0.012, abs=5e-4)
    assert np.diff(after).min() > -0.05 / 100.0
    delay, found = PlayoutDelay(), []
    for i in range(1000):
        capture, lateness = 10.0 + 0.01 * i, 0.025 if i % 40 == 39 else 0.002
        delay.note(capture + lateness, lateness=lateness, gap=0.01)
        found.append(delay.at(capture + 0.01))
    assert max(found[200:]) == pytest.approx(0.012)


@given(st.lists(st.tuples(st.floats(0.0, 1.0), st.floats(-1.0, 10.0), st.floats(0.0, 10.0)), max_size=50))
def test_the_delay_is_bounded(sent: list[tuple[float, float, float]]) -> None:
    delay, now = PlayoutDelay(), 0.0
    for step, lateness, gap in sent:
        now += step
        delay.note(now, lateness=lateness, gap=gap)
        assert 0.0 <= delay.at(now) <= DELAY_CAP_S


RING_DEPTH = 5
RING = 3
UNIT = 1.0 / 64.0
"""s; whole numbers of it are exact."""
PUSHES = st.lists(
    st.tuples(st.sets(st.integers(0, RING - 1), min_size=1), st.integers(0, 40), st.floats(-2.0, 60.0)), max_size=60
)


def place(row: int, time: float) -> FloatArray:
    """Where a sensor is: no two pairs of times give one line."""
    return np.array([row, time * time, 1.0 / (1.0 + abs(time))])


def expected(row: int, times: list[float], at: float) -> tuple[How, float, FloatArray]:
    """What a list of times shows at one."""
    rank = bisect_right(times, at)
    if not times:
        return How.NONE, np.nan, np.full(3, np.nan)
    if rank == 0:
        return How.LATEST, times[0], place(row, times[0])
    if rank < len(times):
        before, after, time, how = times[rank - 1], times[rank], at, How.INTERPOLATED
    else:
        after = times[-1]
        past = [one for one in times if after - 0.2 <= one <= after - 0.02]
        before = past[-1] if past else after
        time = min(at, after + EXTRAPOLATION_S)
        how = How.HELD if at > time else How.EXTRAPOLATED if past and at > after else How.LATEST
    share = (time - before) / (after - before) if after > before else 0.0
    return how, time, place(row, before) + share * (place(row, after) - place(row, before))


@given(PUSHES)
def test_a_ring_is_a_sorted_list_of_the_newest(pushes: list[tuple[set[int], int, float]]) -> None:
    ring = PoseRing(RING, depth=RING_DEPTH, extrapolation=EXTRAPOLATION_S)
    lists: list[list[float]] = [[] for _ in range(RING)]
    for chosen, number, read in pushes:
        rows, time, at = sorted(chosen), UNIT * number, UNIT * read
        position, turns = np.array([place(row, time) for row in rows]), np.tile(IDENTITY, (len(rows), 1))
        newest, repeated, too_old = ring.push(np.array(rows), time, position, turns, np.ones(len(rows), dtype=bool))
        assert newest == max(lists[row][-1] if lists[row] else -np.inf for row in rows)
        assert repeated == sum(time in lists[row] for row in rows)
        full = [row for row in rows if len(lists[row]) == RING_DEPTH and time < lists[row][0]]
        assert too_old == len(full)
        for row in rows:
            if time not in lists[row]:
                lists[row] = sorted([*lists[row], time])[-RING_DEPTH:]
        played = PlayoutSample(*ring.read(at, at + 1.0))
        for row in range(RING):
            how, shown, where = expected(row, lists[row], at)
            assert played.how[row] == how and played.valid[row] == bool(lists[row])
            np.testing.assert_allclose(played.time[row], shown, rtol=0.0, atol=1e-12)
            np.testing.assert_allclose(played.position[row], where, rtol=0.0, atol=1e-9)
            assert played.age[row] == (at + 1.0 - lists[row][-1] if lists[row] else np.inf) or played.age[row] == 0.0


def test_bad_arrays_are_refused() -> None:
    ring, one = PoseRing(2, depth=4, extrapolation=EXTRAPOLATION_S), np.ones(1, dtype=bool)
    place_, turn = np.zeros((1, 3)), np.array([IDENTITY])
    for rows in ([2], [-1]):
        with refuses(ValueError):
            ring.push(np.array(rows), 1.0, place_, turn, one)
    for arrays in ((place_[:, :2], turn, one), (place_, turn[:, :3], one), (place_, turn, one[:0])):
        with refuses(ValueError):
            ring.push(np.array([0]), 1.0, *arrays)


def test_positions_have_the_filter_of_the_paper() -> None:
    """Algorithm 1 of the paper, on one component, with irregular times."""
    rng = np.random.default_rng(0)
    values, dt = rng.normal(size=200), rng.uniform(0.002, 0.03, 199)

    def alpha(cutoff: float, step: float) -> float:
        return 1.0 / (1.0 + 1.0 / (2.0 * pi * cutoff) / step)

    expected, speed = [values[0]], 0.0
    for value, step in zip(values[1:], dt, strict=True):
        speed += alpha(1.0, step) * ((value - expected[-1]) / step - speed)
        share = alpha(1.0 + 0.5 * abs(speed), step)
        expected.append(share * value + (1.0 - share) * expected[-1])
    poses, found = PoseFilter(1, position=(1.0, 0.5, 1.0), orientation=None), []
    for value, time in zip(values, 3.0 + np.cumsum([0.0, *dt]), strict=True):
        position, _ = poses.step(np.array([time]), np.array([[value, 0.0, 0.0]]), np.zeros((1, 4)))
        found.append(position[0, 0])
    assert found == pytest.approx(expected, abs=1e-12)


POSE_FILTER_SETTINGS: Cutoffs = (1.0, 1.0, 1.0)
DT = 0.01


def pose_filter_run(position: FloatArray, orientation: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Filtered tracks (n, k, 3) and (n, k, 4)."""
    poses = PoseFilter(position.shape[1], position=POSE_FILTER_SETTINGS, orientation=POSE_FILTER_SETTINGS)
    found = [
        poses.step(np.full(position.shape[1], DT * i), *pose)
        for i, pose in enumerate(zip(position, orientation, strict=True))
    ]
    return np.array([p for p, _ in found]), np.array([q for _, q in found])


def walk(seed: int, count: int = 4, steps: int = 60) -> tuple[FloatArray, FloatArray]:
    rng = np.random.default_rng(seed)
    position = np.cumsum(0.02 * rng.normal(size=(steps, count, 3)), axis=0)
    orientation = np.empty((steps, count, 4))
    orientation[0] = rotations.normalise(rng.normal(size=(count, 4)))
    for i in range(1, steps):
        turn = rotations.from_rotation_vector(0.3 * rng.normal(size=(count, 3)))
        orientation[i] = rotations.multiply(turn, orientation[i - 1])
    return position, orientation


@settings(max_examples=15)
@given(st.integers(0, 2**32 - 1))
def test_signs_do_not_matter_and_the_world_may_turn(seed: int) -> None:
    position, orientation = walk(seed)
    plain = pose_filter_run(position, orientation)
    signs = np.random.default_rng(seed).choice([-1.0, 1.0], orientation.shape[:2])[..., None]
    signed = pose_filter_run(position, signs * orientation)
    assert (signed[0] == plain[0]).all()
    assert rotations.angle_between(signed[1], plain[1]).max() < 1e-7
    assert (np.einsum("nkj,nkj->nk", signed[1][1:], signed[1][:-1]) > 0.0).all()
    world = rotations.normalise(np.random.default_rng(seed + 1).normal(size=4))
    turned = pose_filter_run(rotations.rotate(world, position), rotations.multiply(world, orientation))
    assert np.abs(turned[0] - rotations.rotate(world, plain[0])).max() < 1e-9
    assert rotations.angle_between(turned[1], rotations.multiply(world, plain[1])).max() < 1e-6


def test_one_axis_is_the_plain_filter_of_the_angle_through_many_half_turns() -> None:
    """Ten turns about one axis: as if the angle were a number that knows no 180 degrees."""
    angle = np.linspace(0.0, 20.0 * pi, 600)
    position, _ = pose_filter_run(angle[:, None, None] * [1.0, 0.0, 0.0], np.tile(IDENTITY, (600, 1, 1)))
    expected, axis = position[:, 0, 0], np.array([0.6, 0.0, 0.8])
    _, found = pose_filter_run(np.zeros((600, 1, 3)), rotations.from_axis_angle(axis, angle[:, None]))
    assert np.abs(angle - expected).max() > 0.05
    assert np.abs(np.linalg.norm(found, axis=2) - 1.0).max() < 1e-9
    assert rotations.angle_between(found, rotations.from_axis_angle(axis, expected[:, None])).max() < 1e-6


def test_an_off_filter_changes_nothing_and_a_missing_pose_waits() -> None:
    position, orientation = walk(7, count=2, steps=3)
    off = PoseFilter(2, position=None, orientation=None)
    found = off.step(np.zeros(2), position[0], orientation[0])
    assert (found[0] == position[0]).all() and (found[1] == orientation[0]).all()
    poses = PoseFilter(2, position=POSE_FILTER_SETTINGS, orientation=POSE_FILTER_SETTINGS)
    poses.step(np.zeros(2), position[0], orientation[0])
    lost = orientation[1].copy()
    lost[1] = nan
    found = poses.step(np.full(2, DT), position[1], lost)
    assert np.isnan(found[1]).tolist() == [[False] * 4, [True] * 4] and np.isfinite(found[0]).all()
    back = poses.step(np.full(2, 2 * DT), position[2], orientation[2])
    assert np.isfinite(back[1]).all()
    assert rotations.angle_between(back[1], orientation[2]).min() > 1e-3
    poses.reset(np.array([False, True]))
    fresh = poses.step(np.full(2, 3 * DT), position[0], orientation[0])
    assert fresh[0][1].tolist() == position[0, 1].tolist()
    assert rotations.angle_between(fresh[1][1], orientation[0, 1]) < 1e-9
    assert rotations.angle_between(fresh[1][0], orientation[0, 0]) > 1e-3
    with refuses(UsageError, found="'ligth'"):
        pose_filter("ligth", 1)
