"""Findings on sensors: limbs that a sender makes up, rate, gaps, loss, clock and roles."""

from collections.abc import Callable

import numpy as np
import pytest

from doctor_rig import FRAMES, captured, fixes, json_poses, played, steady, text_of
from live_rig import five
from messages import shows, shows_lines
from retarget import rotations
from retarget.live.admission import Datagram
from retarget.schema.performer import load_performer
from retarget.setup.doctor_capture import StreamCapture
from retarget.setup.doctor_sensors import invented_findings, rate_findings, role_findings
from retarget.setup.doctor_stream import named_for
from sim.faults.sender import FakeSender, SenderFault, frozen, lost, moved, silent, swapped

RATE = 100.0


def turned(*, own: float, turn: float = 1.0) -> StreamCapture:
    """A trunk that turns with both hands; the left one also swings by `own` m, the right one by 0.1 m."""
    rows = []
    for k in range(400):
        time = k / RATE
        quat = rotations.from_axis_angle(np.array([0.0, 0.0, 1.0]), np.array(turn * np.sin(time)))
        swing = np.array([0.0, 0.0, np.sin(3.0 * time)])
        place = {name: rotations.rotate(quat, np.array([0.0, side, -0.4])) for name, side in (("l", 0.2), ("r", -0.2))}
        poses: dict[str, dict[str, list[float]]] = {
            "chest": {"p": [0.0, 0.0, 1.3], "q": quat.tolist()},
            "l_wrist": {"p": (place["l"] + own * swing + [0.0, 0.0, 1.3]).tolist()},
            "r_wrist": {"p": (place["r"] + 0.1 * turn * swing + [0.0, 0.0, 1.3]).tolist()},
        }
        rows.append(Datagram(time, ("127.0.0.1", 1), json_poses(time, poses, quaternion="wxyz")))
    return played(rows)


def test_a_hand_fixed_to_the_trunk_is_made_up_and_the_other_is_not() -> None:
    lines = fixes(invented_findings("json", turned(own=0.0)))
    assert len(lines) == 1 and lines[0].startswith("fix  l_wrist: moves with the chest")


def test_a_hand_that_moves_by_itself_is_real() -> None:
    assert invented_findings("json", turned(own=0.01)) == []


def test_without_motion_no_limb_is_judged() -> None:
    found = invented_findings("json", turned(own=0.0, turn=0.0))
    assert not fixes(found)
    shows(text_of(found))


def test_a_sender_without_a_trunk() -> None:
    assert invented_findings("natnet", turned(own=0.0)) == []


POSES = {name: {"p": [0.0, 0.1 * row, 1.0]} for row, name in enumerate(five().sensors)}
SOURCE = ("127.0.0.1", 1)


def sent(
    *, rate: float = 100.0, seconds: float = 4.0, frame: Callable[[int], dict[str, object]] = lambda k: {}
) -> StreamCapture:
    """Frame k at k / rate s; `frame` gives its other keys; {"leave": True}: it is lost."""
    rows = []
    for k in range(round(rate * seconds)):
        more = frame(k)
        if not more.pop("leave", False):
            payload = json_poses(1000.0 + k / rate, POSES, **more)
            rows.append(Datagram(0.1 + k / rate, SOURCE, payload))
    return played(rows, seconds=seconds)


def wrong(capture: StreamCapture) -> str:
    return "\n".join(fixes(rate_findings("json", capture)))


def test_a_good_stream_has_nothing_to_fix() -> None:
    found = rate_findings("json", sent(frame=lambda k: {"frame": k}))
    assert not fixes(found)
    shows(text_of(found), 100, "frames/s", 0)


def test_a_slow_one() -> None:
    shows(wrong(sent(rate=10.0)), 10, "frames/s", 25)
    shows(text_of(rate_findings("json", sent(rate=30.0))), 30)


def test_silence_in_the_middle_and_at_the_end() -> None:
    middle = "\n".join(fixes(rate_findings("json", captured(silent(3.0, 3.5)))))
    shows(middle, 1, "0.13", "0.5")
    shows(wrong(captured(silent(4.0, 9.0))), "1.0")


def test_uneven_arrivals() -> None:
    rows = [Datagram(np.ceil(8.0 * k / 50.0) / 8.0, SOURCE, json_poses(k / 50.0, POSES)) for k in range(200)]
    shows(wrong(played(rows, seconds=4.0)))


def test_loss_by_frame_numbers() -> None:
    shows(wrong(sent(frame=lambda k: {"frame": k, "leave": k % 5 == 0})), 77, 389)


def test_a_sender_that_counts_by_two_loses_nothing() -> None:
    assert not wrong(sent(frame=lambda k: {"frame": 2 * k}))


def test_a_number_that_stands_still() -> None:
    shows(wrong(sent(frame=lambda k: {"frame": 7})))


