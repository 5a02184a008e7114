"""Sensor validity: limits, jumps, the checks of single poses, the states of sensors in a walk, and messages."""

from dataclasses import dataclass, field
from math import hypot
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from messages import refuses
from retarget._solver import Validity
from retarget.frames import SensorFrames, SensorSample
from retarget.human.pose_validation import LIMITS, StateArray, ValidityLimits, ValidityState
from retarget.live.sensor_validity import (
    OUT_OF_RANGE,
    UNREACHABLE,
    UNTRACKED,
    Engagement,
    SensorDebounce,
    SensorValidity,
)
from retarget.rotations import from_rotation_vector, multiply
from retarget.sources.open import open_source
from retarget.sources.streams.raw_record import RawReader
from retarget.sources.streams.vmc import VmcDecoder
from retarget.types import BoolArray, FloatArray, News

PLACES = np.array([[0.0, 0.3, 1.0], [0.0, -0.3, 1.0], [0.0, 0.0, 1.0]])
THREE = ("l_wrist", "r_wrist", "pelvis")


class Line:
    """Three sensors that are sent one capture at a time, from 0 s on."""

    def __init__(self) -> None:
        self.validity = SensorValidity(THREE)
        self.take(0.0, {row: PLACES[row] for row in range(3)})

    def take(self, time: float, places: dict[int, np.ndarray]) -> list[bool]:
        """Which of these places may be used."""
        position, turn = np.array(list(places.values())), np.tile([1.0, 0.0, 0.0, 0.0], (len(places), 1))
        rows, yes = np.array(list(places)), np.ones(len(places), dtype=bool)
        return list(map(bool, self.validity.take(rows, time, position=position, orientation=turn, tracked=yes)))

    def states(self, time: float) -> list[int]:
        return [int(state) for state in self.validity.judge(time)]


# A walk: sensors that swing, with the noise of real ones, and their judgement.

NAMES = ("head", "l_wrist", "r_wrist", "l_ankle", "r_ankle", "pelvis")
HOME = np.array([[0, 0, 1.6], [0, 0.3, 0.9], [0, -0.3, 0.9], [0, 0.12, 0.1], [0, -0.12, 0.1], [0, 0, 1.0]])
SWING = np.array([0.02, 0.25, -0.25, -0.3, 0.3, 0.03])
LAG = 0.005
"""s from capture to judgement."""


@dataclass
class Stream:
    """What a sender sent; tests change it."""

    time: FloatArray
    position: FloatArray
    orientation: FloatArray
    tracked: BoolArray
    names: tuple[str, ...] = NAMES


@dataclass
class Judged:
    """The judgement of a stream: states and usable (T, k), messages with the row at which they came."""

    validity: SensorValidity
    states: StateArray
    usable: BoolArray
    messages: list[tuple[int, str]] = field(default_factory=list)

    def alarms(self) -> set[ValidityState]:
        return {ValidityState(state) for state in np.unique(self.states)} - {ValidityState.FRESH}


def noisy(
    position: FloatArray, orientation: FloatArray, *, seed: int = 0, metres: float = 0.002
) -> tuple[FloatArray, FloatArray]:
    """The track with the noise of an optical or a consumer system: `metres`, and 0.1 degree."""
    random = np.random.default_rng(seed)
    turn = from_rotation_vector(random.normal(0.0, np.radians(0.1), position.shape))
    return position + random.normal(0.0, metres, position.shape), multiply(orientation, turn)


def walk(seconds: float = 2.0, rate: float = 100.0, *, swing: float = 1.0, noise: bool = True) -> Stream:
    """A walk of one step a second; `swing` 0: standing."""
    time = 5.0 + np.arange(0.0, seconds, 1.0 / rate)
    phase = swing * np.sin(2.0 * np.pi * time)[:, None] * SWING
    position = HOME + np.stack([phase, np.zeros_like(phase), 0.2 * np.abs(phase)], axis=-1)
    orientation = from_rotation_vector(np.stack([np.zeros_like(phase), -2.0 * phase, np.zeros_like(phase)], axis=-1))
    if noise:
        position, orientation = noisy(position, orientation)
    return Stream(time, position, orientation, np.ones(phase.shape, dtype=bool))


