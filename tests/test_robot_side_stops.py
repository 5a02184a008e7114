"""Somebody who asks to stop: heard in the tick that comes, insisting or not, and whatever fails while it brakes."""

import pytest

from hardware.guard_state import StopCause
from retarget.pipeline import INTERRUPTED, Watch
from retarget.robot_side import INSISTED
from rig import Rig, play
from support.messages import refuses
from test_robot_side import swing, times_of_writing


def test_who_insists_does_not_wait_for_the_robot_to_stand() -> None:
    rig, asked = Rig(swing()), 0

    def stop() -> bool:
        nonlocal asked
        asked += 1
        return asked == 30

    ending = play(rig, Watch(stop_asked=stop, cut_asked=lambda: asked == 30 and not rig.gate.at_rest))
    assert not rig.gate.at_rest and not rig.bus.torque_on
    assert ending.reason == f"{INTERRUPTED}, then: {INSISTED} (torque is off)"
    assert len(ending.record) == 29


def test_who_insists_after_a_failure_does_not_wait_either() -> None:
    rig = Rig(swing())

    def broken(done: int) -> None:
        if done == 20:
            raise OSError("no terminal")

    with refuses(OSError):
        play(rig, Watch(broken, cut_asked=lambda: True, every=1))
    assert not rig.gate.at_rest and not rig.bus.torque_on


@pytest.mark.parametrize("in_clip", [True, False])
def test_a_look_that_fails_while_it_brakes_is_raised_when_it_stands(in_clip: bool) -> None:
    """In the stop that somebody asked for, and in that of the failure."""
    rig, asked = Rig(swing()), 0

    def look() -> bool:
        nonlocal asked
        asked += 1
        if asked >= 30 and in_clip:
            raise OSError("no such drive")
        return asked >= 30

    def cut() -> bool:
        raise OSError("no such drive")

    with refuses(OSError):
        play(rig, Watch(stop_asked=look, cut_asked=cut))
    assert rig.gate.at_rest and not rig.bus.torque_on and rig.guard.stop_reason is not None


def test_who_cannot_hear_of_a_servo_does_not_hinder_the_stop(monkeypatch: pytest.MonkeyPatch) -> None:
    rig, told = Rig(swing()), 0

    def tell(text: str) -> None:
        nonlocal told
        told += 1
        raise BrokenPipeError

    monkeypatch.setattr(rig.side, "_tell", tell)
    monkeypatch.setattr(rig.guard.health.warnings, "take_news", lambda: ["it is warm"])
    ending = play(rig)
    assert told > 40 and (ending.state, ending.reason) == ("idle", None)
    assert rig.gate.at_rest and not rig.bus.torque_on


def test_a_stop_that_comes_during_the_wait_for_a_tick_brakes_in_it(monkeypatch: pytest.MonkeyPatch) -> None:
    """What is asked just after a look is heard by the next one, a tick later, and nothing is followed any more."""
    rig, looked, stopped = Rig(swing()), list[float](), list[float]()
    stop = rig.guard.stop

    def noted(reason: str, cause: StopCause = StopCause.REQUESTED) -> None:
        stopped.append(rig.clock.now())
        stop(reason, cause)

    def asked() -> bool:
        looked.append(rig.clock.now())
        return len(looked) > 30

    times = times_of_writing(rig, monkeypatch)
    monkeypatch.setattr(rig.guard, "stop", noted)
    play(rig, Watch(stop_asked=asked))
    assert stopped[0] - looked[29] == pytest.approx(rig.dt) and stopped[0] == looked[30]
    assert min(time for time in times if time >= stopped[0]) - looked[29] < 1.5 * rig.dt
