"""Rate, jitter, gaps, loss and clock of a stream."""

from collections.abc import Callable

import numpy as np
import pytest

from doctor_rig import FRAMES, heard, json_poses, mends, played, text_of
from live_rig import five
from retarget.doctor.listening import Listening
from retarget.doctor.rate_findings import rate_findings
from retarget.live.datagram import Datagram
from sim.faults.sender import FakeSender, silent
from support.messages import shows

POSES = {name: {"p": [0.0, 0.1 * row, 1.0]} for row, name in enumerate(five().sensors)}
SOURCE = ("127.0.0.1", 1)


def sent(
    *, rate: float = 100.0, seconds: float = 4.0, frame: Callable[[int], dict[str, object]] = lambda k: {}
) -> Listening:
    """Frame k at k / rate; `frame` says what else stands in it, {"leave": True}: it is lost."""
    rows = []
    for k in range(round(rate * seconds)):
        more = frame(k)
        if not more.pop("leave", False):
            payload = json_poses(1000.0 + k / rate, POSES, **more)
            rows.append(Datagram(0.1 + k / rate, SOURCE, payload))
    return played(rows, seconds=seconds)


def wrong(listening: Listening) -> str:
    return "\n".join(mends(rate_findings("json", listening)))


def test_a_sound_stream_has_nothing_to_mend() -> None:
    found = rate_findings("json", sent(frame=lambda k: {"frame": k}))
    assert not mends(found)
    shows(text_of(found), 100, "frames/s", 0)


def test_a_slow_one() -> None:
    shows(wrong(sent(rate=10.0)), 10, "frames/s", 25)
    shows(text_of(rate_findings("json", sent(rate=30.0))), 30)


def test_silence_in_the_middle_and_at_the_end() -> None:
    middle = "\n".join(mends(rate_findings("json", heard(silent(3.0, 3.5)))))
    shows(middle, 1, "0.13", "0.5")
    shows(wrong(heard(silent(4.0, 9.0))), "1.0")


def test_uneven_arrivals() -> None:
    rows = [Datagram(np.ceil(8.0 * k / 50.0) / 8.0, SOURCE, json_poses(k / 50.0, POSES)) for k in range(200)]
    shows(wrong(played(rows, seconds=4.0)))


def test_loss_by_frame_numbers() -> None:
    shows(wrong(sent(frame=lambda k: {"frame": k, "leave": k % 5 == 0})), 77, 389)


def test_a_sender_that_counts_by_two_loses_nothing() -> None:
    assert not wrong(sent(frame=lambda k: {"frame": 2 * k}))


def test_a_number_that_stands_still() -> None:
    shows(wrong(sent(frame=lambda k: {"frame": 7})))


def test_frames_that_were_overtaken_are_counted() -> None:
    found = rate_findings("json", sent(frame=lambda k: {"frame": k ^ 1}))
    shows(text_of(found))


@pytest.mark.parametrize(
    ("stamp", "words"),
    [
        (lambda time: 5.0, "time stands still"),
        (lambda time: time + (50.0 if time > 3.0 else 0.0), "leapt once by 49.99"),
        (lambda time: time - (9.0 if time > 3.0 else 0.0) + 500.0, "leapt once by 9."),
        (lambda time: 1.3 * time, "second lasts 0.77 of ours"),
        (lambda time: 0.7 * time, "second lasts 1.43 of ours"),
    ],
)
def test_clocks(stamp: Callable[[float], float], words: str) -> None:
    assert words in wrong(heard(sender=FakeSender(frames=FRAMES, stamp=stamp)))


def test_a_sender_without_time_is_told_so_and_not_blamed() -> None:
    listening = sent()
    listening.frames = [type(one)(one.arrival, None, None, one.names) for one in listening.frames]
    found = rate_findings("json", listening)
    assert not mends(found)
    shows(text_of(found))


def test_a_few_frames_say_little() -> None:
    shows(wrong(sent(rate=1.0, seconds=3.0)), 3)


def test_left_out_samples_of_mvn_are_not_its_fault() -> None:
    listening = sent(frame=lambda k: {"frame": k, "leave": k % 5 == 0})
    assert not any("loss" in line for line in mends(rate_findings("mvn", listening)))


def test_seconds_of_single_precision_grow_coarse() -> None:
    listening = sent()
    hours = 40.0 * 3600.0
    listening.frames = [type(one)(one.arrival, hours + one.arrival, None, one.names) for one in listening.frames]
    shows("\n".join(mends(rate_findings("vmc", listening))), 16)
    assert not mends(rate_findings("json", listening))
