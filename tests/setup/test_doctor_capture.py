"""Capture of a stream: what is kept, and that it is bounded."""

from doctor_rig import captured, played
from hardware.clock import VirtualClock
from live_rig import five, live_stream
from osc_bytes import message
from retarget.live.admission import Datagram
from retarget.live.sensor_validity import ValidityState
from retarget.setup.doctor_capture import MOST_KINDS, capture_stream
from sim.faults.sender import FakeSender, lost


def test_frames_names_and_senders_are_kept() -> None:
    capture = captured(seconds=3.0)
    assert 295 <= len(capture.frames) <= 301 and capture.arrived == len(capture.frames)
    assert {"head", "l_wrist"} <= capture.last_poses.keys()
    assert list(capture.sources) == [("127.0.0.1", 40000)]
    assert len(capture.samples) == len(capture.states) > 50
    assert capture.share("head", ValidityState.FRESH) == 1.0


def test_a_lost_sensor_is_stale_for_that_time() -> None:
    capture = captured(lost("l_wrist", 3.0, 4.0), seconds=5.0)
    assert 0.15 < capture.share("l_wrist", ValidityState.STALE) < 0.3
    assert capture.share("r_wrist", ValidityState.STALE) == 0.0


def test_kinds_are_bounded() -> None:
    rows = [Datagram(k / 1000, ("127.0.0.1", 1), message(f"/a{k}", "f", 0.0)) for k in range(280)]
    capture = played(rows)
    assert len(capture.kinds) == MOST_KINDS + 1 and capture.kinds.total() == 280


def test_every_step_is_reported() -> None:
    times: list[float] = []
    capture_stream(live_stream(FakeSender(), five()), clock=VirtualClock(), seconds=0.1, on_step=times.append)
    assert 10 <= len(times) <= 12
