"""A live source of one's own: a function that is asked for the newest poses, in place of a socket.

What it says goes the way of every stream: admission, clock, trust, playout, calibration, holds. It is written as poses
in JSON (docs/json-input.md) in between, so that a tap keeps it and `replay://` plays it again.
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
from retarget.live.open_stream import stream_of
from retarget.live.raw_recording import RawTap
from retarget.model.robot import RobotBody
from retarget.run.prepare import Perform
from retarget.schema.performer import Performer
from retarget.sources.stream_frame import Dropped, StreamFrame

__all__ = ["OwnSource", "Read", "performing"]

Read = Callable[[float], Sequence[StreamFrame] | None]
"""From now, s of the run's clock, to the frames that came since it was last asked, oldest first; None: it is over."""
HERE = ("127.0.0.1", 0)
"""The sender, as whoever admits senders is told: this program."""
MOST_WAITING = 1024
"""Frames that may wait to be taken, as datagrams wait in the kernel; what comes after them is lost, and counted."""


class OwnSource:
    """A `retarget.live.admission.Receiver` that asks a function of one's own.

    `read` is called in the thread of the ticks, before each of them (and every 10 ms while the performer is measured):
    it must not wait. A tracker that is waited for belongs into a thread that fills a `queue.SimpleQueue`. What `read`
    raises ends the run: with the robot braked, if it moves.
    """

    def __init__(self, read: Read) -> None:
        self.dropped = Dropped()
        self._read: Read | None = read
        self._last = -inf
        self._waiting: deque[Datagram] = deque()

    @property
    def finished(self) -> bool:
        """Whether the source is over, and all that it said is taken."""
        return self._read is None and not self._waiting

    def poll(self, now: float) -> list[Datagram]:
        """What the function says until `now`, s. Never blocks; raises what the function raises."""
        for frame in self._asked(now):
            if len(self._waiting) < MOST_WAITING:
                self._waiting.append(Datagram(now, HERE, written(frame)))
            else:
                self.dropped.note("more frames than are taken")
        return [self._waiting.popleft() for _ in range(min(len(self._waiting), MOST_PER_POLL))]

    def _asked(self, now: float) -> Sequence[StreamFrame]:
        """What the function says. Whoever polls until nothing comes asks once: an instant has one answer."""
        if self._read is None or now <= self._last:
            return ()
        self._last = now
        frames = self._read(now)
        if frames is None:
            self._read = None
        return frames or ()

    def close(self) -> None:
        """Ask no more."""
        self._read = None
        self._waiting.clear()


def performing(
    read: Read,
    options: LiveOptions,
    *,
    clock: Clock,
    notify: Callable[[str], object] = lambda text: None,
    tap: RawTap | None = None,
    where: str = "own source",
) -> Perform:
    """Who performs by a source of one's own, for `retarget.run.prepare.prepare_for`.

    clock: that of the run, whose time `read` is given. tell: hears what the performer is to do, and what changes. tap:
    keeps what came. where: what messages call the source. Whoever is asked to perform raises InputError: no data,
    sensors missing, nobody who stands still; UsageError: a performer who cannot be measured.
    """

    def perform(performer: Performer, robot: RobotBody | None) -> Performance:
        source = OwnSource(read)
        stream = stream_of(source, performer, tap=tap, smoothing=options.smoothing, latest=options.latest)
        return begin_live(stream, options, clock=clock, rate_hz=live_rate_hz(robot), where=where, notify=notify)

    return perform


def written(frame: StreamFrame) -> bytes:
    """A frame as a datagram of `retarget.sources.json_pose`; what is NaN is left out."""
    poses: dict[str, dict[str, Any]] = {}
    rows = zip(frame.names, frame.position.tolist(), frame.orientation.tolist(), frame.tracked.tolist(), strict=True)
    for name, position, orientation, tracked in rows:
        told = {key: value for key, value in (("p", position), ("q", orientation)) if all(map(isfinite, value))}
        if told:
            poses[name] = told if tracked else {**told, "tracked": False}
    message: dict[str, Any] = {"axes": "rep103", "quaternion": "wxyz", "poses": poses}
    message |= {} if frame.stamp is None else {"time": float(frame.stamp)}
    message |= {} if frame.number is None else {"frame": int(frame.number)}
    return json.dumps(message).encode()
