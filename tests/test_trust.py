"""Every way in which a sensor lies is found in time, and nothing else is."""

import numpy as np
import pytest

from retarget.live.rejoin import Rejoin
from retarget.live.trust import LEAPT, Trust
from retarget.live.trust_state import TrustState
from trust_rig import HOME, LAG, NAMES, Stream, judge, walk

RATES = (50.0, 120.0)
L_WRIST, R_WRIST, L_ANKLE = NAMES.index("l_wrist"), NAMES.index("r_wrist"), NAMES.index("l_ankle")


def onset(stream: Stream, seconds: float = 1.0) -> int:
    return int(np.searchsorted(stream.time, stream.time[0] + seconds))


def seconds_until(stream: Stream, begin: int, wrong: np.ndarray) -> float:
    """From the last sound capture to the first judgement that is `wrong`."""
    first = int(np.flatnonzero(wrong)[0])
    assert first >= begin
    return float(stream.time[first] + LAG - stream.time[begin - 1])


def out_after(stream: Stream, begin: int, states: np.ndarray, row: int) -> float:
    """s from `begin` until a sensor takes no part any more, in ticks of the stream."""
    rejoin = Rejoin(states.shape[1])
    rejoin.start(states[begin - 1])
    for i in range(begin, len(states)):
        if rejoin.step(states[i], float(stream.time[i] - stream.time[i - 1]))[row] == 0.0:
            return float(stream.time[i] + LAG - stream.time[begin])
    return np.inf


@pytest.mark.parametrize("rate", RATES)
@pytest.mark.parametrize("swing", [0.0, 1.0])
def test_who_walks_or_stands_is_believed(rate: float, swing: float) -> None:
    judged = judge(walk(rate=rate, swing=swing))
    assert not judged.alarms() and judged.usable.all()
    assert not judged.messages and not judged.trust.refused.count


@pytest.mark.parametrize("rate", RATES)
@pytest.mark.parametrize("carried", [False, True])
@pytest.mark.parametrize("row", [0, L_WRIST, L_ANKLE])
def test_a_frozen_tracker_is_out_in_300_ms(row: int, carried: bool, rate: float) -> None:
    stream = walk(rate=rate)
    begin = onset(stream)
    stream.orientation[begin:, row] = stream.orientation[begin - 1, row]
    if not carried:
        stream.position[begin:, row] = stream.position[begin - 1, row]
    judged = judge(stream)
    assert judged.alarms() == {TrustState.FROZEN}
    assert not np.delete(judged.states, row, axis=1).any()
    assert out_after(stream, begin, judged.states, row) <= 0.3
    assert [text for _, text in judged.messages] == [f"{NAMES[row]}: frozen since 0.2 s (tracker lost?)"]


def test_a_frozen_position_is_found_where_there_is_no_orientation() -> None:
    stream = walk()
    stream.orientation[:] = np.nan
    begin = onset(stream)
    stream.position[begin:, L_ANKLE] = stream.position[begin - 1, L_ANKLE]
    judged = judge(stream)
    assert judged.usable.all() and judged.alarms() == {TrustState.FROZEN}
    assert seconds_until(stream, begin, judged.states[:, L_ANKLE] > 0) < 0.23


def test_a_tracker_that_thaws_is_believed_at_once() -> None:
    stream = walk()
    stream.orientation[100:150, L_ANKLE] = stream.orientation[99, L_ANKLE]
    judged = judge(stream)
    assert (judged.states[125:150, L_ANKLE] == TrustState.FROZEN).all() and not judged.states[150:].any()
    assert judged.messages[-1] == (150, "l_ankle: back")


def test_motion_without_noise_is_not_frozen_where_it_rests() -> None:
    stream = walk(swing=0.0, noise=False)
    moving = walk(noise=False)
    for row in (L_WRIST, R_WRIST):
        stream.position[:, row], stream.orientation[:, row] = moving.position[:, row], moving.orientation[:, row]
    assert not judge(stream).alarms()


def test_a_person_who_stands_as_still_as_a_stone_is_not_frozen() -> None:
    assert not judge(walk(swing=0.0, noise=False)).alarms()


def test_repeats_of_a_slower_tracker_are_no_evidence() -> None:
    stream = walk(rate=240.0)
    slow = np.arange(len(stream.time)) // 24 * 24  # 10 Hz: 0.1 s
    stream.position[:, L_ANKLE] = stream.position[slow, L_ANKLE]
    stream.orientation[:, L_ANKLE] = stream.orientation[slow, L_ANKLE]
    assert not judge(stream).alarms()