def recorded(frames: SensorFrames, rate: float, *, metres: float) -> Stream:
    """A recording as from a sender of `rate` Hz, with noise and with stamps that are off by up to 2 ms."""
    frames = frames.resample(np.arange(0.0, frames.duration_s, 1.0 / rate))
    position, orientation = noisy(frames.position, frames.orientation, metres=metres)
    late = np.random.default_rng(1).uniform(0.0, 0.002, len(frames))
    return Stream(5.0 + frames.time + late, position, orientation, frames.valid.copy(), frames.names)


def judge(stream: Stream, validity: SensorValidity | None = None) -> Judged:
    validity = validity or SensorValidity(stream.names)
    rows = np.arange(len(stream.names))
    judged = Judged(
        validity, np.zeros(stream.tracked.shape, dtype=np.uint8), np.zeros(stream.tracked.shape, dtype=bool)
    )
    for i, time in enumerate(stream.time.tolist()):
        judged.usable[i] = validity.take(
            rows, time, position=stream.position[i], orientation=stream.orientation[i], tracked=stream.tracked[i]
        )
        judged.states[i] = validity.judge(time + LAG)
        judged.messages += [(i, text) for text in validity.messages()]
    return judged


JUMPED, FRESH = ValidityState.JUMPED, ValidityState.FRESH


def test_a_jump_back_is_accepted_and_a_jump_on_waits_anew() -> None:
    line, there = Line(), [2.0, 0.0, 0.0]
    for i in range(1, 16):
        assert line.take(0.01 * i, {0: PLACES[0] + there}) == [False]
        assert line.states(0.01 * i)[0] == (JUMPED if 0.01 * i > LIMITS.stale_after else FRESH)
    assert line.take(0.16, {0: PLACES[0]}) == [True] and line.states(0.16)[0] == FRESH
    for i in range(17, 30):
        assert line.take(0.01 * i, {0: PLACES[0] + there}) == [False]
    for i in range(30, 78):
        assert line.take(0.01 * i, {0: PLACES[0] + [5.0, 0.0, 0.0]}) == [False]
    line.take(0.79, {0: PLACES[0] + [5.0, 0.0, 0.0]})
    assert line.take(0.81, {0: PLACES[0] + [5.0, 0.0, 0.0]}) == [True]


@pytest.mark.parametrize("distance", [0.1, 0.6])
def test_a_swap_is_a_jump_of_two_sensors_also_where_it_is_short(distance: float) -> None:
    """Two feet may be as near as 10 cm: any human could have gone so far, but not to each other's place."""
    line, left, right = Line(), np.array([0.0, 0.5 * distance, 1.0]), np.array([0.0, -0.5 * distance, 1.0])
    for i in range(1, 101):
        share = i / 100.0
        line.take(0.01 * i, {row: (1.0 - share) * PLACES[row] + share * at for row, at in ((0, left), (1, right))})
    for time in (1.01, 1.02):
        assert line.take(time, {0: right, 1: left, 2: PLACES[2]}) == [False, False, True]
    assert line.states(1.02) == [JUMPED, JUMPED, FRESH]
    assert line.take(1.03, {0: left, 1: right}) == [True, True] and line.states(1.03) == [FRESH] * 3


@pytest.mark.parametrize("lost", [0.0, 0.05, 0.1])
def test_one_that_takes_the_place_of_the_other_has_jumped(lost: float) -> None:
    """Lost for a while, then reported at the place of the other side, which is missing from then on."""
    line = Line()
    for i in range(1, round(100.0 * lost) + 1):
        assert line.take(0.01 * i, {1: PLACES[1], 2: PLACES[2]}) == [True, True]
    for time in (lost + 0.01, lost + 0.02):
        assert line.take(time, {0: PLACES[1], 2: PLACES[2]}) == [False, True]
    assert line.states(lost + 0.02)[0] == JUMPED


