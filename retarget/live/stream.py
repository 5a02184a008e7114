"""A live stream in a run: datagrams in as they arrive, the performer's sensors out, in the stream's world."""

from collections import deque
from dataclasses import dataclass, field

import numpy as np

from retarget._solver import PoseParts
from retarget.live.admission import Admission, Datagram, Receiver, WorkBudget, work_of
from retarget.live.clock_map import ClockMap
from retarget.live.playout import Playout
from retarget.live.raw_recording import RawTap
from retarget.live.roles import Roles, SensorPoses
from retarget.live.sensor_validity import SensorValidity, StateArray, ValidityState
from retarget.live.smoothing import PoseFilter, WindowFilter
from retarget.sources.stream_frame import StreamDecoder, StreamFrame
from retarget.types import BoolArray, FloatArray

_GONE = np.array([state not in (ValidityState.FRESH, ValidityState.FROZEN) for state in ValidityState])


@dataclass(frozen=True, slots=True, eq=False)
class StreamReading:
    """k sensors at one time, in the stream's world. position (k, 3) m and orientation (k, 4) wxyz, NaN where never
    sent; states (k,): a `ValidityState` each. fresh (k,): state FRESH, with a known position."""

    position: FloatArray
    orientation: FloatArray
    states: StateArray
    fresh: BoolArray = field(init=False)

    def __post_init__(self) -> None:
        fresh: BoolArray = np.isfinite(self.position[:, 0])
        if np.count_nonzero(self.states):
            fresh &= self.states == ValidityState.FRESH
        object.__setattr__(self, "fresh", fresh)


class LiveStream:
    """One sender, from its datagrams to the sensors of `roles`. Memory is bounded; no data from outside raise.

    frames: decoded so far. arrived: datagrams so far, admitted or not; last: s, when the last frame arrived. tap:
    records the admitted datagrams, None: they are not recorded.
    """

    def __init__(
        self,
        receiver: Receiver,
        decoder: StreamDecoder,
        roles: Roles,
        *,
        admission: Admission,
        clock_map: ClockMap,
        validity: SensorValidity,
        playout: Playout,
        smooth: PoseFilter | WindowFilter | None = None,
        tap: RawTap | None = None,
    ) -> None:
        self.receiver, self.decoder, self.roles = receiver, decoder, roles
        self.admission, self.clock_map, self.validity, self.playout = admission, clock_map, validity, playout
        self.frames = self.arrived = 0
        self.last = -np.inf
        self.names: dict[str, None] = {}
        """The sender's names of the poses that it has sent; bounded."""
        self.undecoded = b""
        """The last datagram that held no poses."""
        self.tap, self._smooth = tap, smooth
        self._waiting: deque[Datagram] = deque()
        self._parts = PoseParts(len(roles.sensors))

    @property
    def waiting(self) -> int:
        """Datagrams that were polled and are not decoded yet; at most those of one poll."""
        return len(self._waiting)

    def has_sent(self, sensor: str) -> bool:
        """Whether the sender has sent a sensor so far, valid or not."""
        place = self.roles.places[self.roles.sensors.index(sensor)]
        return not self.names.keys().isdisjoint({place.position, place.orientation} - {""})

    def poll(self, now: float, *, moving: bool) -> None:
        """Take what has arrived until `now`, s. moving: whether other sources are kept from taking over the stream.

        What exceeds the work of one poll waits for the next poll. What comes meanwhile waits in the kernel.
        """
        if not self._waiting:
            self._waiting.extend(self.receiver.poll(now))
        budget = WorkBudget()
        while self._waiting and not budget.spent:
            datagram = self._waiting.popleft()
            self.arrived += 1
            if self.admission.admit(datagram, now=now, moving=moving):
                if self.tap is not None:
                    self.tap.take(datagram)
                work, frames = work_of(self.decoder), self.frames
                self._take(datagram, now, moving=moving)
                work = work_of(self.decoder) - work
                budget.charge(datagram.payload, frames=self.frames - frames, work=work)

    def read(self, now: float) -> StreamReading:
        """Every sensor at `now`, s."""
        played, states = self.playout.read(now), self.validity.judge(now)
        if self._smooth is None:
            return StreamReading(played.position, played.orientation, states)
        if np.count_nonzero(states) and (gone := _GONE[states]).any():  # a reappearance elsewhere is no motion
            self._smooth.reset(gone)
        position, orientation = self._smooth.step(played.time, played.position, played.orientation)
        return StreamReading(position, orientation, states)

    def _take(self, datagram: Datagram, now: float, *, moving: bool) -> None:
        frames = self.decoder.decode(datagram.payload)
        if not frames:
            self.undecoded = datagram.payload
        if not frames or not self.admission.confirm(datagram.source, now=now, moving=moving):
            return
        for frame in frames:
            self.frames += 1
            self.last = datagram.arrival
            self._note_names(frame)
            time = self.clock_map.map(datagram.arrival, frame.stamp, frame.number)
            poses = None if time is None else self.roles.take(frame)
            if time is not None and poses is not None:
                self._keep(poses, time, datagram.arrival)

    def _keep(self, poses: SensorPoses, time: float, arrival: float) -> None:
        rows, position, orientation = poses.rows, poses.position, poses.orientation
        self._parts.complete(rows, time, position, orientation)
        usable = self.validity.take(rows, time, position=position, orientation=orientation, tracked=poses.tracked)
        self.playout.push(rows, time, position, orientation, usable, arrival=arrival)

    def _note_names(self, frame: StreamFrame) -> None:
        if self.frames < 1000 and len(self.names) < 256:  # only messages at the start need them
            self.names.update(dict.fromkeys(frame.names))


# The backlog that arrived while the stream was not polled: it is taken before the stream is judged.

RECENT_S = 0.05
"""A datagram that arrived within this time is recent."""
LONGEST_S = 1.0
"""Longest wait for a recent frame: a sender whose frames cannot be decoded may go on for ever."""
MOST_POLLS = 100


class CatchingUp:
    """Takes the backlog of a stream over several ticks. Powering a robot takes about a second without polls, in which
    a stream sends more than one tick may decode."""

    def __init__(self, stream: LiveStream) -> None:
        self._stream = stream
        self._arrived = -1
        self._since: float | None = None  # [s]
        self._done = False

    def at_once(self, now: float) -> None:
        """Take all that has arrived until `now`, s, however long that takes; for a robot without torque."""
        for _ in range(MOST_POLLS):
            before = self._stream.arrived
            self._stream.poll(now, moving=True)
            if self._stream.arrived == before:
                return

    def step(self, now: float) -> bool:
        """Whether there is more to take; to be called once a tick after the poll, at `now`, s. Once False, it stays
        False."""
        if self._done:
            return False
        stream = self._stream
        self._since = now if self._since is None else self._since
        recent, silent = now - stream.last <= RECENT_S, stream.arrived == self._arrived
        self._done = recent or silent or now - self._since > LONGEST_S
        self._arrived = stream.arrived
        return not self._done