def test_one_capture_told_again_and_again_is_old_and_not_frozen() -> None:
    stream = walk()
    trust = judge(stream).trust
    seen = set()
    for i in range(100):
        time = float(stream.time[-1])
        trust.take(
            np.arange(6),
            time,
            position=stream.position[-1],
            orientation=stream.orientation[-1],
            tracked=np.ones(6, bool),
        )
        seen |= set(trust.judge(time + 0.01 * i).tolist())
    assert seen == {TrustState.FRESH, TrustState.STALE}


@pytest.mark.parametrize("how", ["unheard", "untracked", "nan"])
@pytest.mark.parametrize("rate", RATES)
def test_a_lost_tracker_is_out_in_300_ms(rate: float, how: str) -> None:
    stream = walk(rate=rate)
    begin = onset(stream)
    if how == "untracked":
        stream.tracked[begin:, L_ANKLE] = False
    else:
        stream.position[begin:, L_ANKLE] = np.nan
    judged = judge(stream)
    assert not judged.usable[begin:, L_ANKLE].any() and judged.usable[:begin].all()
    assert judged.alarms() == {TrustState.STALE}
    assert out_after(stream, begin, judged.states, L_ANKLE) <= 0.3
    assert [text for _, text in judged.messages] == ["l_ankle: nothing that can be used for 0.1 s"]


def swapped(stream: Stream, begin: int, end: int | None = None) -> Stream:
    both = [L_WRIST, R_WRIST]
    for array in (stream.position, stream.orientation):
        array[begin:end, both] = array[begin:end, both[::-1]]
    return stream


@pytest.mark.parametrize("rate", RATES)
@pytest.mark.parametrize("at", np.linspace(1.0, 1.4, 4).tolist())
def test_a_swap_is_seen_in_the_capture_in_which_it_happens(rate: float, at: float) -> None:
    stream = walk(rate=rate)
    begin = onset(stream, at)
    judged = judge(swapped(stream, begin))
    pair = judged.states[:, [L_WRIST, R_WRIST]]
    assert seconds_until(stream, begin, (pair == TrustState.SWAPPED).all(axis=1)) <= 0.1
    assert not judged.usable[begin : begin + int(0.49 * rate), [L_WRIST, R_WRIST]].any()
    assert judged.alarms() == {TrustState.SWAPPED} and not np.delete(judged.states, [L_WRIST, R_WRIST], axis=1).any()
    assert [text for _, text in judged.messages] == [
        "l_wrist and r_wrist have changed places: the robot holds until they change back",
        "l_wrist, r_wrist: believed again where it is now",
    ]
    assert 0.5 <= stream.time[judged.messages[1][0]] - stream.time[begin] <= 0.53


def test_a_pair_that_swaps_back_is_believed_at_once() -> None:
    judged = judge(swapped(walk(), 100, 120))
    assert (judged.states[100:120, L_WRIST] == TrustState.SWAPPED).all() and not judged.states[120:].any()
    assert judged.messages[-1] == (120, "l_wrist, r_wrist: back")


@pytest.mark.parametrize("rate", RATES)
@pytest.mark.parametrize("far", [0.5, 2.0])
def test_a_teleport_is_refused_at_once_and_believed_when_it_stays(rate: float, far: float) -> None:
    stream = walk(rate=rate)
    begin = onset(stream)
    stream.position[begin:, L_WRIST, 0] += far
    judged = judge(stream)
    wait = int(np.ceil(0.5 * rate))
    assert not judged.usable[begin : begin + wait - 1, L_WRIST].any() and judged.usable[begin + wait + 1 :].all()
    assert judged.alarms() == {TrustState.JUMPED}
    assert [text for _, text in judged.messages] == [
        "l_wrist: jumped farther than a human can",
        "l_wrist: believed again where it is now",
    ]


def test_one_outlier_is_dropped_and_no_more() -> None:
    stream = walk()
    stream.position[100, L_WRIST, 0] += 2.0
    judged = judge(stream)
    assert np.argwhere(~judged.usable).tolist() == [[100, L_WRIST]] and not judged.alarms()
    assert judged.trust.refused.reasons == {LEAPT: 1}


