"""Protocols by their first bytes."""

from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mvn_packets import mvn
from natnet_packets import datagram
from osc_bytes import bundle, message, pose
from retarget.live.address import RECORDED
from retarget.live.datagram_kinds import Recognised, advice_for, recognise

CASES = [
    (bundle(pose("/VMC/Ext/Tra/Pos", "human://CHEST")), "vmc", "VMC"),
    (bundle(pose("/VMC/Ext/Bone/Pos", "Hips")), "vmc", "VMC (bones only)"),
    (message("/VMC/Ext/OK", "i", 1), "vmc", "VMC (no poses)"),
    (message("/tracking/trackers/1/position", "fff", 0.0, 1.0, 0.0), "vrchat", "VRChat OSC trackers"),
    (message("/avatar/parameters/Grounded", "T"), "", "VRChat OSC (avatar parameters, no trackers)"),
    (message("/fader/1", "f", 0.5), "", "OSC (address '/fader/1')"),
    (b"#bundle\0", "", "damaged OSC (size of an OSC element does not fit its datagram)"),
    (mvn("02", b""), "mvn", "MVN"),
    (mvn("05", b""), "mvn", "MVN (type 05, Unity poses)"),
    (mvn("77", b""), "mvn", "MVN (type 77, unknown)"),
    (b"MXTPxx", "", "damaged MVN"),
    (b'{"axes": "rep103", "poses": {}}', "json", "poses as JSON"),
    (b'{"axes": "blender", "poses": {}}', "json", "poses as JSON (axes 'blender')"),
    (b'{"poses": {}}', "json", "poses as JSON (no axes)"),
    (b'{"version": "3,0", "scene": {}}', "", "Rokoko Studio (JSON)"),
    (b'{"hello": 1}', "", "JSON (without poses)"),
    (b'{"hello"', "", "damaged JSON"),
    (b"[1]", "", "JSON (no object)"),
    (b"[" * 60_000, "", "damaged JSON"),
    (b"\x04\x22\x4d\x18....", "", "Rokoko Studio (JSON in LZ4)"),
    (b"\xff\xdd" + bytes(62), "", "Axis Studio (Perception Neuron) (BVH broadcast)"),
    (b"\x20\0\0\0head" + bytes(24), "", "mocopi"),
    (datagram(7, bytes(40)), "natnet", "NatNet"),
    (datagram(0, bytes(264)), "natnet", "NatNet (connect)"),
    (datagram(7, bytes(40))[:-1], "", "an unknown protocol (begins with 07 00 28 00 00 00 00 00)"),
    (b"", "", "an unknown protocol (empty)"),
]


@pytest.mark.parametrize(("payload", "kind", "text"), CASES, ids=[case[2] for case in CASES])
def test_each_is_known(payload: bytes, kind: str, text: str) -> None:
    got = recognise(payload)
    assert (got.kind, got.text) == (kind, text)


@settings(max_examples=100)
@given(st.one_of(st.binary(max_size=200), st.sampled_from([case[0] for case in CASES])), st.binary(max_size=30))
def test_nothing_raises_and_what_is_shown_is_short(head: bytes, tail: bytes) -> None:
    for payload in (head + tail, head[: len(tail)], b"{" + tail, b"/" + head, b"MXTP" + tail):
        assert len(recognise(payload).text) < 200


@pytest.mark.parametrize(
    ("path", "kind"),
    [
        ("mxtp02_tpose.bin", "mvn"),
        ("natnet/mocapframe_packet_v3.bin", "natnet"),
        ("natnet/serverinfo_packet_v3.bin", "natnet"),
        ("osc/pythonosc_vmc_bundle.bin", "vmc"),
        ("osc/vmcp_1.0.6_single_bone.bin", "vmc"),
        ("osc/pythonosc_vrchat_tracker1_rot.bin", "vrchat"),
        ("slimevr/one_vrchat_osc_bundle.bin", "vrchat"),
    ],
)
def test_real_bytes(shared: Path, path: str, kind: str) -> None:
    assert recognise((shared / "streams" / path).read_bytes()).kind == kind


@pytest.mark.parametrize("kind", RECORDED)
@pytest.mark.parametrize("other", RECORDED)
def test_each_at_the_address_of_each(kind: str, other: str) -> None:
    advice = advice_for(kind, Recognised(other, other.upper()), port=5000)
    assert (not advice) if kind == other else f"{other}://" in advice


@pytest.mark.parametrize(
    ("kind", "got", "part"),
    [
        ("mvn", Recognised("mvn", "MVN", "type 05, Unity poses"), "Quaternion"),
        ("mvn", Recognised("mvn", "MVN", "type 12, names"), ""),
        ("json", Recognised("json", "poses as JSON", "no axes"), "rep103, unity"),
        ("vmc", Recognised("vmc", "VMC", "bones only"), "--performer avatar"),
        ("vmc", Recognised("vmc", "VMC", "no poses"), "Load an avatar"),
        ("natnet", Recognised("natnet", "NatNet", "connect"), "another client"),
        ("vmc", Recognised("", "mocopi"), "MCP2VMCP"),
        ("vmc", Recognised("", "damaged OSC", "x"), "VMC output"),
        ("vmc", Recognised("", "an unknown protocol"), "which program"),
    ],
)
def test_the_cure_is_named(kind: str, got: Recognised, part: str) -> None:
    advice = advice_for(kind, got, port=1)
    assert part in advice and bool(part) == bool(advice)
