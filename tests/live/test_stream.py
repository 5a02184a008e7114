"""The backlog of a stream that was not polled is taken before the stream is judged, in bounded time."""

import numpy as np
import pytest

from hardware.checked_goal import CheckedGoal
from live_rig import LiveRig, live_stream
from live_rig import five as five_sensors
from retarget.live.admission import Admission, Datagram
from retarget.live.begin import LiveOptions
from retarget.live.stream import LONGEST_S, RECENT_S, CatchingUp, LiveStream
from retarget.sources.stream_frame import Dropped
from sim.faults.sender import FakeSender, encoded

DT = 0.008


class Slow:
    """A receiver of a sender that sends at 250 Hz, of which a poll gives `per_poll`. ends: s."""

    def __init__(self, per_poll: int, *, ends: float = np.inf, payload: bytes = b"") -> None:
        self.dropped, self._per_poll, self._ends, self._sent = Dropped(), per_poll, ends, 0
        self._payload = payload or encoded(0.0, {"head": np.array([0.0, 0.0, 1.6])})

    finished = False

    def poll(self, now: float) -> list[Datagram]:
        due = int(min(now, self._ends) / 0.004)
        first, self._sent = self._sent, min(due, self._sent + self._per_poll)
        return [Datagram(0.004 * k, ("127.0.0.1", 4), self._payload) for k in range(first, self._sent)]

    def close(self) -> None:
        """Nothing is open."""


def stream_from(receiver: Slow) -> LiveStream:
    stream = live_stream(FakeSender(), five_sensors())
    stream.receiver, stream.admission = receiver, Admission(burst=10_000)
    return stream


def ticks_to_catch_up(receiver: Slow, *, after: float) -> tuple[int, float]:
    """Ticks until it is done, and how old the last datagram then is, s."""
    stream = stream_from(receiver)
    catching, now, ticks = CatchingUp(stream), after, 0
    while True:
        stream.poll(now, moving=True)
        if not catching.step(now):
            assert not catching.step(now + 10.0), "once done it stays so"
            return ticks, now - stream.last
        ticks, now = ticks + 1, now + DT
        assert ticks < 500


def test_a_backlog_is_taken_over_several_ticks() -> None:
    ticks, age = ticks_to_catch_up(Slow(12), after=0.8)
    assert 10 <= ticks <= 25 and age <= RECENT_S


def test_a_stream_that_is_up_to_date_waits_for_nothing() -> None:
    assert ticks_to_catch_up(Slow(128), after=0.1)[0] == 0


def test_a_silent_stream_ends_the_backlog_when_its_last_is_taken() -> None:
    ticks, age = ticks_to_catch_up(Slow(128, ends=0.2), after=1.0)
    assert ticks <= 6 and age > 0.7


def test_a_sender_that_cannot_be_decoded_is_not_waited_for_for_long() -> None:
    ticks, _ = ticks_to_catch_up(Slow(2, payload=b"?"), after=2.0)
    assert ticks == pytest.approx(LONGEST_S / DT, abs=2)


def test_at_once_takes_all() -> None:
    stream = stream_from(Slow(12))
    CatchingUp(stream).at_once(1.0)
    assert stream.arrived == 250


def test_a_second_of_powering_reports_no_lost_sensors(monkeypatch: pytest.MonkeyPatch) -> None:
    rig = LiveRig(FakeSender(), options=LiveOptions(countdown=0.5, duration=0.5))
    with rig.prepared() as prepared:
        assert prepared.machine is not None
        arm, guard = prepared.machine.guard.arm, prepared.machine.guard

        def slowly(goal: CheckedGoal) -> None:
            arm(goal)
            rig.clock.sleep_until(rig.clock.now() + 1.0)

        monkeypatch.setattr(guard, "arm", slowly)
        poll, most = rig.sender.poll, 4  # as a work budget lets it
        waiting: list[Datagram] = []

        def some(now: float) -> list[Datagram]:
            waiting.extend(poll(now))
            taken = waiting[:most]
            del waiting[:most]
            return taken

        monkeypatch.setattr(rig.sender, "poll", some)
        rig.said.clear()
        result = prepared.run()
    assert result.stop is None
    assert not [text for text in rig.said if "nothing" in text or "waits" in text], rig.said