def test_hands_that_clap_and_rebound_have_not_changed_places() -> None:
    """At 5 m/s each, sent at 60 Hz, in one datagram or in two."""
    for together in (True, False):
        line, dt = Line(), 1.0 / 60.0
        for i in range(1, 30):
            y = 0.02 + 5.0 * dt * abs(3.3 - i) if i < 7 else 0.3
            places = {0: np.array([0.0, y, 1.0]), 1: np.array([0.0, -y, 1.0])}
            for each in (places,) if together else ({0: places[0]}, {1: places[1]}):
                assert all(line.take(dt * i, each))
        assert line.states(29 * dt)[:2] == [FRESH] * 2


VALUES = st.sampled_from([0.0, 1.0, -1.0, 0.6, 0.8, 1.03, 3.5, 11.0, np.nan, np.inf, -np.inf, 1e200])


def reasons(numbers: FloatArray, tracked: list[bool]) -> list[str]:
    """Why each pose is refused, "" where it is not."""
    validity, given, found = SensorValidity([*map(str, range(len(numbers)))]), np.array(tracked, dtype=bool), []
    for row in range(len(numbers)):
        one, before = slice(row, row + 1), validity.refused.reasons.copy()
        position, orientation = numbers[one, :3], numbers[one, 3:]
        validity.take(np.array([row]), 1.0, position=position, orientation=orientation, tracked=given[one])
        found.append(next(iter(validity.refused.reasons - before), ""))
    return found


@settings(max_examples=100)
@given(st.lists(st.tuples(st.lists(VALUES, min_size=7, max_size=7), st.booleans()), max_size=3))
def test_each_pose_is_judged_by_itself(rows: list[tuple[list[float], bool]]) -> None:
    numbers = np.array([row for row, _ in rows], dtype=float).reshape(len(rows), 7)
    tracked = [vouched for _, vouched in rows]
    limits, found = ValidityLimits(), reasons(numbers, tracked)
    for pose_, vouched, why in zip(numbers, tracked, found, strict=True):
        assert [why] == reasons(pose_[None], [vouched])
        place, turn = pose_[:3], pose_[3:]
        missing, norm = bool(np.isnan(turn).all()), hypot(*turn.tolist())
        inside = (np.abs(place[:2]) <= limits.reach).all() and limits.low <= place[2] <= limits.high
        finite = np.isfinite(place).all() and (missing or np.isfinite(turn).all())
        turned = missing or abs(norm - 1.0) <= limits.norm_tolerance
        assert (why == "") == bool(vouched and inside and finite and turned)
        assert (why == UNTRACKED) == (not vouched)
        assert (why == OUT_OF_RANGE) == bool(vouched and finite and turned and not inside)


RATES = (50.0, 120.0)
L_WRIST, L_ANKLE = NAMES.index("l_wrist"), NAMES.index("l_ankle")


def test_one_capture_sent_again_and_again_is_stale_and_not_frozen() -> None:
    stream = walk()
    validity = judge(stream).validity
    seen = set()
    for i in range(100):
        time, position, orientation = float(stream.time[-1]), stream.position[-1], stream.orientation[-1]
        validity.take(np.arange(6), time, position=position, orientation=orientation, tracked=np.ones(6, bool))
        seen |= set(validity.judge(time + 0.01 * i).tolist())
    assert seen == {ValidityState.FRESH, ValidityState.STALE}


@pytest.mark.parametrize("rate", RATES)
@pytest.mark.parametrize("far", [0.5, 2.0])
def test_a_jump_is_refused_at_once_and_accepted_when_it_stays(rate: float, far: float) -> None:
    stream = walk(rate=rate)
    begin = int(np.searchsorted(stream.time, stream.time[0] + 1.0))
    stream.position[begin:, L_WRIST, 0] += far
    judged = judge(stream)
    wait = int(np.ceil(0.5 * rate))
    assert not judged.usable[begin : begin + wait - 1, L_WRIST].any() and judged.usable[begin + wait + 1 :].all()
    assert judged.alarms() == {ValidityState.JUMPED}
    assert [text for _, text in judged.messages] == [
        "l_wrist: jumped farther than a human can",
        "l_wrist: accepted again at its new place",
    ]


