"""The CPU time that a flood costs a tick: on virtual time decoding is free, so it is measured here."""

import numpy as np
import pytest

from hardware.clock import thread_cpu
from live_rig import live_stream
from retarget.live.admission import Datagram, Source
from retarget.live.stream import MOST_DECODED
from retarget.schema.performer import load_performer
from retarget.sources.json_pose import JsonPoseDecoder
from retarget.sources.stream_frame import Dropped, StreamFrame
from sim.faults.inject import FLOOD_HZ
from sim.faults.sender import FakeSender

TICK_S = 0.008
OWNER: Source = ("127.0.0.1", 40000)
OTHER: Source = ("127.0.0.1", 50001)
COST_S = 0.003
"""Of a poll that brings what is of no use."""
CALM, TICKS = 50, 125


class Counting(JsonPoseDecoder):
    """Counts what it is given."""

    given = 0

    def decode(self, payload: bytes) -> list[StreamFrame]:
        """Decode, and count."""
        self.given += 1
        return super().decode(payload)


class Handed:
    """A receiver to which a poll of another is handed: what makes the flood is not measured."""

    finished = False

    def __init__(self) -> None:
        self.dropped = Dropped()
        self.found: list[Datagram] = []

    def poll(self, now: float) -> list[Datagram]:
        """What was handed."""
        found, self.found = self.found, []
        return found

    def close(self) -> None:
        """Nothing is open."""


def flooded(payload: bytes | None, source: Source, *, owned: bool) -> tuple[list[float], list[int]]:
    """CPU time (s) of each poll and datagrams decoded in it, while a `source` sends payloads, None: the owner's own
    frames, FLOOD_HZ a second. owned: whether the stream has an owner by then."""
    sender, handed = FakeSender(source=OWNER), Handed()
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
        handed.found = sender.poll(now) if flooding or owned else []
        frame = next((one.payload for one in handed.found if one.source == OWNER), frame)
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
