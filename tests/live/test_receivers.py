"""Receivers over loopback, the admission of senders, and protocols by their first bytes."""

import errno
import os
import select
import socket
from collections.abc import Iterator
from contextlib import closing, contextmanager
from dataclasses import replace
from ipaddress import IPv4Network
from pathlib import Path
from unittest.mock import Mock

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hardware.clock import MonotonicClock
from messages import Facts, refuses
from mvn_packets import mvn
from natnet_packets import Motion, datagram, frame, server_info
from osc_bytes import bundle, message, pose
from retarget.errors import InputError
from retarget.live import receivers
from retarget.live.address import RECORDED, StreamAddress, local_interfaces, parse_address
from retarget.live.admission import (
    MOST_PER_POLL,
    NEW_SOCKETS,
    NOT_ALLOWED,
    SECOND_SOURCE,
    TOO_LONG,
    Admission,
    Datagram,
    Receiver,
    Source,
    admission_for,
)
from retarget.live.open_stream import open_receiver
from retarget.live.raw_recording import ReplayReceiver
from retarget.live.receivers import NatnetReceiver, UdpReceiver, open_socket
from retarget.live.stream_report import advice_for
from retarget.sources.streams.datagram_kinds import Recognised, recognise
from retarget.sources.streams.natnet_wire import MessageId, Version, split
from retarget.sources.streams.raw_record import RawReader, RawWriter
from retarget.sources.streams.stream_frame import MAX_DATAGRAM

# Real datagrams over loopback: nothing sleeps, every wait is a bounded `select`.

LOOPBACK = StreamAddress("vmc://", "vmc")
"""Loopback, at any free port."""
PATIENCE_S = 5.0
CLOCK = MonotonicClock()


@contextmanager
def sending(to: UdpReceiver) -> Iterator[socket.socket]:
    """A socket that is connected to a receiver on loopback."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
        sender.connect(("127.0.0.1", to.bound[1]))
        yield sender


def arrived(receiver: UdpReceiver) -> list[Datagram]:
    """One poll, once there is something to fetch."""
    ready, _, _ = select.select([receiver], [], [], PATIENCE_S)
    assert ready, "nothing arrived over loopback"
    return receiver.poll(CLOCK.now())


GROUP = "239.255.42.99"
UNICAST = parse_address("natnet://127.0.0.1")
MULTICAST = replace(parse_address(f"natnet://127.0.0.1?multicast={GROUP}"), port=0)
VERSION = Version(4, 1)


@contextmanager
def conversation(address: StreamAddress) -> Iterator[tuple[socket.socket, NatnetReceiver]]:
    """Motive's socket, and a receiver that asks it."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as server:
        server.bind(("127.0.0.1", 0))
        server.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_IF, socket.inet_aton("127.0.0.1"))
        server.settimeout(PATIENCE_S)
        with closing(NatnetReceiver(address, command_port=server.getsockname()[1])) as receiver:
            yield server, receiver


def question(server: socket.socket) -> tuple[int, tuple[str, int]]:
    """The kind of the next question, and the client."""
    data, client = server.recvfrom(65_536)
    parts = split(data)
    assert parts is not None
    return parts[0], client


def received(receiver: NatnetReceiver, count: int) -> list[Datagram]:
    """Polls until `count` datagrams came."""
    found: list[Datagram] = []
    while len(found) < count:
        assert select.select(receiver._sockets, [], [], PATIENCE_S)[0], "nothing arrived over loopback"
        found += receiver.poll(CLOCK.now())
    return found


def test_unicast_goes_through_one_socket() -> None:
    with conversation(UNICAST) as (server, receiver):
        assert receiver.poll(CLOCK.now()) == []
        kind, client = question(server)
        assert kind == MessageId.CONNECT and client == ("127.0.0.1", receiver.bound[1])
        server.sendto(server_info(VERSION), client)
        assert len(received(receiver, 1)) == 1 and receiver.session.server is not None
        receiver.poll(CLOCK.now())
        assert {question(server)[0] for _ in range(2)} == {MessageId.DEFINITIONS_REQUEST, MessageId.KEEP_ALIVE}
        server.sendto(frame(Motion(), VERSION), client)
        assert [datagram.payload for datagram in received(receiver, 1)] == [frame(Motion(), VERSION)]
        assert receiver.session.frames == 1 and receiver.dropped.count == receiver.overflowed == 0


