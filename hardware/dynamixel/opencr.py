"""The OpenCR board of an OP3 as a device on the bus: the switch of the servos' power, and an IMU.

Source: ROBOTIS' firmware opencr_op3 (dxl_node_op3.h; NUbots' OpenCR.hpp agrees) for the registers, open_cr_module of
ROBOTIS-OP3 for the units. Not verified on hardware.
"""

import math
import struct
from functools import cached_property

from hardware.dynamixel.control_table import ControlTable, row_registers, rows_of
from hardware.dynamixel.cyclic import LOST_AFTER, PROBE_PERIOD, BusLine, ReadKind, ReadRequest, Timeouts
from hardware.imu import STANDARD_GRAVITY, ImuReading, ImuSpec, ImuTracker, from_roll_pitch_yaw

ID, NUMBER = 200, 0x7400
"""As delivered."""
IMU_CONTROL = 50
GYRO_UNIT = math.radians(2000.0 / 32800.0)
"""[rad/s] per count."""
FORCE_UNIT = 2.0 / 32768.0 * STANDARD_GRAVITY
"""[m/s^2] per count."""
ANGLE_UNIT = math.radians(0.1)
"""[rad] per count of roll, pitch and yaw."""
FULL_SCALE = 32767
"""[count] End of the gyroscope's range, which no robot reaches."""
MOST_ANGLE = 3600
"""[count] Largest angle: half a turn and the firmware's offset."""
IMU_NAMES = ("gyro_x", "gyro_y", "gyro_z", "acc_x", "acc_y", "acc_z", "roll", "pitch", "yaw")
IMU_FIRST = 32  # register address
_MEASURED = struct.Struct("<9h")
TABLE = ControlTable(  # OpenCR's own registers
    model="OpenCR",
    number=NUMBER,
    protocol=2,
    firmware=(0, 255),
    usual_firmware=2,
    fast_since=None,
    modes=(),
    baud_family="x",
    registers=tuple(register for row in rows_of("opencr.tsv") for register in row_registers(row)),
)


def imu_reading(data: bytes) -> ImuReading | None:
    """The measurement in the 18 bytes from IMU_FIRST; None for an impossible turn or angle."""
    a, b, c, x, y, z, roll, pitch, yaw = _MEASURED.unpack(data)
    if max(abs(a), abs(b), abs(c)) >= FULL_SCALE or max(abs(roll), abs(pitch), abs(yaw)) > MOST_ANGLE:
        return None
    return ImuReading(
        from_roll_pitch_yaw(ANGLE_UNIT * roll, ANGLE_UNIT * pitch, ANGLE_UNIT * yaw),
        (GYRO_UNIT * a, GYRO_UNIT * b, GYRO_UNIT * c),
        (FORCE_UNIT * x, FORCE_UNIT * y, FORCE_UNIT * z),
    )


class OpenCrImu:
    """The IMU of the board on a line, an `ImuDevice`. It is polled right after the goals, and answers while the host
    computes. A silent board is probed like a lost servo."""

    def __init__(self, line: BusLine, spec: ImuSpec) -> None:
        self._line, self.tracker = line, ImuTracker(spec)
        self._request = ReadRequest(ReadKind.SINGLE2, (spec.id,), IMU_FIRST, _MEASURED.size)
        self._packet, self._enough = self._request.packet(), self._request.bytes_of(1)
        self._sent: float | None = None  # [s] of the request, until its answer is taken
        self._missed, self._due = 0, -math.inf  # answers in a row; [s] of the next probe of a silent board

    def post(self) -> None:
        """Request a measurement unless the board is lost."""
        wire = self._line.cyclic.wire
        if self._missed >= LOST_AFTER and wire.port.now() < self._due:
            return
        wire.request(self._packet)
        self._sent = wire.requested_at

    def collect(self) -> bool:
        """Take the answer, if one is due. Return True if it had not come yet."""
        if self._sent is None:
            return False
        port, sent, data = self._line.port, self._sent, b""
        self._sent, received = None, port.read()
        late = not received
        if len(received) >= self._enough:
            data = self._request.answers(received).data
        end = sent + self._timeouts.whole
        while not data and port.wait(end):
            received += port.read()
            if len(received) >= self._enough:
                data = self._request.answers(received).data
        if data:
            self._missed = 0
            self.tracker.take(imu_reading(data), sent)
        else:
            self._missed += 1
            self._due = port.now() + PROBE_PERIOD
        return late

    @cached_property
    def _timeouts(self) -> Timeouts:
        return self._request.timeouts(self._line.port, self._line.longest_delay)
