"""From an address to findings."""

import socket
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from doctor_rig import HERE, heard, json_poses, judged, mends, played, text_of
from hardware.clock import MonotonicClock, VirtualClock
from live_rig import five
from mvn_packets import quaternions, standing
from natnet_packets import Motion, Pose, frame
from osc_bytes import bundle, message, pose
from retarget.doctor.stream_findings import stream_findings
from retarget.errors import InputError
from retarget.live.address import parse_address
from retarget.live.datagram import Datagram
from retarget.sources.natnet_wire import Version
from support.messages import refuses, shows


def test_a_sound_stream_has_nothing_to_mend() -> None:
    found = judged(heard())
    assert not mends(found), text_of(found)
    assert {"stream", "rate", "jitter", "clock", "sensors"} <= {finding.subject for finding in found}


@pytest.mark.parametrize(
    ("name", "kind", "wrong"),
    [("full12_vmc_50hz", "vmc", []), ("full12_vrcosc_20hz", "vrchat", ["rate", "sensors"])],
)
def test_real_recordings(shared: Path, name: str, kind: str, wrong: list[str]) -> None:
    address = parse_address(f"replay://{shared}/streams/slimevr/{name}.udprec.gz?kind={kind}")
    found = stream_findings(address, five(), clock=VirtualClock(), seconds=6.0)
    assert [line.split(":")[0].split()[1] for line in mends(found)] == wrong


def test_a_recording_of_another_kind(shared: Path) -> None:
    address = parse_address(f"replay://{shared}/streams/slimevr/full12_vmc_50hz.udprec.gz?kind=mvn")
    (line,) = mends(stream_findings(address, five(), clock=VirtualClock(), seconds=3.0))
    shows(line, "VMC", "mvn://")


def test_no_such_recording_is_a_bad_argument() -> None:
    with refuses(InputError):
        stream_findings(parse_address("replay://nope?kind=vmc"), five(), clock=VirtualClock(), seconds=1.0)


def test_a_port_that_is_taken_is_to_be_mended() -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as holder:
        holder.bind(("127.0.0.1", 0))
        address = parse_address(f"vmc://:{holder.getsockname()[1]}")
        found = stream_findings(address, five(), clock=MonotonicClock(), seconds=1.0)
    shows(mends(found)[0])


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
def test_whatever_comes_is_judged(changes: list[tuple[int, float, int, bytes]], text: str) -> None:
    rows, time = list[Datagram](), 0.0
    for which, gap, at, new in changes:
        time += gap
        payload = SEEDS[which][:at] + new + SEEDS[which][at + len(new) :]
        rows.append(Datagram(time, HERE, payload))
    for finding in judged(played(rows, text=text, seconds=time + 0.1), text=text):
        assert finding.render().isprintable() and len(finding.render()) < 2000