def test_frames_come_through_the_group() -> None:
    with conversation(MULTICAST) as (server, receiver):
        server.sendto(frame(Motion(), VERSION), (GROUP, receiver._sockets[1].bound[1]))
        if not select.select([receiver._sockets[1]], [], [], PATIENCE_S / 5)[0]:
            pytest.skip("this kernel delivers no multicast over loopback")
        assert [datagram.payload for datagram in received(receiver, 1)] == [frame(Motion(), VERSION)]
        assert receiver.session.frames == 1


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("vmc://", UdpReceiver),
        ("vrchat://", UdpReceiver),
        ("json://:7000", UdpReceiver),
        ("mvn://", UdpReceiver),
        ("natnet://127.0.0.1", NatnetReceiver),
        ("natnet://127.0.0.1?multicast=239.255.42.99", NatnetReceiver),
        ("replay://FILE", ReplayReceiver),
    ],
)
def test_an_address_finds_its_receiver(text: str, expected: type, tmp_path: Path) -> None:
    RawWriter(tmp_path / "a.raw", url="vmc://").close()
    address = replace(parse_address(text.replace("FILE", str(tmp_path / "a.raw"))), port=0)
    receiver = open_receiver(address)
    assert isinstance(receiver, expected)
    assert receiver.poll(0.0) == []
    receiver.close()


def test_datagrams_come_in_order_with_source_and_time_also_the_longest_but_no_empty_one() -> None:
    longest = 65_507  # of UDP over IPv4
    with closing(UdpReceiver(LOOPBACK)) as receiver, sending(receiver) as sender:
        assert receiver.poll(CLOCK.now()) == []
        before = CLOCK.now()
        for payload in (b"one", b"two", b"three"):
            sender.send(payload)
        found = arrived(receiver)
        after = CLOCK.now()
        assert [datagram.payload for datagram in found] == [b"one", b"two", b"three"]
        assert {datagram.source for datagram in found} == {sender.getsockname()}
        times = [datagram.arrival for datagram in found]
        assert times == sorted(times) and before - 0.001 <= times[0] and times[-1] <= after
        assert receiver.poll(CLOCK.now()) == [] and receiver.dropped.count == receiver.overflowed == 0
        sender.send(bytes(longest))
        assert [len(datagram.payload) for datagram in arrived(receiver)] == [longest]
        for size in (100, 0, 99):
            sender.send(bytes(size))
        assert [len(datagram.payload) for datagram in arrived(receiver)] == [100, 99]
        assert receiver.dropped.reasons == {"empty datagram": 1}


def test_a_poll_is_bounded_and_the_rest_waits() -> None:
    with closing(UdpReceiver(LOOPBACK)) as receiver, sending(receiver) as sender:
        for number in range(MOST_PER_POLL + 20):
            sender.send(number.to_bytes(2))
        polls = arrived(receiver), arrived(receiver)
        assert [len(datagrams) for datagrams in polls] == [MOST_PER_POLL, 20]
        numbers = [int.from_bytes(datagram.payload) for datagrams in polls for datagram in datagrams]
        assert numbers == list(range(MOST_PER_POLL + 20))


def test_the_arrival_is_the_kernels_not_that_of_the_poll() -> None:
    with closing(UdpReceiver(LOOPBACK)) as receiver, sending(receiver) as sender:
        for _ in range(50):  # a kernel may switch its stamps on a moment after the first socket wants them
            receiver.poll(CLOCK.now())
            sender.send(b"x")
            now = CLOCK.now() + 0.5
            (datagram,) = receiver.poll(now)
            if datagram.arrival < now - 0.4:
                return
    pytest.skip("this kernel gives no times of arrival")


