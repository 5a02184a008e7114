"""Findings on a stream: silence, wrong protocols, refused senders, recordings."""

import socket
from collections.abc import Callable
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from doctor_rig import FRAMES, HERE, captured, fixes, json_poses, judged, played, steady, text_of
from hardware.clock import MonotonicClock, VirtualClock
from live_rig import ClockedSender, five
from messages import Facts, shows, shows_lines
from mvn_packets import mvn, quaternions, standing
from natnet_packets import Motion, Pose, frame
from osc_bytes import bundle, message, pose
from retarget import rotations
from retarget.human.pose_validation import ValidityState
from retarget.live.address import parse_address
from retarget.live.admission import Datagram
from retarget.schema.performer import load_performer
from retarget.setup.doctor_sensors import StreamCapture, invented_findings, rate_findings, role_findings
from retarget.setup.doctor_stream import silence_findings, stream_findings
from retarget.sources.streams.natnet_wire import Version
from sim.faults.sender import SenderFault, frozen, lost, moved, silent, swapped

JSON = "json://:14150"
ONE = json_poses(1.0, {"head": {"p": [0, 0, 1]}})
VMC = bundle(pose("/VMC/Ext/Tra/Pos", "human://CHEST"))
OTHER = ("192.168.1.9", 5)


@pytest.mark.parametrize(
    ("text", "payload", "words"),
    [
        ("mvn://:9763", VMC, "Listen with vmc://:9763"),
        ("mvn://:9763", mvn("05", b""), "Position + Orientation (Quaternion)"),
        ("mvn://:9763", mvn("20", b""), "Position + Orientation (Quaternion)"),
        ("vmc://:39539", message("/tracking/trackers/1/position", "fff", 0.0, 1.0, 0.0), "vrchat://:39539"),
        ("vmc://:39539", quaternions(standing()), "mvn://:39539"),
        ("vmc://:39539", ONE, "json://:39539"),
        ("vmc://:39539", message("/VMC/Ext/Blend/Apply", ""), "Load an avatar"),
        ("json://:14150", b'{"axes": "blender", "poses": {}}', '"axes" as one of rep103'),
        ("json://:14150", b"\x04\x22\x4d\x18", "let a bridge send"),
        ("json://:14150", b"what?", "which program sends it"),
    ],
)
def test_a_wrong_protocol_is_one_line(text: str, payload: bytes, words: str) -> None:
    lines = fixes(judged(played(steady(payload), text=text), text=text))
    assert len(lines) == 1 and words in lines[0]


ALLOWED = "json://0.0.0.0:14150?allow=192.168.1.20"
NO_AVATAR = bundle(message("/VMC/Ext/OK", "i", 0), pose("/VMC/Ext/Tra/Pos", "human://CHEST"))
SECOND = sorted(steady(ONE) + [Datagram(1.0 + k / 10, OTHER, ONE) for k in range(5)])
DAMAGED = [Datagram(one.arrival, one.source, one.payload[: -(k % 5 == 0) or None]) for k, one in enumerate(steady(ONE))]
NEW = [Datagram(one.arrival, (HERE[0], 9000 + k), one.payload) for k, one in enumerate(steady(ONE))]
IN_MS = [one._replace(payload=json_poses(1e3 * one.arrival, {"head": {"p": [0, 0, 1]}})) for one in steady(ONE)]
NO_NUMBERS = steady(bundle(message("/VMC/Ext/Bone/Pos", "sssssssss", "Hips", *"0123456", "")))
FIXES: dict[str, tuple[list[Datagram], str, Facts]] = {
    "not allowed": (steady(ONE, source=OTHER), ALLOWED, ("192.168.1.9", 5)),
    "a second source": (SECOND, JSON, ("second source", "192.168.1.9", HERE[0], HERE[1])),
    "new sockets": (NEW, JSON, ("new socket for each datagram", HERE[0], "keep one")),
    "a time in ms": (IN_MS, JSON, ("1000 times too fast", "milliseconds", "seconds")),
    "no pose of the protocol": (NO_NUMBERS, "vmc://:39539", ("none holds a pose", "wrong types")),
    "damage": (DAMAGED, JSON, ("JSON", "UTF-8", 40, 200)),
    "a rate beyond what is taken": (steady(ONE, rate=9000.0, seconds=0.5), JSON, ("datagrams a second", "6400")),
    "no avatar": (steady(NO_AVATAR), "vmc://:39539", "avatar"),
}