@pytest.mark.parametrize("count", [1, 13])
def test_outliers_are_dropped_and_no_more(count: int) -> None:
    stream = walk()
    stream.position[100 : 100 + count, L_WRIST, 0] += 2.0
    judged = judge(stream)
    assert np.argwhere(~judged.usable).tolist() == [[100 + i, L_WRIST] for i in range(count)] and not judged.alarms()
    assert judged.validity.refused.reasons == {UNREACHABLE: count}


def test_a_sensor_not_in_use_is_reported_once_and_may_come_later() -> None:
    stream = walk(6.0)
    stream.tracked[:500, L_WRIST] = False
    judged = judge(stream)
    assert (judged.states[301:500, L_WRIST] == ValidityState.NOT_IN_USE).all() and not judged.states[500:].any()
    assert [text for _, text in judged.messages] == [
        "l_wrist: not received since the start (not worn?)",
        "l_wrist: received now",
    ]


def test_repeats_of_a_slower_tracker_and_a_missing_orientation_are_no_evidence() -> None:
    stream = walk(rate=240.0)
    slow = np.arange(len(stream.time)) // 24 * 24  # 10 Hz: 0.1 s
    stream.position[:, L_ANKLE] = stream.position[slow, L_ANKLE]
    stream.orientation[:, L_ANKLE] = stream.orientation[slow, L_ANKLE]
    assert not judge(stream).alarms()
    stream = walk()
    stream.orientation[60:, L_ANKLE] = np.nan
    stream.orientation[120, L_ANKLE] = (1.0, 0.0, 0.0, 0.0)
    judged = judge(stream)
    assert judged.usable.all() and not judged.alarms()


@pytest.mark.parametrize("shift", [-3600.0, -1.0, 3600.0])
def test_a_clock_that_is_set_is_followed(shift: float) -> None:
    stream = walk()
    stream.time[100:] += shift
    judged = judge(stream)
    assert judged.usable.all() and not judged.alarms() - {ValidityState.FRESH, ValidityState.STALE}
    assert not judged.states[101:].any()


VALUE = st.floats(width=64) | st.sampled_from([0.0, 1.0, 0.1, np.nan, np.inf, -1e300])


@settings(max_examples=25)
@given(st.data())
def test_anything_may_come(data: st.DataObject) -> None:
    validity = SensorValidity(NAMES)
    draw = data.draw
    for _ in range(draw(st.integers(1, 6))):
        rows = np.array(draw(st.lists(st.integers(0, 5), unique=True)), dtype=np.intp)
        count = len(rows)
        numbers = np.array(draw(st.lists(VALUE, min_size=7 * count, max_size=7 * count))).reshape(count, 7)
        if draw(st.booleans()):
            numbers[:, 3:] = (1.0, 0.0, 0.0, 0.0)
        tracked = np.array(draw(st.lists(st.booleans(), min_size=count, max_size=count)), dtype=bool)
        usable = validity.take(rows, draw(VALUE), position=numbers[:, :3], orientation=numbers[:, 3:], tracked=tracked)
        assert not (usable & ~tracked).any() and np.isfinite(numbers[usable, :3]).all()
        states = validity.judge(draw(VALUE))
        assert states.max() <= ValidityState.OUT_OF_RANGE
    assert len(validity.messages()) <= len(NAMES)


COUNT = 5
FIVE = np.arange(COUNT)


