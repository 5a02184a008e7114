"""The sender example: what it sends is used, waves, and passes the beginning of a run."""

import runpy
from collections.abc import Callable
from pathlib import Path

import pytest

from hardware.clock import VirtualClock
from live_rig import WHERE, five, live_stream
from retarget.live.admission import Datagram
from retarget.live.begin import LiveOptions, begin_live
from retarget.sources.streams.stream_frame import Dropped
from sim.faults.sender import FakeSender


class _Sender:
    """What the example sends, from datagram `first` on."""

    def __init__(self, message: Callable[[int], bytes], first: int) -> None:
        self._message, self._first, self._sent = message, first, 0
        self._begun: float | None = None
        self.dropped = Dropped()

    @property
    def finished(self) -> bool:
        """Never."""
        return False

    def poll(self, now: float) -> list[Datagram]:
        """Sixty a second."""
        self._begun = now if self._begun is None else self._begun
        found = []
        while self._sent <= 60.0 * (now - self._begun):
            found.append(Datagram(now, ("127.0.0.1", 40000), self._message(self._first + self._sent)))
            self._sent += 1
        return found

    def close(self) -> None:
        """Nothing is open."""


@pytest.mark.parametrize("second", [0.0, 4.0, 9.0])
def test_a_run_begins_with_it_whenever_it_is_started(root: Path, second: float) -> None:
    sender = runpy.run_path(str(root / "examples/send_poses.py"), run_name="sender")
    stream, said = live_stream(FakeSender(), five()), list[str]()
    stream.receiver = _Sender(sender["message"], round(60.0 * second))
    options = LiveOptions(check_sides=True)
    begin_live(stream, options, clock=VirtualClock(), rate_hz=100.0, where=WHERE, notify=said.append)
    assert said[-1].startswith("left is left, up is up")