@pytest.mark.parametrize("case", FIXES)
def test_what_is_wrong_with_a_sender(case: str) -> None:
    rows, text, facts = FIXES[case]
    capture = played(rows, text=text, seconds=0.5 if case.startswith("a rate") else 4.0)
    shows_lines(fixes(judged(capture, text=text)), facts)


@pytest.mark.parametrize(
    ("text", "facts"),
    [
        ("vmc://:39539", ("5.0", "127.0.0.1", "UDP", 39539, "vmc://0.0.0.0:39539?allow=ITS_ADDRESS")),
        ("vmc://0.0.0.0:39539?allow=192.168.1.20", ("192.168.1.20/32", "firewall")),
        ("natnet://127.0.0.1", "Motive"),
    ],
)
def test_causes_of_silence(text: str, facts: Facts) -> None:
    found = text_of(silence_findings(parse_address(text), seconds=5.0))
    shows(found, facts)
    assert ("firewall" in found) == ("0.0.0.0" in text.split("?")[0])


def test_a_server_elsewhere_needs_its_port_and_one_that_answered_is_no_silence() -> None:
    assert "1511/udp" in text_of(silence_findings(parse_address("natnet://192.168.1.5"), seconds=5.0))
    assert silence_findings(parse_address("natnet://127.0.0.1"), seconds=5.0, answered=True) == []


def test_a_good_stream_has_nothing_to_fix() -> None:
    found = judged(captured())
    assert not fixes(found), text_of(found)
    assert {"stream", "rate", "jitter", "clock", "sensors"} <= {finding.subject for finding in found}


@pytest.mark.parametrize(
    ("name", "kind", "wrong"),
    [("full12_vmc_50hz", "vmc", []), ("full12_vrcosc_20hz", "vrchat", ["rate", "sensors"])],
)
def test_real_recordings(shared: Path, name: str, kind: str, wrong: list[str]) -> None:
    address = parse_address(f"replay://{shared}/streams/slimevr/{name}.udprec.gz?kind={kind}")
    found = stream_findings(address, five(), clock=VirtualClock(), seconds=6.0)
    assert [line.split(":")[0].split()[1] for line in fixes(found)] == wrong


def test_a_port_that_is_taken_is_to_be_fixed() -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as holder:
        holder.bind(("127.0.0.1", 0))
        address = parse_address(f"vmc://:{holder.getsockname()[1]}")
        found = stream_findings(address, five(), clock=MonotonicClock(), seconds=1.0)
    shows(fixes(found)[0])


SEEDS = (
    bundle(message("/VMC/Ext/T", "f", 1.5), pose("/VMC/Ext/Tra/Pos", "human://LEFT_FOOT")),
    message("/tracking/trackers/1/position", "fff", 0.0, 1.0, 0.0),
    quaternions(standing()),
    frame(Motion(bodies=[Pose(1)]), Version(3, 0)),
    json_poses(1.0, {"head": {"p": [0, 0, 1]}}, frame=3),
)
GAPS = st.floats(0.0, 0.3)
CHANGES = st.lists(st.tuples(st.integers(0, 4), GAPS, st.integers(0, 300), st.binary(max_size=4)), max_size=30)


@settings(max_examples=40)
@given(CHANGES, st.sampled_from(["vmc://:1", "vrchat://:1", "mvn://:1", "json://:1"]))
def test_any_datagrams_are_judged(changes: list[tuple[int, float, int, bytes]], text: str) -> None:
    rows, time = list[Datagram](), 0.0
    for which, gap, at, new in changes:
        time += gap
        payload = SEEDS[which][:at] + new + SEEDS[which][at + len(new) :]
        rows.append(Datagram(time, HERE, payload))
    for finding in judged(played(rows, text=text, seconds=time + 0.1), text=text):
        assert finding.render().isprintable() and len(finding.render()) < 2000


# Capture of a stream, and findings on its sensors: limbs that a sender makes up, rate, gaps, loss, clock and roles.

RATE = 100.0
SOURCE = ("127.0.0.1", 1)
POSES = {name: {"p": [0.0, 0.1 * row, 1.0]} for row, name in enumerate(five().sensors)}


