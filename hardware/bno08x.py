"""A BNO08x in UART-RVC mode: 100 frames a second at 115,200 baud, unasked.

Source: BNO08X datasheet (CEVA/Hillcrest), UART-RVC. A frame has 19 bytes: AA AA, a count of frames, yaw, pitch
and roll (int16, 0.01 degree; applied in this order), acceleration along x, y, z (int16, mg, with gravity), three
reserved bytes, and the sum of the 16 bytes before it, modulo 256. The mode has no gyroscope: the angular velocity is
the change of the orientation from frame to frame, in steps of 0.017 rad/s.
"""

import math
import struct
from collections.abc import Iterator
from typing import NamedTuple

from hardware.dynamixel.serial_port import BytePort
from hardware.imu import (
    GRAVITY,
    ImuFault,
    ImuReading,
    ImuSample,
    ImuSpec,
    ImuTracker,
    Quat,
    from_roll_pitch_yaw,
    product,
)

HEADER = b"\xaa\xaa"
_BODY = struct.Struct("<B6h3xB")
FRAME_BYTES = len(HEADER) + _BODY.size
PERIOD = 0.01
"""[s] Between two frames."""
LONGEST_GAP = 10
"""Frames over which the change of the orientation is still a velocity."""
MOST_BYTES = 50 * FRAME_BYTES
"""Bytes that are looked at in one cycle: half a second; older ones are dropped."""
HALF_TURN, QUARTER_TURN = 18000, 9000
"""[0.01 degree] Ranges of yaw and roll, and of pitch."""


class RvcFrame(NamedTuple):
    """A frame. number: counts frames, modulo 256. angles: yaw, pitch, roll, 0.01 degree; acceleration: mg."""

    number: int
    angles: tuple[int, int, int]
    acceleration: tuple[int, int, int]

    @property
    def orientation(self) -> Quat:
        """Of the sensor, wxyz."""
        yaw, pitch, roll = (math.radians(0.01 * one) for one in self.angles)
        return from_roll_pitch_yaw(roll, pitch, yaw)


class RvcDecoder:
    """Finds frames in what a serial line brings, whatever its pieces. damaged: bytes that belong to no valid frame."""

    def __init__(self) -> None:
        self._rest = b""
        self.damaged = 0

    def feed(self, data: bytes) -> Iterator[RvcFrame]:
        """The frames that are whole with these bytes. Never raises."""
        data = self._rest + data
        if len(data) > MOST_BYTES:
            self.damaged += len(data) - MOST_BYTES
            data = data[-MOST_BYTES:]
        at = 0
        while len(data) - at >= FRAME_BYTES:
            frame = frame_of(data[at : at + FRAME_BYTES])
            if frame is None:
                following = data.find(HEADER[:1], at + 1)
                following = len(data) if following < 0 else following
                self.damaged += following - at
                at = following
            else:
                at += FRAME_BYTES
                yield frame
        self._rest = data[at:]


def frame_of(data: bytes) -> RvcFrame | None:
    """The frame in these 19 bytes; None: damaged, or angles that the sensor never sends."""
    if not data.startswith(HEADER) or sum(data[len(HEADER) : -1]) % 256 != data[-1]:
        return None
    number, yaw, pitch, roll, x, y, z, _ = _BODY.unpack_from(data, len(HEADER))
    if max(abs(yaw), abs(roll)) > HALF_TURN or abs(pitch) > QUARTER_TURN:
        return None
    return RvcFrame(number, (yaw, pitch, roll), (x, y, z))


def encoded(frame: RvcFrame) -> bytes:
    """The bytes of a frame."""
    body = _BODY.pack(frame.number, *frame.angles, *frame.acceleration, 0)[:-1]
    return HEADER + body + bytes((sum(body) % 256,))


class SerialImu:
    """The sensor at an open port, as a `hardware.imu.ImuDevice`. decoder: counts damage."""

    def __init__(self, spec: ImuSpec, port: BytePort) -> None:
        self.port, self.decoder = port, RvcDecoder()
        self._tracker = ImuTracker(spec)
        self._before: RvcFrame | None = None

    def post(self) -> None:
        """Do nothing: it sends by itself."""

    def collect(self) -> bool:
        """Take the frames that have come, and wait for none. Raises BusError when the port is gone."""
        data = self.port.read()
        frames = list(self.decoder.feed(data)) if data else []
        now = self.port.now()
        for later, frame in zip(reversed(range(len(frames))), frames, strict=True):
            self._take(frame, now - later * PERIOD)
        return False

    def sample(self, now: float) -> ImuSample:
        """The newest measurement, as of `now`, s."""
        return self._tracker.sample(now)

    @property
    def fault(self) -> ImuFault | None:
        """Why the sample that was given last is not valid."""
        return self._tracker.fault

    def _take(self, frame: RvcFrame, time: float) -> None:
        before, self._before = self._before, frame
        passed = 0 if before is None else (frame.number - before.number) % 256
        if before is None or not 0 < passed <= LONGEST_GAP:
            return
        w, x, y, z = before.orientation
        w, *axis = product((w, -x, -y, -z), frame.orientation)
        size = math.hypot(*axis)
        turn = 2.0 * math.atan2(size, abs(w)) / (passed * PERIOD)
        rate = math.copysign(turn / size, w) if size > 0.0 else 0.0
        force = tuple(1e-3 * GRAVITY * one for one in frame.acceleration)
        reading = ImuReading(frame.orientation, (rate * axis[0], rate * axis[1], rate * axis[2]), force)  # type: ignore[arg-type]
        self._tracker.take(reading, time)
