"""Listens to a stream for a while, as a run would, and keeps what is needed to say what is wrong with it."""

from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np

from hardware.clock import Clock
from retarget.live.admission import Datagram, Source
from retarget.live.datagram_kinds import Recognised, recognise
from retarget.live.sensor_validity import ValidityState
from retarget.live.stream import LiveStream
from retarget.sources.stream_frame import Dropped, StreamDecoder, StreamFrame
from retarget.types import FloatArray

__all__ = ["FrameNote", "Listening", "listen_to"]

STEP_S = 0.01
LOOK_S = 0.05
"""Between two looks at what is thought of the sensors."""
SETTLING_S = 1.5
MOST_FRAMES = 500_000
MOST_LOOKS = 12_000
"""Ten minutes of looks."""
MOST_SOURCES = 64
MOST_KINDS = 16
ALL_NAMED = 300
"""Datagrams of which each is recognised; after them one of SELDOM."""
SELDOM = 20


@dataclass(frozen=True, slots=True)
class FrameNote:
    """A decoded frame without its poses. arrival: s, local; stamp, number: as the sender told them."""

    arrival: float
    stamp: float | None
    number: int | None
    names: tuple[str, ...]


@dataclass(eq=False)
class Listening:
    """What was heard. All of it is bounded.

    stream: with the counts that it keeps itself. began, ended: s of its clock. sources: datagrams by sender. kinds: of
    some datagrams, what they look like. largest: bytes of the longest datagram of each
    address. looks: poses (7,) at regular times by the sender's names, position and wxyz. states (n, k): a ValidityState
    each. told: the last pose of each name.
    """

    stream: LiveStream
    began: float
    ended: float = 0.0
    arrived: int = 0
    sources: Counter[Source] = field(default_factory=Counter)
    largest: dict[str, int] = field(default_factory=dict)
    kinds: Counter[Recognised] = field(default_factory=Counter)
    frames: list[FrameNote] = field(default_factory=list)
    looks: list[dict[str, FloatArray]] = field(default_factory=list)
    states: list[list[int]] = field(default_factory=list)
    told: dict[str, FloatArray] = field(default_factory=dict)

    @property
    def seconds(self) -> float:
        """How long it listened."""
        return self.ended - self.began

    @property
    def settled(self) -> int:
        """The first look that counts."""
        first = next((row for row, look in enumerate(self.looks) if look), len(self.looks))
        return first + round(SETTLING_S / LOOK_S)

    def share(self, sensor: str, state: ValidityState) -> float:
        """Of the time, in which a sensor was in a state, 0 to 1. The beginning does not count: trackers settle, and
        who comes into the middle of a motion has nothing to compare with."""
        column = self.stream.roles.sensors.index(sensor)
        rows = self.states[self.settled :]
        return sum(row[column] == state for row in rows) / max(len(rows), 1)


def listen_to(
    stream: LiveStream, *, clock: Clock, seconds: float, beside: Callable[[float], None] = lambda now: None
) -> Listening:
    """Listen for so long, or until a recording ends. beside: called with the time at every step.

    What arrives goes through the stream as in a run in which nothing moves.
    """
    receiver, single = stream.receiver, _Single(stream.receiver.dropped)
    decoder = stream.decoder
    noting = _Noting(decoder)
    stream.receiver, stream.decoder = single, noting
    listening = Listening(stream, clock.now())
    look_at = listening.began
    try:
        while (now := clock.now()) <= listening.began + seconds and not getattr(receiver, "finished", False):
            for datagram in receiver.poll(now):
                single.waiting = [datagram]
                _take(listening, datagram, noting, now)
            if now >= look_at:
                look_at += LOOK_S
                _look(listening, now)
            beside(now)
            clock.sleep_until(now + STEP_S)
    finally:
        stream.receiver, stream.decoder = receiver, decoder
    listening.ended = clock.now()
    return listening


class _Single:
    """A Receiver of the one datagram that is to be looked at now."""

    def __init__(self, dropped: Dropped) -> None:
        self.dropped = dropped
        self.waiting: list[Datagram] = []

    @property
    def finished(self) -> bool:
        """Whether its recording has been played."""
        return False

    def poll(self, now: float) -> list[Datagram]:
        """It, once."""
        found, self.waiting = self.waiting, []
        return found

    def close(self) -> None:
        """Nothing is open."""


class _Noting:
    """A StreamDecoder that remembers the frames of the last datagram."""

    def __init__(self, inner: StreamDecoder) -> None:
        self.dropped = inner.dropped
        self.latest: list[StreamFrame] = []
        self._inner = inner

    def decode(self, datagram: bytes) -> list[StreamFrame]:
        """As the decoder inside."""
        self.latest = self._inner.decode(datagram)
        return self.latest


def _take(listening: Listening, datagram: Datagram, noting: _Noting, now: float) -> None:
    """One datagram through the stream."""
    stream = listening.stream
    listening.arrived += 1
    if datagram.source in listening.sources or len(listening.sources) < MOST_SOURCES:
        listening.sources[datagram.source] += 1
        host, size = datagram.source[0], len(datagram.payload)
        listening.largest[host] = max(size, listening.largest.get(host, 0))
    if listening.arrived <= ALL_NAMED or listening.arrived % SELDOM == 0:
        got = recognise(datagram.payload)
        if got not in listening.kinds and len(listening.kinds) >= MOST_KINDS:
            got = replace(got, detail="and others")
        listening.kinds[got] += 1
    before, noting.latest = stream.frames, []
    stream.poll(now, moving=False)
    if stream.frames == before:
        return
    for frame in noting.latest:
        if len(listening.frames) < MOST_FRAMES:
            listening.frames.append(FrameNote(datagram.arrival, frame.stamp, frame.number, frame.names))
        for name, place, turn in zip(frame.names, frame.position, frame.orientation, strict=True):
            if name in listening.told or len(listening.told) < 256:
                listening.told[name] = _completed(np.concatenate((place, turn)), listening.told.get(name))


def _completed(pose: FloatArray, before: FloatArray | None) -> FloatArray:
    """A pose (7,) whose other half came in another datagram."""
    missing = np.isnan(pose)
    return pose if before is None or not missing.any() else np.where(missing, before, pose)


def _look(listening: Listening, now: float) -> None:
    states = listening.stream.validity.judge(now)
    if len(listening.states) < MOST_LOOKS:
        listening.states.append(states.tolist())
        listening.looks.append(dict(listening.told))