def test_what_the_kernel_lost_is_counted(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(receivers, "RECEIVE_BUFFER", 8192)
    with closing(UdpReceiver(LOOPBACK)) as receiver, sending(receiver) as sender:
        for _ in range(200):
            sender.send(bytes(1000))
        kept = len(arrived(receiver))
        sender.send(b"x")  # the count travels with what comes after the loss
        assert len(arrived(receiver)) == 1
        assert 0 < kept < 200 and receiver.overflowed == 200 - kept


ABSENT = "203.0.113.77"
"""Of a network that is reserved for documents: no interface has it."""


def test_a_port_that_is_taken_names_its_holder_and_an_absent_interface_those_that_are_there() -> None:
    with closing(UdpReceiver(LOOPBACK)) as first, refuses(InputError, os.getpid()):
        open_socket(replace(LOOPBACK, port=first.bound[1]))
    for text in (f"vmc://{ABSENT}:39539?allow=any", f"natnet://127.0.0.1?multicast={GROUP}&interface={ABSENT}"):
        with refuses(InputError, ABSENT, "127.0.0.1"):
            open_socket(parse_address(text))


@pytest.mark.parametrize(
    ("number", "expected"), [(errno.EACCES, ()), (errno.EINVAL, "127.0.0.1:0"), (errno.ENOBUFS, ())]
)
def test_other_reasons_not_to_bind(number: int, expected: Facts, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(socket.socket, "bind", Mock(side_effect=OSError(number, os.strerror(number))))
    with refuses(InputError, expected):
        open_socket(LOOPBACK)


@pytest.mark.parametrize(
    ("host", "number", "expected"),
    [
        ("127.0.0.1", errno.ENOBUFS, GROUP),
        ("127.0.0.1", errno.ENODEV, "127.0.0.1"),
        ("255.255.255.255", errno.ENODEV, (GROUP, "interface=ADDRESS")),
    ],
)
def test_reasons_not_to_join(host: str, number: int, expected: Facts, monkeypatch: pytest.MonkeyPatch) -> None:
    real = socket.socket.setsockopt

    def refuse(self: socket.socket, level: int, option: int, value: int | bytes) -> None:
        if option == socket.IP_ADD_MEMBERSHIP and level == socket.IPPROTO_IP:
            raise OSError(number, os.strerror(number))
        real(self, level, option, value)

    monkeypatch.setattr(socket.socket, "setsockopt", refuse)
    address = replace(parse_address(f"natnet://{host}?multicast={GROUP}"), port=0)
    with refuses(InputError, expected):
        open_socket(address)


def test_a_group_is_not_received_on_an_interface_that_was_not_chosen() -> None:
    others = [address for address in local_interfaces().values() if not address.startswith("127.")]
    if not others:
        pytest.skip("this machine has loopback only")
    with closing(UdpReceiver(MULTICAST)) as chosen, socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
        sender.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_IF, socket.inet_aton(others[0]))
        with closing(UdpReceiver(replace(MULTICAST, port=chosen.bound[1], interface=others[0]))) as other:
            try:
                sender.sendto(b"frame", (GROUP, chosen.bound[1]))
            except OSError as error:
                pytest.skip(f"no multicast over {others[0]}: {error}")
            if not select.select([other], [], [], PATIENCE_S / 5)[0]:
                pytest.skip(f"this kernel delivers no multicast of its own over {others[0]}")
            assert [datagram.payload for datagram in other.poll(CLOCK.now())] == [b"frame"]
            assert chosen.poll(CLOCK.now()) == []


def test_nothing_stays_open_after_a_refusal(monkeypatch: pytest.MonkeyPatch) -> None:
    opened: list[socket.socket] = []

    def interrupted(self: socket.socket, _: object) -> None:
        opened.append(self)
        raise KeyboardInterrupt

    monkeypatch.setattr(socket.socket, "bind", interrupted)
    with pytest.raises(KeyboardInterrupt):
        open_socket(LOOPBACK)
    assert opened[0].fileno() == -1


# Admission: allow-list, first source. The owner of a robot that moves stays its owner.

A, B, C = ("192.168.1.20", 5000), ("192.168.1.21", 5000), ("10.9.9.9", 5000)
LAN = (IPv4Network("192.168.1.0/24"),)


def admit(admission: Admission, source: Source, now: float = 0.0, *, moving: bool = False, size: int = 100) -> bool:
    return admission.admit(Datagram(now, source, bytes(size)), now=now, moving=moving)


@pytest.mark.parametrize("size", [0, MAX_DATAGRAM + 1])
def test_a_datagram_of_no_possible_size_is_refused(size: int) -> None:
    admission = owned()
    assert not admit(admission, A, size=size) and admission.refused.reasons == {TOO_LONG: 1}


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
    assert admission.owner != A and admission.owner != B
    assert admission.confirm(A, now=0.0, moving=False)
    assert not admit(admission, B) and admit(admission, A)
    assert not admission.confirm(B, now=0.0, moving=False), "admitted before, in the same poll"
    assert admission.owner == A
    assert admission.refused.reasons == {SECOND_SOURCE: 2}


def test_a_sender_with_a_new_socket_for_each_datagram_differs_from_a_second_one() -> None:
    admission, host = owned(), A[0]
    for port in [7000] * 20 + [*range(7000, 7010)]:
        assert not admit(admission, (host, port))
    assert admission.refused.reasons == {SECOND_SOURCE: 23, NEW_SOCKETS: 7}
    assert admission.confirm((host, 7009), now=9.0, moving=False)
    for restart in range(10):  # of the sender: each has one new socket, for long
        assert not admit(admission, (host, 8000 + restart), 9.0 + 0.4 * restart)
    assert admission.refused.reasons == {SECOND_SOURCE: 33, NEW_SOCKETS: 7}


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
    for row in live_rows:
        address, port = row.source
        writer.append(row.payload, time_ns=round(row.arrival * 1e9), address=address, port=port)
    writer.close()
    receivers: list[Receiver] = [live, ReplayReceiver(RawReader(tmp_path / "a.raw"))]
    again = receivers[1].poll(0.0) + receivers[1].poll(60.0)
    assert [datagram[1:] for datagram in again] == [datagram[1:] for datagram in live_rows]
    first = live_rows[0].arrival
    assert [d.arrival for d in again] == pytest.approx([d.arrival - first for d in live_rows], abs=1e-6)
    for receiver in receivers:
        receiver.close()
        assert receiver.poll(1e6) == [] and isinstance(receiver.dropped.count, int)


# Protocols by their first bytes.

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
def test_each_at_the_address_of_each(kind: str) -> None:
    for other in RECORDED:
        advice = advice_for(kind, Recognised(other, other.upper()), port=5000)
        own = kind == other or (kind, other) == ("web", "json")  # a headset on the page sends poses as JSON
        assert (not advice) if own else f"{other}://" in advice


@pytest.mark.parametrize(
    ("kind", "got", "part"),
    [
        ("mvn", Recognised("mvn", "MVN", "type 05, Unity poses"), "Quaternion"),
        ("mvn", Recognised("mvn", "MVN", "type 12, names"), ""),
        ("json", Recognised("json", "poses as JSON", "no axes"), "rep103, unity"),
        ("vmc", Recognised("vmc", "VMC", "no poses"), "Load an avatar"),
        ("natnet", Recognised("natnet", "NatNet", "connect"), "another client"),
        ("vmc", Recognised("", "mocopi"), "MCP2VMCP"),
        ("vmc", Recognised("", "damaged OSC", "x"), "VMC output"),
        ("vmc", Recognised("", "an unknown protocol"), "which program"),
    ],
)
def test_the_next_step_is_named(kind: str, got: Recognised, part: str) -> None:
    advice = advice_for(kind, got, port=1)
    assert part in advice and bool(part) == bool(advice)
