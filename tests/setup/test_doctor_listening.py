"""What is kept of a stream that is listened to."""

from doctor_rig import heard, json_poses, played, steady
from hardware.clock import VirtualClock
from live_rig import five, live_stream
from osc_bytes import message
from retarget.live.admission import Datagram
from retarget.live.sensor_validity import ValidityState
from retarget.setup.doctor_listening import MOST_KINDS, listen_to
from sim.faults.sender import FakeSender, lost


def test_frames_names_and_senders_are_kept() -> None:
    listening = heard(seconds=3.0)
    assert 295 <= len(listening.frames) <= 301 and listening.arrived == len(listening.frames)
    assert {"head", "l_wrist"} <= listening.told.keys()
    assert list(listening.sources) == [("127.0.0.1", 40000)]
    assert len(listening.looks) == len(listening.states) > 50
    assert listening.share("head", ValidityState.FRESH) == 1.0


def test_a_lost_sensor_is_stale_for_that_time() -> None:
    listening = heard(lost("l_wrist", 3.0, 4.0), seconds=5.0)
    assert 0.15 < listening.share("l_wrist", ValidityState.STALE) < 0.3
    assert listening.share("r_wrist", ValidityState.STALE) == 0.0


def test_the_stream_is_given_back_as_it_was() -> None:
    listening = played(steady(json_poses(1.0, {"head": {"p": [0, 0, 1]}})))
    assert type(listening.stream.receiver).__name__ == "Played"
    assert type(listening.stream.decoder).__name__ == "JsonPoseDecoder"


def test_kinds_are_bounded_whatever_comes() -> None:
    rows = [Datagram(k / 1000, ("127.0.0.1", 1), message(f"/a{k}", "f", 0.0)) for k in range(280)]
    listening = played(rows)
    assert len(listening.kinds) == MOST_KINDS + 1 and listening.kinds.total() == 280


def test_who_listens_beside_is_called() -> None:

    times: list[float] = []
    listen_to(live_stream(FakeSender(), five()), clock=VirtualClock(), seconds=0.1, beside=times.append)
    assert 10 <= len(times) <= 12
