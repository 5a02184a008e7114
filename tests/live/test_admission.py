"""Who may move the robot: allow-list, first source, rate. The owner of a robot that moves stays its owner."""

import struct
from ipaddress import IPv4Network
from itertools import accumulate
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from datagrams import CLOCK, LOOPBACK, arrived, sending
from live_rig import five, live_stream
from messages import refuses
from osc_bytes import bundle, message
from retarget.live.address import parse_address
from retarget.live.admission import (
    BURST,
    MOST_PER_POLL,
    NOT_ALLOWED,
    PER_BYTE,
    PER_DATAGRAM,
    PER_FRAME,
    RATE,
    SECOND_SOURCE,
    TOO_LONG,
    TOO_MANY,
    WORK_PER_POLL,
    Admission,
    Datagram,
    Receiver,
    Source,
    TokenBucket,
    WorkBudget,
    admission_for,
    work_of,
)
from retarget.live.raw_recording import ReplayReceiver
from retarget.live.stream import LiveStream
from retarget.live.udp import UdpReceiver
from retarget.sources.json_pose import JsonPoseDecoder
from retarget.sources.mvn import MvnDecoder
from retarget.sources.raw_record import RawReader, RawWriter
from retarget.sources.stream_frame import Dropped, StreamDecoder, StreamFrame
from retarget.sources.vmc import VmcBodyDecoder, VmcDecoder
from retarget.sources.vrchat import VrchatDecoder
from sim.faults.sender import FakeSender

A, B, C = ("192.168.1.20", 5000), ("192.168.1.21", 5000), ("10.9.9.9", 5000)
LAN = (IPv4Network("192.168.1.0/24"),)


def admit(admission: Admission, source: Source, now: float = 0.0, *, moving: bool = False, size: int = 100) -> bool:
    return admission.admit(Datagram(now, source, bytes(size)), now=now, moving=moving)


def owner_of(admission: Admission) -> Source | None:
    return admission.owner


def owned(**options: float | None) -> Admission:
    admission = Admission(allow=LAN, **options)  # type: ignore[arg-type]
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


def test_another_port_of_the_same_computer_is_another_source() -> None:
    assert not admit(owned(), (A[0], A[1] + 1))


def test_motive_answers_from_one_port_and_sends_frames_from_another() -> None:
    admission = admission_for(parse_address("natnet://192.168.1.20"))
    answers, frames = (A[0], 1510), (A[0], 1511)
    assert admit(admission, answers) and admit(admission, frames)
    assert admission.confirm(frames, now=0.0, moving=True)
    assert admit(admission, answers, moving=True) and admit(admission, frames, moving=True)
    assert not admit(admission, B, 1e6), "no source but the server"
    assert admission.refused.reasons == {NOT_ALLOWED: 1}


def test_the_lock_on_a_computer_keeps_the_others_out() -> None:
    admission = Admission(allow=LAN, source="computer")
    assert admission.confirm(A, now=0.0, moving=False)
    assert not admit(admission, B) and admit(admission, (A[0], 1)) and not admit(admission, B)


def test_the_admission_of_an_address_is_its_list() -> None:
    admission = admission_for(parse_address("vmc://0.0.0.0?allow=192.168.1.0/24"))
    assert admit(admission, A) and not admit(admission, C)
    assert admission.confirm(A, now=0.0, moving=False) and not admit(admission, (A[0], 1))


def test_silence_frees_the_stream_only_when_nothing_moves() -> None:
    admission = owned(release_after=5.0)
    assert not admit(admission, B, 5.0)
    assert not admit(admission, B, 1e6, moving=True)
    assert admit(admission, B, 5.1)
    assert admission.owner == A, "what makes no sense takes nothing over"
    assert not admission.confirm(B, now=5.1, moving=True) and admission.owner == A
    assert admission.confirm(B, now=5.1, moving=False) and admission.owner == B
    assert not admit(admission, A, 5.2)


def test_a_source_that_sends_only_garbage_does_not_keep_the_stream() -> None:
    admission = owned(release_after=5.0)
    assert all(admit(admission, A, float(now)) for now in range(6))
    assert admit(admission, B, 5.1)


def test_frames_keep_the_stream() -> None:
    admission = owned(release_after=5.0)
    assert admission.confirm(A, now=4.0, moving=False)
    assert not admit(admission, B, 8.9) and admit(admission, B, 9.1)


def test_without_a_time_nothing_frees_the_stream() -> None:
    assert not admit(owned(release_after=None), B, 1e9)


def test_what_others_send_costs_the_owner_nothing() -> None:
    admission = owned(rate=1.0, burst=2.0)
    for _ in range(1000):
        assert not admit(admission, B) and not admit(admission, C)
    assert admit(admission, A)
    assert not admit(admission, A) and admission.refused.reasons[TOO_MANY] == 1
    assert admission.refused.reasons[SECOND_SOURCE] == admission.refused.reasons[NOT_ALLOWED] == 1000


