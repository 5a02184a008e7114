"""A run that falls behind takes the newest data: its latency is bounded, and so is the work of a poll."""

import json
from pathlib import Path

import numpy as np
import pytest

from hardware.clock import thread_cpu
from hardware.guard import CheckedGoal
from live_rig import LiveRig, live_stream
from live_rig import five as five_sensors
from retarget.live.admission import MOST_PER_POLL, TOO_MANY, Datagram, Source
from retarget.live.begin import LiveOptions
from retarget.live.raw_recording import ReplayReceiver
from retarget.live.stream import MOST_DECODED, LiveStream
from retarget.schema.performer import load_performer
from retarget.sources.json_pose import JsonPoseDecoder
from retarget.sources.raw_record import RawReader
from retarget.sources.stream_frame import Dropped, StreamDecoder, StreamFrame
from retarget.sources.vmc import VmcDecoder
from retarget.sources.vrchat import VrchatDecoder
from sim.faults.inject import FLOOD_HZ
from sim.faults.sender import FakeSender


class Queue:
    """A receiver of what waits in a kernel."""

    finished = False

    def __init__(self, payloads: list[bytes]) -> None:
        self.dropped = Dropped()
        self.waiting = [Datagram(0.001 * k, ("127.0.0.1", 4), payload) for k, payload in enumerate(payloads)]

    def poll(self, now: float) -> list[Datagram]:
        taken, self.waiting = self.waiting[:MOST_PER_POLL], self.waiting[MOST_PER_POLL:]
        return taken

    def close(self) -> None:
        """Nothing is open."""


class Seen:
    """A decoder of nothing; what it was given, in order."""

    def __init__(self) -> None:
        self.dropped, self.given = Dropped(), list[bytes]()

    def decode(self, datagram: bytes) -> list[StreamFrame]:
        self.given.append(datagram)
        return []


def polling(payloads: list[bytes], decoder: StreamDecoder) -> LiveStream:
    stream = live_stream(FakeSender(), five_sensors())
    stream.receiver, stream.decoder = Queue(payloads), decoder
    return stream


@pytest.mark.parametrize("count", [1, MOST_DECODED, 300])
def test_the_newest_datagrams_of_a_backlog_are_decoded_at_once(count: int) -> None:
    sent, decoder = [json.dumps(k).encode() for k in range(count)], Seen()
    stream = polling(sent, decoder)
    stream.poll(1.0, moving=True)
    assert decoder.given == sent[-MOST_DECODED:] and stream.arrived == count
    assert stream.admission.refused.reasons[TOO_MANY] == max(0, count - MOST_DECODED)


@pytest.mark.parametrize(("name", "decoder"), [("vmc_50hz", VmcDecoder), ("vrcosc_20hz", VrchatDecoder)])
@pytest.mark.parametrize("speed", [1.0, 5.0])
def test_nothing_of_a_real_sender_is_dropped(
    name: str, decoder: type[VmcDecoder | VrchatDecoder], speed: float, shared: Path
) -> None:
    stream, now = polling([], decoder()), 0.0
    stream.receiver = ReplayReceiver(RawReader(shared / f"streams/slimevr/full12_{name}.udprec.gz"), speed=speed)
    while not stream.receiver.finished:
        now += 0.01
        stream.poll(now, moving=True)
    assert stream.frames > 250 and stream.admission.refused.count == 0


def test_a_second_of_powering_reports_no_lost_sensors(monkeypatch: pytest.MonkeyPatch) -> None:
    rig = LiveRig(FakeSender(), options=LiveOptions(countdown=0.5, duration=0.5))
    with rig.prepared() as prepared:
        assert prepared.machine is not None
        arm, guard = prepared.machine.guard.arm, prepared.machine.guard

        def slowly(goal: CheckedGoal) -> None:
            arm(goal)
            rig.clock.sleep_until(rig.clock.now() + 1.0)

        monkeypatch.setattr(guard, "arm", slowly)
        rig.said.clear()
        result = prepared.run()
    assert result.stop is None
    assert not [text for text in rig.said if "nothing" in text or "waits" in text], rig.said


TICK_S = 0.008
OWNER: Source = ("127.0.0.1", 40000)
OTHER: Source = ("127.0.0.1", 50001)
COST_S = 0.003
"""Of a poll that brings what is of no use."""
CALM, TICKS = 20, 50


class Counting(JsonPoseDecoder):
    """Counts what it is given."""

    given = 0

    def decode(self, payload: bytes) -> list[StreamFrame]:
        """Decode, and count."""
        self.given += 1
        return super().decode(payload)


def flooded(payload: bytes | None, source: Source, *, owned: bool) -> tuple[list[float], list[int]]:
    """CPU time (s) of each poll and datagrams decoded in it, while a `source` sends payloads, None: the owner's own
    frames, FLOOD_HZ a second. owned: whether the stream has an owner by then."""
    sender, handed = FakeSender(source=OWNER), Queue([])
    stream, decoder = live_stream(sender, load_performer("five")), Counting()
    stream.decoder, stream.receiver = decoder, handed
    if not owned:
        sender.faults.append(lambda time, poses: None)
    frame, cost, decoded = b"", list[float](), list[int]()

    def others(first: float, last: float) -> list[Datagram]:
        data = frame if payload is None else payload
        times = np.linspace(first, last, round(FLOOD_HZ * (last - first)), endpoint=False)
        return [Datagram(sender.begun + float(time), source, data) for time in times]

    for tick in range(CALM + TICKS):
        now = 1.0 + tick * TICK_S
        flooding = tick >= CALM
        sender.others[:] = [others] if flooding else []
        handed.waiting = sender.poll(now) if flooding or owned else []
        frame = next((one.payload for one in handed.waiting if one.source == OWNER), frame)
        before, begun = decoder.given, thread_cpu()
        stream.poll(now, moving=owned)
        if flooding:
            cost.append(thread_cpu() - begun)
            decoded.append(decoder.given - before)
    return cost, decoded


@pytest.mark.parametrize(
    ("payload", "source", "owned"),
    [
        (b"x" * 64, OTHER, True),
        (b"x" * 64, OTHER, False),
        (b'{"poses": ' + b"[" * 900, OTHER, False),
        (b"x" * 64, OWNER, True),
        (None, OWNER, True),
    ],
    ids=["another sender", "no owner yet", "brackets", "the owner's junk", "the owner's frames"],
)
def test_a_flood_costs_no_tick(payload: bytes | None, source: Source, owned: bool) -> None:
    cost, decoded = flooded(payload, source, owned=owned)
    assert max(decoded) <= MOST_DECODED
    assert np.median(cost) < (TICK_S if payload is None else COST_S), np.round(1e3 * np.array(cost), 2).tolist()
