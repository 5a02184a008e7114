"""Capture of a live stream for the doctor: frames, senders, poses and sensor states of some seconds, all bounded."""

from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np

from hardware.clock import Clock
from retarget.live.admission import Datagram, Source
from retarget.live.datagram_kinds import Recognised, recognise
from retarget.live.sensor_validity import ValidityState
from retarget.live.stream import LiveStream
from retarget.types import FloatArray, IntArray

STEP_S = 0.01
SAMPLE_S = 0.05
"""Between two samples of the poses and of the validity of the sensors."""
SETTLING_S = 1.5
MOST_FRAMES = 500_000
MOST_SAMPLES = 12_000
"""Ten minutes of samples."""
MOST_SOURCES = 64
MOST_KINDS = 16
ALL_NAMED = 300
"""Datagrams that are all recognised; after them, one in SELDOM is."""
SELDOM = 20
MOST_NAMES = 256
_UNKNOWN = np.full(7, np.nan)


@dataclass(frozen=True, slots=True)
class FrameNote:
    """A decoded frame without its poses. arrival: s, local clock; stamp, number: the sender's."""

    arrival: float
    stamp: float | None
    number: int | None
    names: tuple[str, ...]


@dataclass(eq=False)
class StreamCapture:
    """What a stream brought in some seconds. Every field is bounded.

    stream: with the counts that it keeps itself. began, ended: s of its clock. arrived: datagrams. sources: datagrams
    by sender. largest: bytes of the longest datagram of each address. kinds: what the datagrams that were recognised
    look like. samples: poses (7,) every SAMPLE_S, by the sender's names, position [m] and quaternion wxyz. states:
    a ValidityState per sensor at each sample. last_poses: the last pose (7,) of each name.
    """

    stream: LiveStream
    began: float
    ended: float = 0.0
    arrived: int = 0
    sources: Counter[Source] = field(default_factory=Counter)
    largest: dict[str, int] = field(default_factory=dict)
    kinds: Counter[Recognised] = field(default_factory=Counter)
    frames: list[FrameNote] = field(default_factory=list)
    samples: list[dict[str, FloatArray]] = field(default_factory=list)
    states: list[list[int]] = field(default_factory=list)
    last_poses: dict[str, FloatArray] = field(default_factory=dict)

    @property
    def seconds(self) -> float:
        """How long the capture took."""
        return self.ended - self.began

    @property
    def settled(self) -> int:
        """Index of the first sample that counts: SETTLING_S after the first pose."""
        first = next((row for row, poses in enumerate(self.samples) if poses), len(self.samples))
        return first + round(SETTLING_S / SAMPLE_S)

    def share(self, sensor: str, state: ValidityState) -> float:
        """Share of the time in which a sensor was in a state, 0 to 1.

        The beginning does not count: trackers settle, and a capture that starts within a motion has nothing to compare
        with.
        """
        states = self.states_of(sensor)[self.settled :]
        return float(np.sum(states == state) / max(len(states), 1))

    def states_of(self, sensor: str) -> IntArray:
        """The `ValidityState` (n,) of a sensor at each sample."""
        states = np.array(self.states, dtype=np.int64).reshape(-1, len(self.stream.roles.sensors))
        return np.asarray(states[:, self.stream.roles.sensors.index(sensor)])

    def track(self, name: str) -> FloatArray:
        """Poses (n, 7) of a name at each sample, NaN where it was not sent yet."""
        return np.array([poses.get(name, _UNKNOWN) for poses in self.samples]).reshape(-1, 7)


def capture_stream(
    stream: LiveStream, *, clock: Clock, seconds: float, on_step: Callable[[float], None] = lambda now: None
) -> StreamCapture:
    """Listen for `seconds`, or until a recording ends. on_step: called with the time at every step.

    Every datagram goes to the stream as in a run in which nothing moves.
    """
    capture = StreamCapture(stream, clock.now())
    sample_at = capture.began
    while (now := clock.now()) <= capture.began + seconds and not getattr(stream.receiver, "finished", False):
        for datagram in stream.receiver.poll(now):
            _take(capture, datagram, now)
        if now >= sample_at:
            sample_at += SAMPLE_S
            _sample(capture, now)
        on_step(now)
        clock.sleep_until(now + STEP_S)
    capture.ended = clock.now()
    return capture


def _take(capture: StreamCapture, datagram: Datagram, now: float) -> None:
    """Pass one datagram to the stream, and count what it was."""
    stream = capture.stream
    capture.arrived += 1
    if datagram.source in capture.sources or len(capture.sources) < MOST_SOURCES:
        capture.sources[datagram.source] += 1
        host, size = datagram.source[0], len(datagram.payload)
        capture.largest[host] = max(size, capture.largest.get(host, 0))
    if capture.arrived <= ALL_NAMED or capture.arrived % SELDOM == 0:
        got = recognise(datagram.payload)
        if got not in capture.kinds and len(capture.kinds) >= MOST_KINDS:
            got = replace(got, detail="and others")
        capture.kinds[got] += 1
    if not stream.admission.admit(datagram, now=now, moving=False):
        return
    for frame in stream.take(datagram, now, moving=False):
        if len(capture.frames) < MOST_FRAMES:
            capture.frames.append(FrameNote(datagram.arrival, frame.stamp, frame.number, frame.names))
        for name, place, turn in zip(frame.names, frame.position, frame.orientation, strict=True):
            if name in capture.last_poses or len(capture.last_poses) < MOST_NAMES:
                capture.last_poses[name] = _completed(np.concatenate((place, turn)), capture.last_poses.get(name))


def _completed(pose: FloatArray, before: FloatArray | None) -> FloatArray:
    """A pose (7,), with its missing half from the pose before: some senders split it over two datagrams."""
    missing = np.isnan(pose)
    return pose if before is None or not missing.any() else np.where(missing, before, pose)


def _sample(capture: StreamCapture, now: float) -> None:
    states = capture.stream.validity.judge(now)
    if len(capture.states) < MOST_SAMPLES:
        capture.states.append(states.tolist())
        capture.samples.append(dict(capture.last_poses))