def test_a_lost_sensor_is_stale_for_that_time() -> None:
    capture = captured(lost("l_wrist", 3.0, 4.0), seconds=5.0)
    assert 0.15 < capture.share("l_wrist", ValidityState.STALE) < 0.3
    assert capture.share("r_wrist", ValidityState.STALE) == 0.0


@cache
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
        rows.append(Datagram(time, SOURCE, json_poses(time, poses, quaternion="wxyz")))
    return played(rows)


def test_a_hand_fixed_to_the_trunk_is_made_up_and_one_that_moves_by_itself_is_not() -> None:
    lines = fixes(invented_findings("json", turned(own=0.0)))
    assert len(lines) == 1 and lines[0].startswith("fix  l_wrist: moves with the chest")
    assert invented_findings("json", turned(own=0.01)) == []
    assert invented_findings("natnet", turned(own=0.0)) == []  # which sends no trunk


def sent(
    *, rate: float = 100.0, seconds: float = 4.0, frame: Callable[[int], dict[str, object]] = lambda k: {}
) -> StreamCapture:
    """Frame k at k / rate s; `frame` gives its other keys; {"leave": True}: it is lost."""
    rows = []
    for k in range(round(rate * seconds)):
        more = frame(k)
        if not more.pop("leave", False):
            rows.append(Datagram(0.1 + k / rate, SOURCE, json_poses(1000.0 + k / rate, POSES, **more)))
    return played(rows, seconds=seconds)


def bunched() -> StreamCapture:
    """Arrivals that come in bunches, eight a second."""
    return played(
        [Datagram(np.ceil(8.0 * k / 50.0) / 8.0, SOURCE, json_poses(k / 50.0, POSES)) for k in range(200)], seconds=4.0
    )


WRONG: dict[str, tuple[Callable[[], StreamCapture], Facts]] = {
    "slow": (lambda: sent(rate=10.0), (10, "frames/s", 25)),
    "silent in the middle": (lambda: captured(silent(3.0, 3.5)), (1, "0.13", "0.5")),
    "silent at the end": (lambda: captured(silent(4.0, 9.0)), "1.0"),
    "uneven": (bunched, ()),
    "lost frames": (lambda: sent(frame=lambda k: {"frame": k, "leave": k % 5 == 0}), (77, 389)),
    "a number that stands still": (lambda: sent(frame=lambda k: {"frame": 7}), ()),
    "few frames": (lambda: sent(rate=1.0, seconds=3.0), 3),
}


@pytest.mark.parametrize("case", WRONG)
def test_what_is_wrong_with_the_rate(case: str) -> None:
    make, facts = WRONG[case]
    shows("\n".join(fixes(rate_findings("json", make()))), facts)


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
    found = rate_findings("json", captured(sender=ClockedSender(stamp, FRAMES)))
    assert words in "\n".join(fixes(found))


def found_with(*faults: SenderFault) -> str:
    return "\n".join(fixes(role_findings(five(), "json", captured(*faults))))


def test_sensors_that_are_sent_and_one_that_is_not() -> None:
    found = role_findings(five(), "json", captured())
    assert not fixes(found) and role_findings(five(), "json", played([])) == []
    shows(text_of(found), "head", "l_wrist", "r_wrist", "l_ankle", "r_ankle")
    shows(found_with(lost("l_ankle", 0.0, 99.0)), "l_ankle", "head", "--performer")


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


def test_all_in_millimetres_is_one_line_and_own_names_need_roles() -> None:
    poses = {name: {"p": [500.0, 20.0 * row, 1500.0]} for row, name in enumerate(five().sensors)}
    rows = [Datagram(0.01 * k, ("127.0.0.1", 1), json_poses(0.01 * k, poses)) for k in range(300)]
    lines = fixes(role_findings(five(), "json", played(rows)))
    assert sum("unit (metres)" in line for line in lines) == 1
    capture = played(steady(json_poses(1.0, {"Head": {"p": [0, 0, 1]}})))
    shows("\n".join(fixes(role_findings(five(), "json", capture))), "`role`")


def test_a_partial_performer_misses_only_the_sensors_that_measure_it() -> None:
    everything = load_performer("all")
    found = role_findings(everything, "json", captured(lost("l_toe", 0.0, 99.0), performer=everything))
    assert not fixes(found)
    shows(text_of(found), "l_toe")
    lines = fixes(role_findings(everything, "json", captured(lost("head", 0.0, 99.0), performer=everything)))
    shows_lines(lines, "head")
