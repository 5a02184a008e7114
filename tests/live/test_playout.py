"""Sensors sent with jitter, out of order and at their own times, read on a steady tick."""

from math import inf, nan

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from played import How
from retarget import rotations
from retarget.live.playout import DELAY_CAP_S, EXTRAPOLATION_S, Played, Playout, PlayoutDelay
from retarget.types import FloatArray

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


def buffered(count: int = COUNT, delay: type[PlayoutDelay] = PlayoutDelay) -> Playout:
    return Playout(count, delay=delay())


def push(playout: Playout, time: float, *, late: float = 0.001, rows: FloatArray | None = None) -> None:
    chosen = ROWS if rows is None else np.asarray(rows, dtype=np.intp)
    position, orientation = pose(time)
    playout.push(chosen, time, position[chosen], orientation[chosen], ALL[chosen], arrival=time + late)


def worst(played: Played) -> float:
    """Largest error against the motion at the time of the played pose, m or rad."""
    errors = [0.0]
    for row in np.nonzero(played.how != How.NONE)[0]:
        position, orientation = pose(float(played.time[row]))
        errors.append(float(np.abs(played.position[row] - position[row]).max()))
        errors.append(float(rotations.angle_between(played.orientation[row], orientation[row])))
        assert np.linalg.norm(played.orientation[row]) == pytest.approx(1.0, abs=1e-9)
    return max(errors)


def test_straight_motion_is_played_exactly_whatever_the_jitter() -> None:
    rng = np.random.default_rng(2)
    playout = buffered()
    arrivals = sorted((t + float(rng.uniform(0.0, 0.02)), t) for t in 5.0 + np.arange(400) / 120.0)
    kinds: list[int] = []
    waiting = list(arrivals)
    shown: list[FloatArray] = []
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


def test_it_goes_on_for_50_ms_and_then_holds() -> None:
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


def test_a_velocity_of_long_ago_or_of_a_moment_is_not_carried_on() -> None:
    still, orientation = np.zeros((COUNT, 3)), pose(0.0)[1]
    playout = buffered(delay=Lateness)
    for time, height in ((1.0, 0.0), (3.0, 1.0)):
        playout.push(ROWS, time, still + height, orientation, ALL, arrival=time)
    played = playout.read(3.03)
    assert set(played.how) == {How.LATEST} and (played.position == 1.0).all()
    shaky = buffered(delay=Lateness)
    for time, height in ((1.0, 0.0), (1.01, 0.0), (1.02, 0.0), (1.03, 0.0), (1.030001, 0.001)):
        shaky.push(ROWS, time, still + height, orientation, ALL, arrival=time)
    assert shaky.read(1.07).position.max() < 0.0031


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
        push(playout, 2.0, rows=np.array([3.0, 5.0]))
        played = playout.read(2.01)
        sent = np.isin(ROWS, [3, 5])
        assert ((played.how != How.NONE) == sent).all() and (played.valid == sent).all()
        assert (np.isnan(played.position).all(axis=1) == ~sent).all()
        assert (np.isnan(played.time) == ~sent).all()


def test_sensors_sent_at_their_own_times_are_read_at_one() -> None:
    playout = buffered()
    assert playout.delay == 0.0
    for i in range(300):
        push(playout, 1.0 + i / 300.0, rows=np.array([float(i % 3)]))
    played = playout.read(1.0 + 300 / 300.0)
    assert np.ptp(played.time[:3]) == 0.0 and set(played.how[:3]) == {How.INTERPOLATED}
    assert worst(played) < 1e-7


@settings(max_examples=20)
@given(st.integers(0, 2**32 - 1))
def test_the_sign_of_a_quaternion_says_nothing(seed: int) -> None:
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


def test_turning_the_world_turns_what_is_played() -> None:
    world = rotations.normalise([0.3, -0.5, 0.7, 0.2])
    one, other = buffered(), buffered()
    rng = np.random.default_rng(3)
    for i in range(40):
        time = 1.0 + 0.01 * i
        position, orientation = rng.normal(size=(COUNT, 3)), rotations.normalise(rng.normal(size=(COUNT, 4)))
        one.push(ROWS, time, position, orientation, ALL, arrival=time)
        turned = rotations.rotate(world, position), rotations.multiply(world, orientation)
        other.push(ROWS, time, *turned, ALL, arrival=time)
        a, b = one.read(time + 0.004), other.read(time + 0.004)
        assert np.abs(rotations.rotate(world, a.position) - b.position).max() < 1e-9
        assert rotations.angle_between(rotations.multiply(world, a.orientation), b.orientation).max() < 1e-6


