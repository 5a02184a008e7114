"""Who sends, and what."""

import pytest

from doctor_rig import HERE, json_poses, judged, mends, played, steady, text_of
from mvn_packets import mvn, quaternions, standing
from osc_bytes import bundle, message, pose
from retarget.doctor.sender_findings import UNFRAGMENTED, sender_findings
from retarget.live.address import parse_address
from retarget.live.datagram import Datagram
from support.messages import shows, shows_lines

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
def test_mix_ups_are_said_in_one_line(text: str, payload: bytes, words: str) -> None:
    lines = mends(judged(played(steady(payload), text=text), text=text))
    assert len(lines) == 1 and words in lines[0]


def test_a_sender_that_is_not_allowed() -> None:
    text = "json://0.0.0.0:14150?allow=192.168.1.20"
    lines = mends(judged(played(steady(ONE, source=OTHER), text=text), text=text))
    shows(lines[0], "192.168.1.9", 5)


def test_a_second_source_and_who_was_first() -> None:
    rows = sorted(steady(ONE) + [Datagram(1.0 + k / 10, OTHER, ONE) for k in range(5)])
    line = next(line for line in mends(judged(played(rows))) if "second source" in line)
    shows(line, "192.168.1.9", HERE[0], HERE[1])


def test_fragments_matter_beyond_this_machine_only() -> None:
    large = json_poses(1.0, {f"marker {k}": {"p": [0.0, 0.0, 1.0]} for k in range(60)})
    assert len(large) > UNFRAGMENTED
    shows(text_of(judged(played(steady(large)))))
    shows(text_of(judged(played(steady(large, source=OTHER)))), "IP")
    shows(text_of(judged(played(steady(ONE, source=OTHER)))))


def test_damage_is_told_by_its_share() -> None:
    rows = [
        Datagram(one.arrival, one.source, one.payload[: -(k % 5 == 0) or None]) for k, one in enumerate(steady(ONE))
    ]
    shows_lines(mends(judged(played(rows))), "JSON", "UTF-8", 40, 200)


def test_a_rate_beyond_what_is_taken() -> None:
    shows(mends(judged(played(steady(ONE, rate=5000.0, seconds=1.0)))))


def test_what_the_kernel_lost() -> None:
    listening = played(steady(ONE))
    vars(listening.stream.receiver)["overflowed"] = 12
    assert any("lost 12 datagrams" in line for line in mends(judged(listening)))


def test_an_avatar_that_is_not_loaded() -> None:
    payload = bundle(message("/VMC/Ext/OK", "i", 0), pose("/VMC/Ext/Tra/Pos", "human://CHEST"))
    text = "vmc://:39539"
    shows(mends(judged(played(steady(payload), text=text), text=text)))


def test_noise_of_many_kinds_is_one_line() -> None:
    rows = [Datagram(k / 100, HERE, bytes([200, k, 1, 2, 3])) for k in range(200)]
    assert len(mends(judged(played(rows)))) == 1


def test_a_recording_of_another_kind_is_read_as_that() -> None:
    address = parse_address("replay://walk.raw?kind=mvn")
    (line,) = mends(sender_findings(address, "mvn", played(steady(VMC), text="mvn://:9763")))
    shows(line, "mvn://")
    assert line.endswith("Read it as replay://walk.raw?kind=vmc.")
