"""A BNO08x in UART-RVC mode, which sends 100 frames per second at 115,200 baud.

Source: BNO08X datasheet (CEVA/Hillcrest), UART-RVC. A frame has 19 bytes: AA AA, a counter, yaw, pitch and roll (int16,
0.01 degree, applied in this order), acceleration x, y, z (int16, mg, with gravity), three reserved bytes, and the sum
of the 16 bytes before, modulo 256. The angular velocity is derived, in steps of 0.017 rad/s.
"""

import math
import struct
from collections.abc import Iterator
from typing import NamedTuple

from hardware.dynamixel.serial_port import BytePort
from hardware.imu import (
    STANDARD_GRAVITY,
    ImuReading,
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
"""[s] Between frames."""
LONGEST_GAP = 10
"""Frames over which an angle gives a velocity."""
MOST_BYTES = 50 * FRAME_BYTES
"""Bytes decoded per cycle, half a second."""
MOST_YAW, MOST_PITCH = 18000, 9000
"""[0.01 degree] Ranges of yaw and roll, and of pitch."""


class RvcFrame(NamedTuple):
    """A frame. number: counter, modulo 256. angles: yaw, pitch, roll, 0.01 degree. acceleration: mg."""

    number: int
    angles: tuple[int, int, int]
    acceleration: tuple[int, int, int]

    @property
    def orientation(self) -> Quat:
        """Orientation of the sensor, wxyz."""
        yaw, pitch, roll = (math.radians(0.01 * one) for one in self.angles)
        return from_roll_pitch_yaw(roll, pitch, yaw)


class RvcDecoder:
    """Finds frames in a stream of bytes. damaged: bytes that belong to no valid frame."""

    def __init__(self) -> None:
        self._rest = b""
        self.damaged = 0

    def feed(self, data: bytes) -> Iterator[RvcFrame]:
        """Yield the frames that these bytes complete."""
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
    """The frame in 19 bytes; None if damaged, or with impossible angles."""
    if not data.startswith(HEADER) or sum(data[len(HEADER) : -1]) % 256 != data[-1]:
        return None
    number, yaw, pitch, roll, x, y, z, _ = _BODY.unpack_from(data, len(HEADER))
    if max(abs(yaw), abs(roll)) > MOST_YAW or abs(pitch) > MOST_PITCH:
        return None
    return RvcFrame(number, (yaw, pitch, roll), (x, y, z))


def encoded(frame: RvcFrame) -> bytes:
    """The bytes of a frame."""
    body = _BODY.pack(frame.number, *frame.angles, *frame.acceleration, 0)[:-1]
    return HEADER + body + bytes((sum(body) % 256,))


class SerialImu:
    """The sensor at an open port, an `ImuDevice`."""

    def __init__(self, spec: ImuSpec, port: BytePort) -> None:
        self.port, self.decoder = port, RvcDecoder()
        self.tracker = ImuTracker(spec)
        self._before: RvcFrame | None = None

    def post(self) -> None:
        """Do nothing: the sensor sends by itself."""

    def collect(self) -> bool:
        """Take the frames that have come, without waiting."""
        data = self.port.read()
        frames = list(self.decoder.feed(data)) if data else []
        now = self.port.now()
        for later, frame in zip(reversed(range(len(frames))), frames, strict=True):
            self._take(frame, now - later * PERIOD)
        return False

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
        force = tuple(1e-3 * STANDARD_GRAVITY * one for one in frame.acceleration)
        reading = ImuReading(frame.orientation, (rate * axis[0], rate * axis[1], rate * axis[2]), force)  # type: ignore[arg-type]
        self.tracker.take(reading, time)
