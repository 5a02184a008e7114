"""The sensors of a performer as JSON datagrams on virtual time, and the faults of a sender."""

import json
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np

from retarget.frames import SensorFrames
from retarget.live.admission import MOST_PER_POLL, Datagram, Source
from retarget.sources.streams.stream_frame import Dropped
from retarget.types import FloatArray
from sim.performer import synthetic_performer

STILL_S = 2.0
"""Time for which the performer stands still first, s."""
NOISE_M = 0.0005
JITTER_S = 0.004
MOST_WAITING = 256
"""Datagrams that the kernel keeps for a socket of its usual size; what comes after them is lost."""

Poses = dict[str, FloatArray]
SenderFault = Callable[[float, Poses], Poses | None]
"""A function of time (s of the sender) and positions by name: those that are sent instead, None: nothing is."""
Garble = Callable[[float, bytes], list[bytes]]
"""A function of time and a datagram: the datagrams that arrive instead."""


@dataclass
class FakeSender:
    """A `retarget.live.admission.Receiver` of the datagrams of a performer, on the clock, s, by which it is polled.

    faults: of poses; garbles: of datagrams; jumps: of the sender's clock, s; others: datagrams from other addresses, by
    the times, s of the sender, of the last poll and of this one.
    """

    frames: SensorFrames = field(default_factory=synthetic_performer)
    rate_hz: float = 100.0
    faults: list[SenderFault] = field(default_factory=list)
    garbles: list[Garble] = field(default_factory=list)
    source: Source = ("127.0.0.1", 40000)
    dropped: Dropped = field(default_factory=Dropped)
    jumps: list[float] = field(default_factory=list)
    others: list[Callable[[float, float], list[Datagram]]] = field(default_factory=list)
    seed: int = 3

    def __post_init__(self) -> None:
        self._chance = np.random.default_rng(self.seed)
        self.track = self.frames.resample(np.arange(0.0, self.frames.duration_s, 1.0 / self.rate_hz)).position
        self._sent = 0
        self._begun: float | None = None
        self._polled = 0.0
        self._queue: list[Datagram] = []

    @property
    def begun(self) -> float:
        """Begin of the sender's own time, s of the clock that polls."""
        return 0.0 if self._begun is None else self._begun

    @property
    def finished(self) -> bool:
        """False: the sender never ends."""
        return False

    def poll(self, now: float) -> list[Datagram]:
        """The datagrams that have arrived by `now`."""
        if self._begun is None:
            self._begun = self._polled = now
        found = []
        while (due := self._begun + self._sent / self.rate_hz) <= now:
            time = self._sent / self.rate_hz
            payload = self.encoded(time)
            self._sent += 1
            garbled = [] if payload is None else [payload]
            for garble in self.garbles:
                garbled = [new for datagram in garbled for new in garble(time, datagram)]
            for datagram in garbled:
                arrival = min(due + self._chance.uniform(0.0, JITTER_S), now)
                found.append(Datagram(arrival, self.source, datagram))
        for other in self.others:
            found += other(self._polled - self._begun, now - self._begun)
        self._polled = now
        self._queue += sorted(found, key=lambda one: one.arrival)
        del self._queue[MOST_WAITING:]
        taken, self._queue = self._queue[:MOST_PER_POLL], self._queue[MOST_PER_POLL:]
        return taken

    def close(self) -> None:
        """Do nothing: no socket is open."""

    def stamp(self, time: float) -> float:
        """The time by the sender's clock, s, at a time, s of the sender."""
        return sum(self.jumps, time + 1000.0)

    def encoded(self, time: float) -> bytes | None:
        """The datagram that is sent at a time, s of the sender; None: nothing is."""
        poses = self.poses(time)
        return None if poses is None else encoded(self.stamp(time), poses)

    def poses(self, time: float) -> Poses | None:
        """Return what is sent at a time, s of the sender, with its faults; None: nothing is."""
        row = min(max(round((time - STILL_S) * self.rate_hz), 0), len(self.track) - 1)
        noise = self._chance.normal(0.0, NOISE_M, self.track[row].shape)
        poses: Poses | None = dict(zip(self.frames.names, self.track[row] + noise, strict=True))
        for fault in self.faults:
            poses = None if poses is None else fault(time, poses)
        return poses


def encoded(stamp: float, poses: Poses) -> bytes:
    """A datagram of `retarget.sources.streams.json_pose`."""
    sent = {name: {"p": [round(float(x), 6) for x in point]} for name, point in poses.items()}
    return json.dumps({"axes": "rep103", "time": stamp, "poses": sent}).encode()


# Faults of a sender, from `first` to before `last`, s of the sender.

EVER = math.inf


def silent(first: float = 0.0, last: float = EVER) -> SenderFault:
    """Send nothing."""
    return lambda time, poses: None if first <= time < last else poses


def flapping(period: float = 0.3) -> SenderFault:
    """Send nothing for 0.6 of each `period`, s, from the first call on."""
    return _gaps(lambda time: (time / period) % 1.0 < 0.6)


def pausing(length: float) -> SenderFault:
    """Send nothing for `length` s from the first call on."""
    return _gaps(lambda time: time < length)


def lost(name: str, first: float = 0.0, last: float = EVER) -> SenderFault:
    """Leave one sensor out."""
    return _within(first, last, lambda poses: {other: at for other, at in poses.items() if other != name})


def frozen(name: str, first: float = 0.0, last: float = EVER) -> SenderFault:
    """Repeat the position of one sensor, to the bit."""
    kept: Poses = {}

    def repeated(poses: Poses) -> Poses:
        kept.update({name: poses[name]} if name in poses and not kept else {})
        return poses | kept

    return _within(first, last, repeated)


def moved(name: str, first: float, last: float, by: Sequence[float]) -> SenderFault:
    """Shift one sensor by `by` (3,) m."""
    return _within(first, last, lambda poses: poses | {name: poses[name] + np.array(by)} if name in poses else poses)


def swapped(one: str, other: str, first: float = 0.0, last: float = EVER) -> SenderFault:
    """Swap the names of two sensors."""
    names = {one: other, other: one}
    return _within(first, last, lambda poses: {names.get(name, name): at for name, at in poses.items()})


def _gaps(missing: Callable[[float], bool]) -> SenderFault:
    """Send nothing while `missing` is true of the time since the first call, s."""
    begun: list[float] = []

    def fault(time: float, poses: Poses) -> Poses | None:
        begun[:] = begun or [time]
        return None if missing(time - begun[0]) else poses

    return fault


def _within(first: float, last: float, change: Callable[[Poses], Poses]) -> SenderFault:
    return lambda time, poses: change(poses) if first <= time < last else poses