@pytest.mark.parametrize("rate", [232.0, 750.0])
def test_real_senders_stay_below_the_rate_also_after_the_link_hung(rate: float) -> None:
    admission = owned()
    arrivals = [max(5.25, k / rate) if k / rate > 5.0 else k / rate for k in range(int(20 * rate))]
    assert all(admit(admission, A, now, moving=True) for now in arrivals)


@pytest.mark.parametrize(("size", "expected"), [(0, False), (1, True), (65_536, True), (65_537, False)])
def test_length(size: int, expected: bool) -> None:
    admission = Admission()
    assert admit(admission, A, size=size) is expected
    assert admission.refused.reasons == ({} if expected else {TOO_LONG: 1})


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


@pytest.mark.parametrize("options", [{"release_after": -1.0}, {"release_after": float("nan")}, {"rate": 0.0}])
def test_options_out_of_range_are_refused(options: dict[str, float]) -> None:
    with refuses(ValueError):
        Admission(**options)  # type: ignore[arg-type]


EVENTS = st.lists(st.tuples(st.sampled_from([A, B, C]), st.floats(0.0, 4.0), st.booleans(), st.booleans()), max_size=60)


@given(EVENTS)
def test_no_order_of_events_gives_a_moving_robot_to_another_source(
    events: list[tuple[Source, float, bool, bool]],
) -> None:
    """Checked by a second version of the rule: the last owner, its last frame, and whether anything moves."""
    admission, now = Admission(allow=LAN, release_after=5.0), 0.0
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


@given(st.lists(st.tuples(st.sampled_from([A, B, C]), st.floats(0.0, 0.01)), max_size=200))
def test_every_datagram_is_admitted_or_counted(arrivals: list[tuple[Source, float]]) -> None:
    admission, now, admitted = Admission(allow=LAN, rate=100.0, burst=5), 0.0, 0
    for source, step in arrivals:
        now += step
        admitted += admit(admission, source, now)
    assert admitted + admission.refused.count == len(arrivals)
    assert admitted <= 5 + 100.0 * now + 1e-6


def test_the_defaults_bound_the_work_of_a_second() -> None:
    admission = Admission()
    admitted = sum(admit(admission, A, k / 130_000) for k in range(130_000))
    assert BURST <= admitted <= RATE + BURST


def test_a_recording_of_a_socket_gives_what_the_socket_gave(tmp_path: Path) -> None:
    writer = RawWriter(tmp_path / "a.raw", url="vmc://")
    with UdpReceiver(LOOPBACK) as live, sending(live) as sender:
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


def test_a_datagram_is_a_plain_row() -> None:
    arrival, source, payload = Datagram(1.0, ("127.0.0.1", 5), b"x")
    assert (arrival, source, payload) == (1.0, ("127.0.0.1", 5), b"x")


STEPS = st.lists(st.floats(0.0, 0.5) | st.just(0.0), min_size=1, max_size=120)


@given(STEPS, st.floats(0.5, 200.0), st.integers(1, 20))
def test_no_stretch_of_time_holds_more_than_the_burst_and_the_rate(steps: list[float], rate: float, burst: int) -> None:
    bucket = TokenBucket(rate=rate, burst=burst)
    taken = [now for now in accumulate(steps) if bucket.take(now)]
    for first, start in enumerate(taken):
        for last in range(first, len(taken)):
            assert last - first + 1 <= burst + rate * (taken[last] - start) + 1e-6


@given(st.floats(1.0, 500.0), st.integers(1, 20))
def test_what_keeps_to_the_rate_is_never_refused(rate: float, burst: int) -> None:
    bucket = TokenBucket(rate=rate, burst=burst)
    assert all(bucket.take(k * 1.0001 / rate) for k in range(200))


def test_a_full_bucket_gives_its_burst_and_not_one_more() -> None:
    bucket = TokenBucket(rate=10.0, burst=3)
    assert [bucket.take(5.0) for _ in range(4)] == [True, True, True, False]
    assert [bucket.take(5.15), bucket.take(5.15)] == [True, False]
    assert [bucket.take(1e6) for _ in range(4)] == [True, True, True, False]


def test_time_that_goes_back_gives_nothing() -> None:
    bucket = TokenBucket(rate=10.0, burst=1)
    assert bucket.take(100.0)
    assert not bucket.take(50.0) and not bucket.take(100.05) and bucket.take(100.2)


@pytest.mark.parametrize(("rate", "burst"), [(0.0, 1), (-1.0, 1), (float("nan"), 1), (float("inf"), 1), (1.0, 0)])
def test_a_bucket_that_means_nothing_is_refused(rate: float, burst: int) -> None:
    with refuses(ValueError):
        TokenBucket(rate=rate, burst=burst)


SENDER: Source = ("127.0.0.1", 40_000)