def found(moves: list[int], *, metres: float = 0.01, turns: bool = True, goes: bool = True) -> np.ndarray:
    """Which sensors are frozen, (k,). All move for 0.2 s, then only some do, by `metres` a capture at 100 Hz."""
    validity, yes = SensorValidity([str(row) for row in FIVE]), np.ones(COUNT, dtype=bool)
    pose = np.tile([0.0, 0.0, 1.0, 1.0, 0.0, 0.0, 0.0], (COUNT, 1))
    frozen = np.zeros(COUNT, dtype=bool)
    for i in range(120):
        moving = FIVE if i < 20 else np.array(moves, dtype=int)
        pose[moving, 0] = metres * (i % 10) if goes else 0.0
        pose[moving, 4] = metres * (i % 10) if turns else 0.0
        pose[:, 3] = np.sqrt(1.0 - pose[:, 4] ** 2)
        validity.take(FIVE, 0.01 * i, position=pose[:, :3].copy(), orientation=pose[:, 3:].copy(), tracked=yes)
        frozen = validity.judge(0.01 * i + 0.005) == ValidityState.FROZEN
    return frozen


@pytest.mark.parametrize(
    ("moves", "how", "frozen"),
    [
        ([0, 1, 2, 3], {}, [4]),
        ([0, 1, 2, 3], {"turns": False}, [4]),
        ([0, 1, 2, 3], {"goes": False}, [4]),
        ([0, 1, 2], {}, [3, 4]),
        ([0, 1, 2, 3], {"metres": 0.0002}, []),
        ([0, 1], {}, []),
        ([], {}, []),
    ],
)
def test_sensors_at_rest_while_most_move_are_frozen(moves: list[int], how: dict[str, Any], frozen: list[int]) -> None:
    assert np.flatnonzero(found(moves, **how)).tolist() == frozen


def test_bad_arrays_are_refused() -> None:
    validity, yes, place, turn = SensorValidity(THREE), np.ones(1, dtype=bool), np.zeros((1, 3)), np.zeros((1, 4))
    for rows, tracked, position in (([3], yes, place), ([0], yes[:0], place), ([0], yes, place[:0])):
        with refuses(ValueError):
            validity.take(np.array(rows), 1.0, position=position, orientation=turn, tracked=tracked)
    with refuses(ValueError):
        Validity(np.array([1]), LIMITS)


@pytest.mark.parametrize("rate", [60.0, 120.0])
@pytest.mark.parametrize("name", ["cmu_asfamc/02_06.amc", "cmu_asfamc/05_13.amc", "cmu_bvh_hahne/49_06.bvh"])
def test_real_motion_raises_no_alarm(name: str, rate: float, shared: Path) -> None:
    frames = open_source(shared / "mocap" / name).cut(0.1, 5.0)  # a BVH begins with one frame of its rest pose
    for metres in (0.001, 0.005):
        judged = judge(recorded(frames, rate, metres=metres))
        assert not judged.alarms() and not judged.validity.refused.count


@pytest.mark.long
@pytest.mark.parametrize("rate", [30.0, 60.0, 100.0, 120.0, 240.0])
def test_no_recording_raises_an_alarm(rate: float, shared: Path) -> None:
    folders = ("cmu_asfamc/*.amc", "cmu_bvh_hahne/*.bvh", "cmu_bvh_daz/*.bvh")
    for path in sorted(path for folder in folders for path in (shared / "mocap").glob(folder)):
        frames = open_source(path).cut(0.1, 28.0 if path.stem == "01_07" else None)
        judged = judge(recorded(frames, rate, metres=0.003))
        assert not judged.alarms() and not judged.validity.refused.count, path.name


