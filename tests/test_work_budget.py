"""No poll decodes more than its work: what is dear waits, in order; real senders never do."""

import struct
from pathlib import Path

import pytest

from live_rig import five, live_stream
from osc_bytes import bundle, message
from retarget.live.admission import Admission
from retarget.live.datagram import MOST_PER_POLL, Datagram, Source
from retarget.live.replay import ReplayReceiver
from retarget.live.stream import LiveStream
from retarget.live.work_budget import PER_BYTE, PER_DATAGRAM, PER_FRAME, WORK_PER_POLL, WorkBudget, work_of
from retarget.sources.json_pose import JsonPoseDecoder
from retarget.sources.mvn import MvnDecoder
from retarget.sources.raw_record import RawReader
from retarget.sources.stream_frame import Dropped, StreamDecoder, StreamFrame
from retarget.sources.vmc import VmcDecoder
from retarget.sources.vmc_body import VmcBodyDecoder
from retarget.sources.vrchat import VrchatDecoder
from sim.faults.sender import FakeSender

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
def test_what_is_dear_waits_in_order_and_nothing_is_lost(cost: float) -> None:
    sent, decoder = [struct.pack(">I", k) for k in range(300)], Dear(cost)
    stream, polls = hearing(sent, decoder), 0
    while len(decoder.seen) < 300:
        before = len(decoder.seen)
        stream.listen(0.01 * polls, moving=True)
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


def test_a_flood_of_the_dearest_osc_is_a_few_datagrams_a_poll() -> None:
    flood = [bundle(*[message(f"/{number}", "TTT")] * 500) for number in range(20)]
    stream = hearing(flood, VmcDecoder())
    stream.listen(0.0, moving=True)
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
        stream.listen(now, moving=True)
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
            stream.listen(0.01 * polls, moving=True)
            polls += 1
        assert polls <= 6 and stream.frames == count