class Queue:
    """A Receiver of what waits in a kernel."""

    def __init__(self, payloads: list[bytes]) -> None:
        self.dropped = Dropped()
        self.waiting = [Datagram(0.0, SENDER, payload) for payload in payloads]

    finished = False

    def poll(self, now: float) -> list[Datagram]:
        taken, self.waiting = self.waiting[:MOST_PER_POLL], self.waiting[MOST_PER_POLL:]
        return taken

    def close(self) -> None:
        """Nothing is open."""


class Dear:
    """A decoder of which each datagram costs so much; what it decoded, in order."""

    def __init__(self, cost: float) -> None:
        self.dropped, self.work, self.seen, self._cost = Dropped(), 0.0, list[bytes](), cost

    def decode(self, datagram: bytes) -> list[StreamFrame]:
        self.work += self._cost
        self.seen.append(datagram)
        return []


def hearing(payloads: list[bytes], decoder: StreamDecoder) -> LiveStream:
    stream = live_stream(FakeSender(), five())
    stream.receiver, stream.decoder = Queue(payloads), decoder
    stream.admission = Admission(burst=10_000)
    return stream


@pytest.mark.parametrize("cost", [0.0, 100.0, 700.0, 1e6])
def test_what_costs_much_waits_in_order_and_nothing_is_lost(cost: float) -> None:
    sent, decoder = [struct.pack(">I", k) for k in range(300)], Dear(cost)
    stream, polls = hearing(sent, decoder), 0
    while len(decoder.seen) < 300:
        before = len(decoder.seen)
        stream.poll(0.01 * polls, moving=True)
        polls += 1
        done = len(decoder.seen) - before
        assert 0 < done <= MOST_PER_POLL and (done - 1) * cost < WORK_PER_POLL and stream.waiting < MOST_PER_POLL
    assert decoder.seen == sent and stream.arrived == 300
    assert polls == {0.0: 5, 100.0: 14, 700.0: 61, 1e6: 300}[cost]


def test_what_counts() -> None:
    budget = WorkBudget()
    budget.charge(b"x" * 400, frames=2, work=7.0)
    assert not budget.spent
    budget.charge(b"", frames=0, work=WORK_PER_POLL - 2 * PER_DATAGRAM - 400 * PER_BYTE - 2 * PER_FRAME - 7.1)
    assert not budget.spent
    budget.charge(b"", frames=0, work=0.0)
    assert budget.spent


@pytest.mark.parametrize("decoder", [VmcDecoder(), VrchatDecoder(), VmcBodyDecoder(), JsonPoseDecoder()])
def test_decoders_that_some_datagrams_cost_more_count_it(decoder: StreamDecoder) -> None:
    many = b'{"poses": [' + b"{}," * 1000 + b"{}]}"
    payload = many if isinstance(decoder, JsonPoseDecoder) else bundle(*[message("/x", "TTT")] * 400)
    decoder.decode(payload)
    assert work_of(decoder) > 300.0
    assert work_of(MvnDecoder()) == 0.0


def test_a_flood_of_the_costliest_osc_is_a_few_datagrams_a_poll() -> None:
    flood = [bundle(*[message(f"/{number}", "TTT")] * 500) for number in range(20)]
    stream = hearing(flood, VmcDecoder())
    stream.poll(0.0, moving=True)
    assert 1 <= stream.arrived <= 3 and stream.waiting == 20 - stream.arrived


@pytest.mark.parametrize(("name", "decoder"), [("vmc_50hz", VmcDecoder), ("vrcosc_20hz", VrchatDecoder)])
@pytest.mark.parametrize("speed", [1.0, 5.0])
def test_a_real_sender_never_waits(
    name: str, decoder: type[VmcDecoder | VrchatDecoder], speed: float, shared: Path
) -> None:
    recording = RawReader(shared / f"streams/slimevr/full12_{name}.udprec.gz")
    stream, now = hearing([], decoder()), 0.0
    stream.receiver = ReplayReceiver(recording, speed=speed)
    while not stream.receiver.finished:
        now += 0.01
        stream.poll(now, moving=True)
        assert stream.waiting == 0
    assert stream.frames > 250 and stream.admission.refused.count == 0


def test_what_waited_a_quarter_of_a_second_is_taken_in_a_few_ticks(shared: Path) -> None:
    """MVN at 240 Hz, and SlimeVR's VMC at its 232 Hz, after the link hung."""
    mvn = (shared / "streams/mxtp02_tpose.bin").read_bytes()
    vmc = (shared / "streams/slimevr/one_bundle_pose_left_arm_T_right_elbow90_left_hip60.bin").read_bytes()
    for payload, count, decoder in ((mvn, 60, MvnDecoder()), (vmc, 58, VmcDecoder())):
        stream = hearing([payload] * count, decoder)
        polls = 0
        while stream.arrived < count:
            stream.poll(0.01 * polls, moving=True)
            polls += 1
        assert polls <= 6 and stream.frames == count