def test_frames_out_of_order_are_counted() -> None:
    found = rate_findings("json", sent(frame=lambda k: {"frame": k ^ 1}))
    shows(text_of(found))


@pytest.mark.parametrize(
    ("stamp", "words"),
    [
        (lambda time: 5.0, "time stands still"),
        (lambda time: time + (50.0 if time > 3.0 else 0.0), "jumped once by 49.99"),
        (lambda time: time - (9.0 if time > 3.0 else 0.0) + 500.0, "jumped once by 9."),
        (lambda time: 1.3 * time, "second lasts 0.77 local seconds"),
        (lambda time: 0.7 * time, "second lasts 1.43 local seconds"),
    ],
)
def test_clocks(stamp: Callable[[float], float], words: str) -> None:
    assert words in wrong(captured(sender=FakeSender(frames=FRAMES, stamp=stamp)))


def test_a_sender_without_time_has_a_finding_that_is_not_wrong() -> None:
    capture = sent()
    capture.frames = [type(one)(one.arrival, None, None, one.names) for one in capture.frames]
    found = rate_findings("json", capture)
    assert not fixes(found)
    shows(text_of(found))


def test_a_few_frames_say_little() -> None:
    shows(wrong(sent(rate=1.0, seconds=3.0)), 3)


def test_left_out_samples_of_mvn_are_not_its_fault() -> None:
    capture = sent(frame=lambda k: {"frame": k, "leave": k % 5 == 0})
    assert not any("loss" in line for line in fixes(rate_findings("mvn", capture)))


def test_seconds_of_single_precision_grow_coarse() -> None:
    capture = sent()
    hours = 40.0 * 3600.0
    capture.frames = [type(one)(one.arrival, hours + one.arrival, None, one.names) for one in capture.frames]
    shows("\n".join(fixes(rate_findings("vmc", capture))), 16)
    assert not fixes(rate_findings("json", capture))


def found_with(*faults: SenderFault) -> str:
    return "\n".join(fixes(role_findings(five(), "json", captured(*faults))))


def test_all_is_well() -> None:
    found = role_findings(five(), "json", captured())
    assert not fixes(found)
    shows(text_of(found), "head", "l_wrist", "r_wrist", "l_ankle", "r_ankle")


def test_one_that_is_missing_is_named_with_what_comes_instead() -> None:
    lines = found_with(lost("l_ankle", 0.0, 99.0))
    shows(lines, "l_ankle", "head", "--performer")


@pytest.mark.parametrize(
    ("fault", "who", "words"),
    [
        (frozen("l_wrist", 3.0, 99.0), "l_wrist", "repeats one value"),
        (moved("head", 3.0, 99.0, (50.0, 0.0, 0.0)), "head", "outside the room"),
        (moved("r_wrist", 3.0, 3.9, (1.5, 0.0, 0.5)), "r_wrist", "jumps"),
        (swapped("l_wrist", "r_wrist", 4.0, 99.0), "l_wrist, r_wrist", "jumps farther"),
        (lost("head", 3.0, 99.0), "head", "cannot be used"),
    ],
)
def test_each_wrong_state_names_its_sensor_alone(fault: SenderFault, who: str, words: str) -> None:
    lines = found_with(fault).splitlines()
    assert len(lines) == 1, lines
    assert lines[0].startswith(f"fix  {who}: ") and words in lines[0]


def test_all_in_millimetres_is_one_line() -> None:
    poses = {name: {"p": [500.0, 20.0 * row, 1500.0]} for row, name in enumerate(five().sensors)}
    rows = [Datagram(0.01 * k, ("127.0.0.1", 1), json_poses(0.01 * k, poses)) for k in range(300)]
    lines = fixes(role_findings(five(), "json", played(rows)))
    assert sum("unit (metres)" in line for line in lines) == 1


def test_own_names_of_a_sender_need_roles() -> None:
    capture = played(steady(json_poses(1.0, {"Head": {"p": [0, 0, 1]}})))
    shows("\n".join(fixes(role_findings(five(), "json", capture))), "`role`")


def test_vrchat_has_no_wrists() -> None:
    named = named_for(five(), "slimevr_vrchat")
    assert named.sensors["l_wrist"].role == "?" and named.sensors["head"].role is None
    optitrack = load_performer("optitrack")
    assert named_for(optitrack, "natnet") == optitrack


def test_an_empty_stream_has_no_findings() -> None:
    assert role_findings(five(), "json", played([])) == []


def test_a_partial_performer_misses_only_the_sensors_that_measure_it() -> None:
    everything = load_performer("all")
    found = role_findings(everything, "json", captured(lost("l_toe", 0.0, 99.0), performer=everything))
    assert not fixes(found)
    shows(text_of(found), "l_toe")
    lines = fixes(role_findings(everything, "json", captured(lost("head", 0.0, 99.0), performer=everything)))
    shows_lines(lines, "head")
