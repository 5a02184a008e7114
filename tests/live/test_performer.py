"""Sensors without which a live run does not begin: waited for, named, or refused."""

import pytest

from hardware.clock import VirtualClock
from live_rig import WHERE, five, live_stream
from messages import refuses
from retarget.errors import InputError, UsageError
from retarget.live.begin import LiveOptions, begin_live
from retarget.live.performer import LivePerformer
from retarget.schema.performer import Performer, load_performer
from sim.faults.sender import FakeSender, Poses, SenderFault


def only(*names: str) -> SenderFault:
    def fault(time: float, poses: Poses) -> Poses:
        return {name: poses[name] for name in names}

    return fault


FIVE = only("head", "l_wrist", "r_wrist", "l_ankle", "r_ankle")


def begun(performer: Performer, *faults: SenderFault) -> LivePerformer:
    stream, clock = live_stream(FakeSender(faults=list(faults)), performer), VirtualClock()
    options = LiveOptions(patience=1.0, countdown=0.2)
    found = begin_live(stream, options, clock=clock, rate_hz=100.0, where=WHERE, notify=lambda text: None)
    assert isinstance(found.samples, LivePerformer)
    return found.samples


@pytest.mark.parametrize(("name", "missing"), [("six", "pelvis"), ("ten", "l_knee")])
def test_a_listed_role_that_the_stream_does_not_have_is_refused_by_name(name: str, missing: str) -> None:
    with refuses(InputError, missing, "--performer"):
        begun(load_performer(name), FIVE)


@pytest.mark.parametrize("lost", ["pelvis", "l_ankle"])
def test_base_sensors_are_waited_for(lost: str) -> None:
    kept = [name for name in load_performer("six").sensors if name != lost]
    with refuses(InputError, found=lost):
        begun(load_performer("six"), lambda time, poses: {name: poses[name] for name in kept if name in poses})


def test_all_takes_what_there_is_and_moves() -> None:
    performer = begun(load_performer("all"), FIVE)
    clock = performer._clock
    assert isinstance(clock, VirtualClock)
    followed = 0
    for tick in range(300):
        clock.advance(0.01)
        performer.poll()
        followed += performer.sample(tick) is not None
    assert followed > 150


def test_a_file_without_wrists_is_refused_at_once() -> None:
    plain = load_performer("five")
    without = plain.model_copy(update={"sensors": {name: plain.sensors[name] for name in ("head", "l_ankle")}})
    with refuses(UsageError, "l_wrist", "r_wrist"):
        begun(without)


@pytest.mark.parametrize(
    ("where", "deadlines", "waits"), [("web://", False, True), ("web://", True, False), (WHERE, False, False)]
)
def test_a_page_is_waited_for_without_limit_where_nothing_has_torque(where: str, deadlines: bool, waits: bool) -> None:
    stream = live_stream(FakeSender(), five())
    found = begin_live(
        stream,
        LiveOptions(countdown=0.2),
        clock=VirtualClock(),
        rate_hz=100.0,
        where=where,
        notify=lambda text: None,
        has_deadlines=deadlines,
    ).samples
    assert isinstance(found, LivePerformer) and found.paused is waits
    found.clutch(engaged=False)
    assert found.paused
