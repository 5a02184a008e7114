"""A live stream at work: datagrams in as they arrive, the performer's sensors out, in the stream's world."""

from collections import deque
from dataclasses import dataclass, field

import numpy as np

from retarget._solver import PoseParts
from retarget.frames import BoolArray
from retarget.live.admission import Admission
from retarget.live.clock_map import ClockMap
from retarget.live.datagram import Datagram, Receiver
from retarget.live.playout import Playout
from retarget.live.pose_filter import PoseFilter
from retarget.live.raw_tap import RawTap
from retarget.live.roles import Roles, SensorPoses
from retarget.live.trust import Trust
from retarget.live.trust_state import StateArray, TrustState
from retarget.live.window_filter import WindowFilter
from retarget.live.work_budget import WorkBudget, work_of
from retarget.rotations import FloatArray
from retarget.sources.stream_frame import StreamDecoder, StreamFrame

__all__ = ["Heard", "LiveStream"]

_GONE = np.array([state not in (TrustState.FRESH, TrustState.FROZEN) for state in TrustState])


@dataclass(frozen=True, slots=True, eq=False)
class Heard:
    """k sensors at one time, in the stream's world. position (k, 3) m and orientation (k, 4) wxyz, NaN where never
    told; states (k,): a `TrustState` each. fresh (k,): who is believed and known."""

    position: FloatArray
    orientation: FloatArray
    states: StateArray
    fresh: BoolArray = field(init=False)

    def __post_init__(self) -> None:
        fresh: BoolArray = np.isfinite(self.position[:, 0])
        if np.count_nonzero(self.states):
            fresh &= self.states == TrustState.FRESH
        object.__setattr__(self, "fresh", fresh)


class LiveStream:
    """One sender, from its datagrams to the sensors of `roles`. Memory is bounded; nothing from outside raises.

    frames: decoded so far. arrived: datagrams so far, admitted or not; last: s, when the last frame arrived.
    tap: what records it, None: nothing does.
    """

    def __init__(
        self,
        receiver: Receiver,
        decoder: StreamDecoder,
        roles: Roles,
        *,
        admission: Admission,
        clock_map: ClockMap,
        trust: Trust,
        playout: Playout,
        smooth: PoseFilter | WindowFilter | None = None,
        tap: RawTap | None = None,
    ) -> None:
        self.receiver, self.decoder, self.roles = receiver, decoder, roles
        self.admission, self.clock_map, self.trust, self.playout = admission, clock_map, trust, playout
        self.frames = self.arrived = 0
        self.last = -np.inf
        self.names: dict[str, None] = {}
        """Poses that the sender has told, by its own names; bounded."""
        self.unread = b""
        """The last datagram that held no poses."""
        self.tap, self._smooth = tap, smooth
        self._waiting: deque[Datagram] = deque()
        self._parts = PoseParts(len(roles.sensors))

    @property
    def waiting(self) -> int:
        """Datagrams that the last poll gave and that are not decoded yet; at most what one poll may give."""
        return len(self._waiting)

    def tells(self, sensor: str) -> bool:
        """Whether the sender has told a sensor so far, well or not."""
        place = self.roles.places[self.roles.sensors.index(sensor)]
        return not self.names.keys().isdisjoint({place.position, place.orientation} - {""})

    def listen(self, now: float, *, moving: bool) -> None:
        """Take what has arrived until `now`, s. moving: while the robot follows, nobody else takes over the stream.

        What is more than the work of one poll waits for the next, and what comes meanwhile waits in the kernel.
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

    def read(self, now: float) -> Heard:
        """Every sensor at `now`, s."""
        played, states = self.playout.read(now), self.trust.judge(now)
        if self._smooth is None:
            return Heard(played.position, played.orientation, states)
        if np.count_nonzero(states) and (gone := _GONE[states]).any():  # where it comes back is no motion
            self._smooth.reset(gone)
        position, orientation = self._smooth.step(played.time, played.position, played.orientation)
        return Heard(position, orientation, states)

    def _take(self, datagram: Datagram, now: float, *, moving: bool) -> None:
        frames = self.decoder.decode(datagram.payload)
        if not frames:
            self.unread = datagram.payload
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
        usable = self.trust.take(rows, time, position=position, orientation=orientation, tracked=poses.tracked)
        self.playout.push(rows, time, position, orientation, usable, arrival=arrival)

    def _note_names(self, frame: StreamFrame) -> None:
        if self.frames < 1000 and len(self.names) < 256:  # for messages at the start; later nobody asks
            self.names.update(dict.fromkeys(frame.names))