def test_a_sensor_that_flies_about_is_never_believed() -> None:
    stream = walk()
    stream.position[100:, L_WRIST, 0] += np.random.default_rng(0).uniform(-5.0, 5.0, len(stream.time) - 100)
    judged = judge(stream)
    assert judged.usable[100:, L_WRIST].mean() < 0.05
    assert (judged.states[102:, L_WRIST] != TrustState.FRESH).mean() > 0.95


def test_outside_the_room_is_said() -> None:
    stream = walk()
    stream.position[100:, L_WRIST, 2] = 3.5
    judged = judge(stream)
    assert not judged.usable[100:, L_WRIST].any() and judged.alarms() == {TrustState.OUT_OF_RANGE}
    assert [text for _, text in judged.messages] == ["l_wrist: told to be outside the room"]


def test_a_sensor_that_is_not_worn_is_said_once_and_may_be_put_on() -> None:
    stream = walk(6.0)
    stream.tracked[:500, L_WRIST] = False
    judged = judge(stream)
    assert (judged.states[301:500, L_WRIST] == TrustState.NOT_WORN).all() and not judged.states[500:].any()
    assert [text for _, text in judged.messages] == [
        "l_wrist: not heard since the start (not worn?)",
        "l_wrist: heard now",
    ]


def test_an_orientation_may_be_told_for_a_while_only() -> None:
    stream = walk()
    stream.orientation[60:, L_ANKLE] = np.nan
    stream.orientation[120, L_ANKLE] = (1.0, 0.0, 0.0, 0.0)
    judged = judge(stream)
    assert judged.usable.all() and not judged.alarms()


def test_silence_outweighs_what_was_wrong_before() -> None:
    for spoil in ("frozen", "far"):
        stream = walk()
        if spoil == "frozen":
            stream.orientation[60:, L_ANKLE] = stream.orientation[59, L_ANKLE]
        else:
            stream.position[60:, L_ANKLE, 0] += 2.0
        stream.tracked[100:, L_ANKLE] = False
        judged = judge(stream)
        assert judged.states[99, L_ANKLE] in (TrustState.FROZEN, TrustState.JUMPED)
        assert (judged.states[117:, L_ANKLE] == TrustState.STALE).all()


def test_a_capture_that_is_yet_to_come_is_not_fresh() -> None:
    trust = judge(walk()).trust
    assert (trust.judge(walk().time[-1]) == TrustState.FRESH).all()
    assert (trust.judge(walk().time[-1] - 0.2) == TrustState.STALE).all()


@pytest.mark.parametrize("shift", [-3600.0, -1.0, 3600.0])
def test_a_clock_that_is_set_is_followed(shift: float) -> None:
    stream = walk()
    stream.time[100:] += shift
    judged = judge(stream)
    assert judged.usable.all() and not judged.alarms() - {TrustState.FRESH, TrustState.STALE}
    assert not judged.states[101:].any()


def test_parts_in_many_datagrams_are_judged_alike() -> None:
    stream = swapped(walk(), 100)
    trust, states = Trust(NAMES), []
    for i, time in enumerate(stream.time.tolist()):
        for row in (3, 1, 0, 2, 5, 4):
            one = slice(row, row + 1)
            trust.take(
                np.array([row]),
                time,
                position=stream.position[i, one],
                orientation=stream.orientation[i, one],
                tracked=stream.tracked[i, one],
            )
        states.append(trust.judge(time + LAG))
    assert set(np.unique(states[100:149])) == {TrustState.FRESH, TrustState.SWAPPED}
    assert (np.array(states)[100:149, [L_WRIST, R_WRIST]] == TrustState.SWAPPED).all()


def test_what_has_mended_before_anybody_moved_is_not_told() -> None:
    trust, sensors = Trust(("head", "l_wrist")), np.arange(2)
    chance = np.random.default_rng(2)

    def tell(rows: np.ndarray, begin: float) -> None:
        for time in np.arange(begin, begin + 1.0, 0.01):
            place = HOME[rows] + chance.normal(0.0, 0.001, (len(rows), 3))
            facing = np.tile([1.0, 0.0, 0.0, 0.0], (len(rows), 1))
            trust.take(rows, time, position=place, orientation=facing, tracked=np.ones(len(rows), dtype=bool))
            trust.judge(time)

    tell(sensors, 1.0)
    trust.messages()
    trust.judge(4.0)  # nobody was heard
    tell(sensors[:1], 4.0)
    trust.forget_mended()
    (text,) = trust.messages()
    assert text.startswith("l_wrist: nothing that can be used")
    tell(sensors, 5.0)
    assert trust.messages() == ["l_wrist: back"]
