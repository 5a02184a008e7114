"""Why nobody is followed is said in a few words, and is the reason of the stop."""

import numpy as np
import pytest

from live_rig import LiveRig, live_stream
from live_rig import five as five_sensors
from retarget.live.begin import LiveOptions
from retarget.live.hindrance import WORDS, Hindered, hindrance_of
from retarget.live.stream_trouble import StreamTrouble
from retarget.live.trust_state import TrustState
from sim.faults.sender import FakeSender, SenderFault, lost, silent

NAMES = ("head", "l_wrist", "r_wrist", "l_ankle", "r_ankle")


def now_and_then(first: float, last: float) -> SenderFault:
    """From `first` on, s of the sender, something is sent for 0.1 s of every 0.4 s; nothing from `last` on."""
    return lambda time, poses: None if time >= first and (time >= last or (time - first) % 0.4 < 0.3) else poses


def told(
    *, late: bool = False, trouble: str = "", leapt: str = "", came_back: bool = False, **states: TrustState
) -> str:
    now = np.array([states.get(name, TrustState.FRESH) for name in NAMES], dtype=np.uint8)
    jumped = np.array([name == leapt for name in NAMES])
    return hindrance_of(NAMES, Hindered(now, jumped, (3, 4), late, trouble, came_back))


def test_the_first_that_applies_is_told() -> None:
    stale = TrustState.STALE
    assert told(trouble="nothing arrived", late=True, l_ankle=stale) == "nothing arrived"
    assert told(late=True, l_ankle=stale) == "l_ankle: lost"
    assert told(late=True) == "ticks came late"
    assert told() == "not for long enough at a time"


def test_what_is_in_the_way_only_now_is_not_told_as_if_it_had_been_all_the_time() -> None:
    assert told(trouble="nothing arrived", came_back=True) == "not for long enough at a time, at last: nothing arrived"
    assert told(late=True, came_back=True).endswith(", at last: ticks came late")
    assert told(came_back=True) == "not for long enough at a time"


def test_only_sensors_that_hinder_are_named() -> None:
    jumped = TrustState.JUMPED
    assert told(l_wrist=jumped, late=True) == "ticks came late"
    assert told(l_wrist=jumped, leapt="l_wrist") == "l_wrist: jumped"
    assert told(l_ankle=TrustState.FROZEN, r_ankle=TrustState.STALE) == "l_ankle: frozen, r_ankle: lost"
    assert set(WORDS) == set(TrustState) - {TrustState.FRESH}


def test_a_stream_that_is_heard_is_no_trouble() -> None:
    stream = live_stream(FakeSender(), five_sensors())
    trouble = StreamTrouble(stream)
    stream.last = 1.0
    assert not trouble.briefly(1.1, 0.14)
    assert trouble.briefly(1.2, 0.14) == "nothing arrived"
    assert not trouble.look(1.6)
    stream.arrived += 3
    assert trouble.briefly(1.7, 0.14) == "what arrived was unusable: no poses in it"
    stream.decoder.dropped.note("not JSON")
    assert trouble.briefly(1.7, 0.14) == "what arrived was unusable: not JSON (1)"


def test_what_arrives_instead_is_told_of_a_short_silence_too() -> None:
    stream = live_stream(FakeSender(), five_sensors())
    trouble = StreamTrouble(stream)
    for now in (1.0, 3.0):  # the second time what came in the first does not count
        stream.last = now
        assert not trouble.look(now) and not trouble.look(now + 0.06)
        assert trouble.briefly(now + 0.2, 0.14) == "nothing arrived"
        stream.arrived += 1
        stream.decoder.dropped.note("not JSON")
        assert trouble.briefly(now + 0.2, 0.14) == "what arrived was unusable: not JSON (1)"


@pytest.mark.parametrize(
    ("fault", "cause"),
    [
        (silent(5.0, 60.0), "nothing arrived"),
        (lost("l_ankle", 5.0, 60.0), "l_ankle: lost"),
        (now_and_then(5.0, 9.9), "not for long enough at a time, at last: nothing arrived"),
    ],
)
def test_it_is_the_reason_of_the_stop(fault: SenderFault, cause: str) -> None:
    rig = LiveRig(FakeSender(faults=[fault]), options=LiveOptions(countdown=0.5, duration=12.0))
    with rig.prepared() as prepared:
        result = prepared.run()
    assert result.stop is not None
    assert result.stop.reason == f"nobody could be followed ({cause}) for 4.81 s, allowed 4.8 s"


def test_it_is_the_reason_of_a_stop_on_the_way_to_the_performer_too() -> None:
    rig = LiveRig(FakeSender(faults=[silent(2.0, 60.0)]), options=LiveOptions(countdown=0.5, duration=3.0))
    with rig.prepared() as prepared:
        result = prepared.run()
    assert result.ticks_followed == 0 and result.stop is not None
    assert result.stop.reason.startswith("nobody could be followed (nothing arrived) for 4.8")