def test_real_slimevr_bytes_raise_no_alarm(shared: Path) -> None:
    """They were scripted, without noise: what rests there repeats itself to the bit while one arm moves. Before the
    headset is received, the head is at the origin; then everything goes up by 1.5 m, which is a jump."""
    decoder, validity, alarms = VmcDecoder(), SensorValidity(()), []
    for record in RawReader(shared / "streams" / "slimevr" / "full12_vmc_50hz.udprec.gz"):
        for frame in decoder.decode(record.payload):
            picked = [i for i, name in enumerate(frame.names) if name.startswith("human://")]
            names, rows = tuple(frame.names[i] for i in picked), np.arange(len(picked))
            if not validity.names:
                validity = SensorValidity(names, ValidityLimits(low=-3.0))
            assert frame.stamp is not None and names == validity.names and len(names) == 11
            position, orientation = frame.position[picked], frame.orientation[picked]
            validity.take(rows, frame.stamp, position=position, orientation=orientation, tracked=frame.tracked[picked])
            alarms.append((frame.stamp, set(validity.judge(frame.stamp + 0.01).tolist())))
    assert {state for stamp, states in alarms for state in states if stamp < 1.1} == {0, ValidityState.JUMPED}
    assert {state for stamp, states in alarms for state in states if stamp >= 1.1} == {0}
    assert alarms[-1][0] > 15.0


def test_a_sensor_that_drops_out_again_and_again_is_news_of_one_kind() -> None:
    """A camera's pictures stall for 0.4 s in every 1.5 s, for 15 s."""
    validity, said = SensorValidity(NAMES[:1]), list[News]()
    row, turn = np.zeros(1, dtype=np.intp), np.array([[1.0, 0.0, 0.0, 0.0]])
    for tick in range(1500):
        now = 0.01 * tick
        if now % 1.5 < 1.1:
            at = np.array([[0.0, 0.01 * np.sin(now), 1.6]])
            validity.take(row, now, position=at, orientation=turn, tracked=np.ones(1, dtype=bool))
        validity.judge(now)
        said += validity.messages()
    lost = [text for text in said if "back" not in text]
    assert len(lost) == 10 and len({text.kind for text in said}) == 2 and said[1] == "head: back"


# Following and holding: only good data end a hold, and only a sensor that is valid for long enough is used.

DT = 0.01  # [s]


def two(x: float, *, valid: tuple[bool, bool] = (True, True)) -> SensorSample:
    position = np.array([[x, 0.0, 1.6], [x, 0.3, 1.0]])
    return SensorSample(("head", "l_wrist"), position, np.tile([1.0, 0.0, 0.0, 0.0], (2, 1)), np.array(valid))


def test_it_begins_with_good_data_for_long_enough() -> None:
    engagement = Engagement(two(0.0))
    for tick in range(100):
        given = two(0.2)
        shown = engagement.step(DT * tick, given, good=True)
        assert (shown is None) == (DT * tick < LIMITS.healthy - 1e-9)
        assert shown is None or shown is given is engagement.shown


@pytest.mark.parametrize("clutch", [True, False])
def test_what_was_followed_last_is_kept_while_it_holds(clutch: bool) -> None:
    """The performer walks while the clutch is out, or data are bad."""
    engagement = Engagement(two(0.0), following=True)
    for tick in range(900):
        good = not 300 <= tick < 500
        engagement.engaged = good or not clutch
        place = 0.0 if tick < 300 else 1.0
        shown = engagement.step(DT * tick, two(place), good=good or clutch)
        follows = tick < 300 or DT * (tick - 500) >= LIMITS.healthy - 1e-9
        assert (shown is not None) == follows == engagement.following
        assert float(engagement.shown.position[0, 0]) == (place if follows else 0.0)


def used(states: list[ValidityState], *, first: ValidityState = ValidityState.FRESH) -> list[bool]:
    debounce = SensorDebounce(np.array([first], dtype=np.uint8))
    return [bool(debounce.step(np.array([state], dtype=np.uint8), DT * tick)[0]) for tick, state in enumerate(states)]


def test_a_sensor_that_is_lost_is_used_again_when_it_is_valid_for_long_enough() -> None:
    fresh, lost = ValidityState.FRESH, ValidityState.STALE
    assert used([fresh, fresh]) == [True, True], "what is valid at the start is used at once"
    assert used([fresh], first=lost) == [False]
    found = used([fresh] * 10 + [lost] + [fresh] * 30 + [lost] + [fresh] * 60)
    healthy = round(LIMITS.healthy / DT)
    assert found == [True] * 10 + [False] * 32 + [False] * healthy + [True] * (60 - healthy)
