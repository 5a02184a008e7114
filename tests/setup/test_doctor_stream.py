"""Findings on a stream: silence, wrong protocols, refused senders, recordings."""

import socket
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from doctor_rig import HERE, captured, fixes, json_poses, judged, played, steady, text_of
from hardware.clock import MonotonicClock, VirtualClock
from live_rig import five
from messages import Facts, refuses, shows, shows_lines
from mvn_packets import mvn, quaternions, standing
from natnet_packets import Motion, Pose, frame
from osc_bytes import bundle, message, pose
from retarget.errors import InputError
from retarget.live.address import parse_address
from retarget.live.admission import Datagram
from retarget.setup.doctor_stream import (
    silence_findings,
    stream_findings,
)
from retarget.sources.natnet_wire import Version

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
FIXES: dict[str, tuple[list[Datagram], str, Facts]] = {
    "not allowed": (steady(ONE, source=OTHER), ALLOWED, ("192.168.1.9", 5)),
    "a second source": (SECOND, JSON, ("second source", "192.168.1.9", HERE[0], HERE[1])),
    "damage": (DAMAGED, JSON, ("JSON", "UTF-8", 40, 200)),
    "a rate beyond what is taken": (steady(ONE, rate=9000.0, seconds=0.5), JSON, ("datagrams a second", "6400")),
    "no avatar": (steady(NO_AVATAR), "vmc://:39539", "avatar"),
}


@pytest.mark.parametrize("case", FIXES)
def test_what_is_wrong_with_a_sender(case: str) -> None:
    rows, text, facts = FIXES[case]
    capture = played(rows, text=text, seconds=0.5 if case.startswith("a rate") else 4.0)
    shows_lines(fixes(judged(capture, text=text)), facts)


def said(text: str) -> str:
    return text_of(silence_findings(parse_address(text), seconds=5.0))


@pytest.mark.parametrize(
    ("text", "facts"),
    [
        ("vmc://:39539", ("5.0", "127.0.0.1", "UDP", 39539, "vmc://0.0.0.0:39539?allow=ITS_ADDRESS")),
        ("vmc://0.0.0.0:39539?allow=192.168.1.20", ("192.168.1.20/32", "firewall")),
        ("natnet://127.0.0.1", "Motive"),
    ],
)
def test_causes_of_silence(text: str, facts: Facts) -> None:
    found = said(text)
    shows(found, facts)
    assert ("firewall" in found) == ("0.0.0.0" in text.split("?")[0])


def test_motive_beyond_this_machine_needs_its_port_and_what_answered_is_no_silence() -> None:
    text = said("natnet://192.168.1.5")
    assert "1511/udp" in text or "UDP port 1511" in text
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


def test_no_such_recording_is_a_bad_argument() -> None:
    with refuses(InputError):
        stream_findings(parse_address("replay://nope?kind=vmc"), five(), clock=VirtualClock(), seconds=1.0)


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