def test_a_sensor_that_the_sender_lost_is_not_valid_until_it_is_back() -> None:
    playout = buffered()
    for i in range(10):
        push(playout, 1.0 + 0.01 * i)
    lost = ALL.copy()
    lost[4] = False
    for i in range(10, 20):
        position, orientation = pose(1.0 + 0.01 * i)
        playout.push(ROWS, 1.0 + 0.01 * i, position, orientation, lost, arrival=1.0 + 0.01 * i)
    played = playout.read(1.2)
    assert (played.valid == lost).all() and np.isfinite(played.position).all() and played.how[4] == How.HELD
    push(playout, 1.2)
    push(playout, 1.21)
    assert playout.read(1.23).valid.all()


def test_nonsense_is_not_stored_and_a_missing_part_is_no_nonsense() -> None:
    playout = Playout(6)
    position, orientation = np.zeros((6, 3)), np.tile(rotations.IDENTITY, (6, 1))
    position[0] = nan
    orientation[1] = nan
    position[2, 1] = nan
    position[3, 1] = inf
    orientation[4] = 0.0
    playout.push(np.arange(6), 1.0, position, orientation, np.ones(6, dtype=bool), arrival=1.0)
    played = playout.read(1.0)
    assert played.valid.tolist() == [True, True, False, False, False, True]
    assert np.isnan(played.position[0]).all() and np.isfinite(played.orientation[0]).all()
    for time in (nan, inf, 5.0):
        playout.push(np.arange(6), time, position, orientation, np.ones(6, dtype=bool), arrival=1.0)
    assert playout.dropped.reasons == {"not a capture time": 3} and playout.read(1.0).age[5] == 0.0


def storm(pushes: int, seed: int) -> None:
    """Random pushes and reads: nothing is raised, time and memory stay in bounds."""
    rng = np.random.default_rng(seed)
    playout = buffered(6)
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
            settled = played.how >= How.EXTRAPOLATED
            settled |= played.how == How.INTERPOLATED
            assert (played.time[settled] >= before[settled] - 1e-9).all()
            before[settled] = played.time[settled]
            assert (now - played.time[settled & (played.age < 0.05)] <= DELAY_CAP_S + 0.06).all()
            size = np.linalg.norm(played.orientation, axis=1)
            assert (np.isnan(size) | (np.abs(size - 1.0) < 1e-6)).all()
            assert not np.isinf(played.position).any()
    assert set(playout.dropped.reasons) <= {"repeated", "older than what is kept", "not a capture time"}


def test_a_storm_of_pushes() -> None:
    storm(3_000, 4)


@pytest.mark.long
@pytest.mark.parametrize("seed", range(3))
def test_a_long_storm_of_pushes(seed: int) -> None:
    storm(100_000, seed)


def run(delay: PlayoutDelay, seconds: float, jitter: float, *, start: float, rate: float = 100.0) -> list[float]:
    """The delay after each frame whose lateness lies between 0 and `jitter`, both reached within 10 frames."""
    rng = np.random.default_rng(0)
    found = []
    for i in range(int(seconds * rate)):
        capture = start + i / rate
        lateness = jitter * (i % 10 == 0 or rng.random() * (i % 10 != 1))
        delay.note(capture + lateness, lateness=lateness, gap=1.0 / rate)
        found.append(delay.at(capture + 1.0 / rate))
    return found


def test_it_grows_at_once_and_shrinks_slowly() -> None:
    delay = PlayoutDelay()
    calm = run(delay, 3.0, 0.002, start=10.0)
    assert calm[-1] == pytest.approx(0.012)
    error_rate = run(delay, 3.0, 0.025, start=13.0)
    assert error_rate[0] == pytest.approx(0.035)
    after = run(delay, 10.0, 0.002, start=16.0)
    assert after[100] == pytest.approx(0.035)
    assert after[-1] == pytest.approx(0.012, abs=5e-4)
    assert np.diff(after).min() > -0.05 / 100.0


def test_without_frames_there_is_no_delay() -> None:
    delay = PlayoutDelay()
    assert delay.at(1.0) == delay.at(2.0) == 0.0
    run(delay, 1.0, 0.01, start=3.0)
    before = delay.at(4.5)
    assert delay.at(1000.0) == before


@given(st.lists(st.tuples(st.floats(0.0, 1.0), st.floats(-1.0, 10.0), st.floats(0.0, 10.0)), max_size=50))
def test_it_is_bounded(sent: list[tuple[float, float, float]]) -> None:
    delay, now = PlayoutDelay(), 0.0
    for step, lateness, gap in sent:
        now += step
        delay.note(now, lateness=lateness, gap=gap)
        assert 0.0 <= delay.at(now) <= DELAY_CAP_S
