"""A live source of the user's own: a function that returns new poses.

Its frames are encoded as poses in JSON (docs/live.md) and take the same steps as those of every stream.
"""

import json
from collections import deque
from collections.abc import Callable, Sequence
from math import inf, isfinite
from typing import Any

from hardware.clock import Clock
from retarget.human.samples import Performance
from retarget.live.admission import MOST_PER_POLL, Datagram
from retarget.live.begin import LiveOptions, begin_live, live_rate_hz
from retarget.live.open_stream import open_stream
from retarget.live.raw_recording import RawTap
from retarget.model.robot import RobotBody
from retarget.run.prepare import Perform
from retarget.schema.performer import Performer
from retarget.sources.streams.stream_frame import Dropped, StreamFrame
from retarget.types import Notify

Read = Callable[[float], Sequence[StreamFrame] | None]
"""From now, s on the run's clock, to the new frames, oldest first; None ends the source."""
OWN_SENDER = ("127.0.0.1", 0)  # the sender that admission sees
MOST_WAITING = 1024
"""Frames in the queue; further ones are dropped and counted."""


class OwnSource:
    """A `retarget.live.admission.Receiver` that polls a function.

    `read` is called in the thread of the ticks, before each of them, and every 10 ms during calibration. It must not
    block. An exception stops the robot and ends the run.
    """

    def __init__(self, read: Read) -> None:
        self.dropped = Dropped()
        self._read: Read | None = read
        self._last = -inf
        self._waiting: deque[Datagram] = deque()

    @property
    def finished(self) -> bool:
        """True if all frames are taken."""
        return self._read is None and not self._waiting

    def poll(self, now: float) -> list[Datagram]:
        """The frames until `now`, s, as datagrams. Raises the exceptions of the function."""
        for frame in self._read_once(now):
            if len(self._waiting) < MOST_WAITING:
                self._waiting.append(Datagram(now, OWN_SENDER, written(frame)))
            else:
                self.dropped.note("more frames than are taken")
        return [self._waiting.popleft() for _ in range(min(len(self._waiting), MOST_PER_POLL))]

    def _read_once(self, now: float) -> Sequence[StreamFrame]:
        if self._read is None or now <= self._last:
            return ()
        self._last = now
        frames = self._read(now)
        if frames is None:
            self._read = None
        return frames or ()

    def close(self) -> None:
        """Stop calling the function."""
        self._read = None
        self._waiting.clear()


def performing(
    read: Read,
    options: LiveOptions,
    *,
    clock: Clock,
    notify: Notify = lambda text: None,
    tap: RawTap | None = None,
) -> Perform:
    """A performance by a source of the user's own, for `prepare_for`. It raises InputError without data or sensors, or
    if the performer moves; UsageError if the performer cannot be measured."""

    def perform(performer: Performer, robot: RobotBody | None) -> Performance:
        source = OwnSource(read)
        stream = open_stream(
            None, performer, receiver=source, tap=tap, smoothing=options.smoothing, latest=options.latest
        )
        return begin_live(stream, options, clock=clock, rate_hz=live_rate_hz(robot), where="own source", notify=notify)

    return perform


def written(frame: StreamFrame) -> bytes:
    """A frame as a datagram of `retarget.sources.streams.json_pose`; NaN is left out."""
    poses: dict[str, dict[str, Any]] = {}
    rows = zip(frame.names, frame.position.tolist(), frame.orientation.tolist(), frame.tracked.tolist(), strict=True)
    for name, position, orientation, tracked in rows:
        pose = {key: value for key, value in (("p", position), ("q", orientation)) if all(map(isfinite, value))}
        if pose:
            poses[name] = pose if tracked else {**pose, "tracked": False}
    message: dict[str, Any] = {"axes": "rep103", "quaternion": "wxyz", "poses": poses}
    message |= {} if frame.stamp is None else {"time": float(frame.stamp)}
    message |= {} if frame.number is None else {"frame": int(frame.number)}
    return json.dumps(message).encode()
