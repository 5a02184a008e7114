"""The registers of a 2.0 servo that show its state: 120 (realtime tick) to 146 (temperature), in one piece."""

from struct import Struct

from hardware.dynamixel.control_table import ControlTable
from hardware.servo import ServoModel
from hardware.servo_lag import FULL_PWM
from sim.emulator.motion import Shaft
from sim.emulator.power import Electrics
from sim.servo_load import IDLE_CURRENT, LARGEST_CURRENT

FIRST, END = 120, 147
IN_POSITION = 16  # [tick] not documented
FOLLOWING_ERROR = 512  # [tick] not documented
MOTION, MOTION_END = 126, 136
"""Of it what hosts read most: current or load, velocity, position."""
_PIECE = Struct("<HBBhhiiiiHB")
_MOTION_PIECE = Struct("<hii")
_WRAP = 0x80000000  # positions are shown in 32 bits
_TICKS = 32768  # the realtime tick wraps, ms
_FULL_LOAD = 1000  # load register, 0.1 %


class Live:
    """Writes the state of one servo into its memory image."""

    def __init__(self, table: ControlTable, model: ServoModel, shaft: Shaft, electrics: Electrics) -> None:
        self._shaft = shaft
        self._electrics = electrics
        self.speed_unit = (table["present_velocity"].scale or 1.0) / model.tick_rad
        """One count of velocity, tick/s."""
        self._current_unit = (table["present_current"].scale or 1.0) if table.has("present_current") else 0.0
        self.tenths = 0
        """Input voltage as last taken, 0.1 V."""
        self._strained = self._warmth = 0
        self.take()
        assert table["realtime_tick"].address == FIRST and table["present_temperature"].end == END

    def take(self) -> None:
        """Take what changes slowly - current or load, voltage, temperature - as it is now."""
        electrics = self._electrics
        self._strained = self._strain()
        self.tenths = max(round(10.0 * electrics.voltage), 0)
        self._warmth = min(max(round(electrics.warmth), 0), 255)

    def motion(self) -> bytes:
        """The registers from MOTION up to MOTION_END."""
        shaft = self._shaft
        count = round(shaft.position)
        if not -_WRAP <= count < _WRAP:
            count = _wrapped(count)
        return _MOTION_PIECE.pack(self._strained, round(shaft.velocity / self.speed_unit), count)

    def show(self, image: bytearray, *, uptime: float, threshold: float) -> None:
        """Refresh the registers. uptime: s since the start; threshold: of moving, tick/s."""
        shaft = self._shaft
        velocity, position, path = shaft.velocity, shaft.position, shaft.path
        place, speed = (shaft.target, 0.0) if path is None and shaft.torque else self._trajectory()
        off = abs(place - position)
        status = (off <= IN_POSITION) if path is None else 2 | path.kind << 4
        if off > FOLLOWING_ERROR:
            status |= 8
        count = round(position)
        if not -_WRAP <= count < _WRAP or not -_WRAP <= place < _WRAP:
            count, place = _wrapped(count), _wrapped(round(place))
        unit = self.speed_unit
        _PIECE.pack_into(
            image,
            FIRST,
            int(1000.0 * uptime) % _TICKS,
            abs(velocity) > threshold,
            status,
            round(FULL_PWM * shaft.drive()),
            self._strained,
            round(velocity / unit),
            count,
            round(speed / unit),
            round(place),
            self.tenths,
            self._warmth,
        )

    def _trajectory(self) -> tuple[float, float]:
        return self._shaft.trajectory() if self._shaft.torque else (self._shaft.position, 0.0)

    def _strain(self) -> int:
        """Present current in counts, or present load."""
        electrics = self._electrics
        if self._current_unit:
            return min(max(round(electrics.direction * electrics.current / self._current_unit), -32768), 32767)
        share = (electrics.current - IDLE_CURRENT) / (LARGEST_CURRENT)
        return round(electrics.direction * _FULL_LOAD * min(max(share, 0.0), 1.0))


def _wrapped(position: int) -> int:
    """A position as the 32 bits of its register show it."""
    return (position + _WRAP & 2 * _WRAP - 1) - _WRAP
