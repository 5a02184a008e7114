"""A BNO08x in UART-RVC mode on a serial line of its own: it sends a frame every 10 ms."""

import math

from hardware.bno08x import PERIOD, RvcFrame, encoded
from hardware.clock import Clock
from hardware.errors import BusError, describe
from hardware.imu import STANDARD_GRAVITY, ImuReading
from sim.imu import ImuStandIn, roll_pitch_yaw

MOST_FRAMES = 50
"""Frames that the adapter keeps for a host that does not read."""


class EmulatedBno08x:
    """A `hardware.dynamixel.serial_port.BytePort` that returns the measurements of `sensor` as frames."""

    latency = 1e-3

    def __init__(self, sensor: ImuStandIn, clock: Clock, *, name: str = "emulated BNO08x") -> None:
        self.sensor, self.name, self.baud = sensor, name, 0
        self._clock, self._index = clock, 0
        self._due: float | None = None  # [s] when the next frame is sent; None while it is closed

    def open(self, baud: int) -> None:
        """Open it; the next frame comes within one period."""
        self._due = self._clock.now() + PERIOD
        self.set_baud(baud)

    def set_baud(self, baud: int) -> None:
        """Set the host's speed."""
        self.baud = baud

    def write(self, data: bytes) -> None:
        """Do nothing: the mode has no commands."""

    def read(self) -> bytes:
        """Return what has arrived by now. Raises BusError when it is closed."""
        if self._due is None:
            raise BusError(describe(what="the port is closed", where=self.name, then="Open it first"))
        now, frames = self._clock.now(), []
        if now - self._due > MOST_FRAMES * PERIOD:
            skipped = math.floor((now - self._due) / PERIOD) - MOST_FRAMES
            self._due, self._index = self._due + skipped * PERIOD, self._index + skipped
        while self._due <= now:
            reading = self.sensor.measure(self._due)
            if reading is not None:
                frames.append(encoded(frame_of(reading, self._index)))
            self._due, self._index = self._due + PERIOD, self._index + 1
        return b"".join(frames)

    def wait(self, deadline: float) -> bool:
        """Sleep until the next frame (True) or until `deadline`, s."""
        due = math.inf if self._due is None else self._due
        self._clock.sleep_until(min(due, deadline))
        return due <= self._clock.now()

    def drop(self) -> None:
        """Forget what has arrived."""
        self.read()

    def now(self) -> float:
        """Time of the clock, s."""
        return self._clock.now()

    def sleep_until(self, deadline: float) -> None:
        """Sleep until `deadline`, s of the clock."""
        self._clock.sleep_until(deadline)

    def close(self) -> None:
        """Close it; twice is allowed."""
        self._due = None


def frame_of(reading: ImuReading, index: int) -> RvcFrame:
    """The frame of a reading with an orientation, clipped to its range."""
    assert reading.orientation is not None, "the sensor has one"
    roll, pitch, yaw = (round(100.0 * math.degrees(one)) for one in roll_pitch_yaw(reading.orientation))
    x, y, z = (min(max(round(1e3 * one / STANDARD_GRAVITY), -0x8000), 0x7FFF) for one in reading.acceleration)
    return RvcFrame(index % 256, (yaw, pitch, roll), (x, y, z))
