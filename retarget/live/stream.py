"""A live stream in a run: datagrams in as they arrive, the performer's sensors out, in the stream's world."""

from dataclasses import dataclass, field

import numpy as np

from retarget._solver import PoseParts
from retarget.frames import NO_TIMES, SampleTimes
from retarget.human.pose_validation import LIMITS, StateArray, ValidityState
from retarget.live.admission import MOST_PER_POLL, TOO_MANY, Admission, Datagram, Receiver
from retarget.live.clock_map import ClockMap
from retarget.live.playout import OFF, Playout, pose_filter
from retarget.live.raw_recording import RawTap
from retarget.live.roles import Roles
from retarget.live.sensor_validity import CAMERA_LIMITS, SensorValidity
from retarget.sources.streams.stream_frame import StreamDecoder, StreamFrame
from retarget.types import BoolArray, FloatArray

_GONE = np.array([state not in (ValidityState.FRESH, ValidityState.FROZEN) for state in ValidityState])


@dataclass(slots=True, eq=False)
class StreamReading:
    """k sensors at one time, in the stream's world. position (k, 3) m, orientation (k, 4) wxyz: NaN where never sent.

    states (k,): a `ValidityState` each. fresh (k,): state FRESH, with a known position.
    """

    position: FloatArray
    orientation: FloatArray
    states: StateArray
    times: SampleTimes = NO_TIMES
    fresh: BoolArray = field(init=False)

    def __post_init__(self) -> None:
        self.fresh = np.isfinite(self.position[:, 0])
        if np.count_nonzero(self.states):
            self.fresh &= self.states == ValidityState.FRESH


MOST_DECODED = 64  # datagrams of one poll: a whole avatar, bone by bone, and 6,400 a second at 100 Hz
MOST_BYTES_DECODED = 2**15  # of one poll: three whole avatars; a made datagram of so many costs some milliseconds
MOST_ROUNDS = 4  # polls of the receiver in one poll of the stream: 512 datagrams are 0.7 s of VRChat OSC


class LiveStream:
    """One sender, from its datagrams to the sensors of `roles`. Memory is bounded; outside data never raise.

    frames: decoded so far. arrived: datagrams so far. last: s, arrival of the last frame with a time. captured: s,
    newest capture. tap: records the admitted datagrams. kind: the scheme of the address, "" for the caller's own
    receiver. Raises UsageError for an unknown smoothing.
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
        smoothing: str = OFF,
        tap: RawTap | None = None,
        kind: str = "",
    ) -> None:
        self.kind = kind
        self.receiver, self.decoder, self.roles = receiver, decoder, roles
        self.admission, self.clock_map, self.validity, self.playout = admission, clock_map, validity, playout
        self.frames = self.arrived = 0
        self.last = self.captured = -np.inf
        self.names: dict[str, None] = {}  # of the poses that the sender has sent; bounded
        self.undecoded = b""  # the last datagram without poses
        self.tap, self._camera = tap, False
        self._smoothing, self._smooth = smoothing, pose_filter(smoothing, len(roles.sensors))
        self._parts = PoseParts(len(roles.sensors))

    @property
    def smoothing(self) -> str:
        """The name of the smoothing, which is off for a camera, as its decoder smooths."""
        return OFF if self._camera else self._smoothing

    def has_sent(self, sensor: str) -> bool:
        """True if the sender has sent a sensor so far, valid or not."""
        place = self.roles.places[self.roles.sensors.index(sensor)]
        return not self.names.keys().isdisjoint({place.position, place.orientation} - {""})

    def poll(self, now: float, *, moving: bool) -> None:
        """Take what has arrived until `now`, s. moving: True if no other source may take over the stream.

        Beyond MOST_DECODED only the newest datagrams are decoded, so that the latency of a slow run does not grow.
        """
        admitted: list[Datagram] = []
        for _ in range(MOST_ROUNDS):
            found = self.receiver.poll(now)
            self.arrived += len(found)
            admitted += [one for one in found if self.admission.admit(one, now=now, moving=moving)]
            if len(found) < MOST_PER_POLL:
                break
        if self.tap is not None:
            for datagram in admitted:
                self.tap.take(datagram)
        first, size = len(admitted), 0
        for datagram in admitted[: -MOST_DECODED - 1 : -1]:
            size += len(datagram.payload)
            if size > MOST_BYTES_DECODED and first < len(admitted):
                break
            first -= 1
        if first:
            self.admission.refused.reasons[TOO_MANY] += first
        for datagram in admitted[first:]:
            self.take(datagram, now, moving=moving)

    def take(self, datagram: Datagram, now: float, *, moving: bool) -> list[StreamFrame]:
        """Decode an admitted datagram and keep its poses. Returns its frames, none where they may not be used."""
        frames = self.decoder.decode(datagram.payload)
        if not frames:
            self.undecoded = datagram.payload
        if not frames or not self.admission.confirm(datagram.source, now=now, moving=moving):
            return []
        for frame in frames:
            self.frames += 1
            if self.frames < 1000 and len(self.names) < 256:  # only messages at the start need them
                self.names.update(dict.fromkeys(frame.names))
            if frame.camera is not self._camera:
                self._camera = frame.camera
                self.validity.restart(CAMERA_LIMITS if frame.camera else LIMITS)
            time = self.clock_map.map(datagram.arrival, frame.stamp, frame.number)
            if time is None:
                continue
            poses = self.roles.take(frame)
            self.last, self.captured = datagram.arrival, max(self.captured, time)
            if poses is None:
                continue
            rows, position, orientation = poses.rows, poses.position, poses.orientation
            self._parts.complete(rows, time, position, orientation)
            usable = self.validity.take(rows, time, position=position, orientation=orientation, tracked=poses.tracked)
            self.playout.push(rows, time, position, orientation, usable, arrival=datagram.arrival)
        return frames

    def read(self, now: float) -> StreamReading:
        """Every sensor at `now`, s."""
        played, states = self.playout.read(now), self.validity.judge(now)
        times = SampleTimes(self.captured, self.last, float(np.fmax.reduce(played.time)))
        if self._smooth is None or self._camera:
            return StreamReading(played.position, played.orientation, states, times)
        if np.count_nonzero(states) and (gone := _GONE[states]).any():  # a reappearance elsewhere is no motion
            self._smooth.reset(gone)
        position, orientation = self._smooth.step(played.time, played.position, played.orientation)
        return StreamReading(position, orientation, states, times)
