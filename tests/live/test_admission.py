"""Who may move the robot: allow-list, first source. The owner of a robot that moves stays its owner."""

from contextlib import closing
from ipaddress import IPv4Network
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from datagrams import CLOCK, LOOPBACK, arrived, sending
from retarget.live.address import parse_address
from retarget.live.admission import (
    NOT_ALLOWED,
    SECOND_SOURCE,
    Admission,
    Datagram,
    Receiver,
    Source,
    admission_for,
)
from retarget.live.raw_recording import ReplayReceiver
from retarget.live.receivers import UdpReceiver
from retarget.sources.raw_record import RawReader, RawWriter

A, B, C = ("192.168.1.20", 5000), ("192.168.1.21", 5000), ("10.9.9.9", 5000)
LAN = (IPv4Network("192.168.1.0/24"),)


def admit(admission: Admission, source: Source, now: float = 0.0, *, moving: bool = False, size: int = 100) -> bool:
    return admission.admit(Datagram(now, source, bytes(size)), now=now, moving=moving)


def owner_of(admission: Admission) -> Source | None:
    return admission.owner


def owned() -> Admission:
    admission = Admission(allow=LAN)
    assert admit(admission, A) and admission.confirm(A, now=0.0, moving=False)
    return admission


@pytest.mark.parametrize(
    ("allow", "source", "expected"),
    [
        (("192.168.1.20/32",), "192.168.1.20", True),
        (("192.168.1.20/32",), "192.168.1.21", False),
        (("10.0.0.0/8", "192.168.1.0/24"), "192.168.1.255", True),
        (("192.168.1.0/24",), "192.168.2.1", False),
        (("0.0.0.0/0",), "255.255.255.255", True),
        ((), "127.0.0.1", False),
        (("0.0.0.0/0",), "::1", False),
        (("0.0.0.0/0",), "nonsense", False),
    ],
)
def test_the_allow_list(allow: tuple[str, ...], source: str, expected: bool) -> None:
    admission = Admission(allow=map(IPv4Network, allow))
    assert admit(admission, (source, 1)) is expected
    assert admission.refused.reasons == ({} if expected else {NOT_ALLOWED: 1})


def test_the_first_source_that_can_be_decoded_owns_the_stream() -> None:
    admission = Admission(allow=LAN)
    assert admit(admission, B) and admit(admission, A)
    assert owner_of(admission) is None
    assert admission.confirm(A, now=0.0, moving=False)
    assert not admit(admission, B) and admit(admission, A)
    assert not admission.confirm(B, now=0.0, moving=False), "admitted before, in the same poll"
    assert admission.owner == A
    assert admission.refused.reasons == {SECOND_SOURCE: 2}


def test_motive_answers_from_one_port_and_sends_frames_from_another() -> None:
    admission = admission_for(parse_address("natnet://192.168.1.20"))
    answers, frames = (A[0], 1510), (A[0], 1511)
    assert admit(admission, answers) and admit(admission, frames)
    assert admission.confirm(frames, now=0.0, moving=True)
    assert admit(admission, answers, moving=True) and admit(admission, frames, moving=True)
    assert not admit(admission, B, 1e6), "no source but the server"
    assert admission.refused.reasons == {NOT_ALLOWED: 1}


def test_refused_sources_are_reported_once_and_in_bounded_number() -> None:
    admission = owned()
    for port in range(10):
        admit(admission, (B[0], 6000 + port))
        admit(admission, (C[0], 6000 + port))
    assert admission.news() == (((B[0], 6000), SECOND_SOURCE), ((C[0], 6000), NOT_ALLOWED))
    for host in range(200):
        admit(admission, (f"10.0.0.{host}", 1))
    assert len(admission.news()) == 14 and admission.news() == ()
    assert admission.refused.count == 220


EVENTS = st.lists(st.tuples(st.sampled_from([A, B, C]), st.floats(0.0, 4.0), st.booleans(), st.booleans()), max_size=60)


@given(EVENTS)
def test_no_order_of_events_gives_a_moving_robot_to_another_source(
    events: list[tuple[Source, float, bool, bool]],
) -> None:
    """Checked by a second version of the rule: the last owner, its last frame, and whether anything moves."""
    admission, now = Admission(allow=LAN), 0.0
    owner: Source | None = None
    last_frame = 0.0
    for source, step, moving, decodable in events:
        now += step
        may = source != C and (owner in (None, source) or (not moving and now - last_frame > 5.0))
        assert admit(admission, source, now, moving=moving) is may
        if may and decodable:
            assert admission.confirm(source, now=now, moving=moving)
            owner, last_frame = source, now
        assert admission.owner == owner
        assert owner != C


def test_a_recording_of_a_socket_gives_what_the_socket_gave(tmp_path: Path) -> None:
    writer = RawWriter(tmp_path / "a.raw", url="vmc://")
    with closing(UdpReceiver(LOOPBACK)) as live, sending(live) as sender:
        live.poll(CLOCK.now())
        for payload in (b"one", b"two", b"three"):
            sender.send(payload)
        live_rows = arrived(live)
    for datagram in live_rows:
        address, port = datagram.source
        writer.append(datagram.payload, time_ns=round(datagram.arrival * 1e9), address=address, port=port)
    writer.close()
    receivers: list[Receiver] = [live, ReplayReceiver(RawReader(tmp_path / "a.raw"))]
    again = receivers[1].poll(0.0) + receivers[1].poll(60.0)
    assert [datagram[1:] for datagram in again] == [datagram[1:] for datagram in live_rows]
    first = live_rows[0].arrival
    assert [d.arrival for d in again] == pytest.approx([d.arrival - first for d in live_rows], abs=1e-6)
    for receiver in receivers:
        receiver.close()
        assert receiver.poll(1e6) == [] and isinstance(receiver.dropped.count, int)
