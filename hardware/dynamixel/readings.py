"""The states of all servos of a robot: values, errors, ages. A silent servo keeps its last values and is marked."""

from collections.abc import Sequence
from dataclasses import dataclass
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

from hardware.arrays import BoolArray, FloatArray, TickArray
from hardware.bus import UNREAD_AFTER_S, ServoAlert, ServoStates
from hardware.dynamixel.codec import ALERT, Error1
from hardware.dynamixel.control_table import ControlTable
from hardware.imu import ImuSample
from hardware.servo import Layout

SLOW_PERIOD = 0.2
"""[s] Between two reads of voltage and temperature."""
UNKNOWN_ALERT = 0x80
"""Alert bits of a servo that reports an error, until it is read which."""

_ALERTS1 = (
    (Error1.INPUT_VOLTAGE, ServoAlert.INPUT_VOLTAGE),
    (Error1.OVERHEATING, ServoAlert.OVERHEATING),
    (Error1.OVERLOAD, ServoAlert.OVERLOAD),
)


class ReportedTorque(IntEnum):
    """The torque that a servo reported last."""

    UNKNOWN = 0
    OFF = 1
    ON = 2
    HELD = 3
    """On, and stopped by its watchdog: it follows no goal."""


_ON = int(ReportedTorque.ON)


@dataclass(frozen=True, slots=True)
class Names:
    """The registers that a cycle reads: first and last of the motion block and of the wide one, and what they mean.

    direction: the bit of the velocity that says clockwise, as a mask; 0: two's complement. latches: whether a register
    says which errors a servo reports; else its error byte does.
    """

    motion: tuple[str, str]
    wide: tuple[str, str]
    position: str
    velocity: str
    current: str | None
    voltage: str
    temperature: str
    direction: int
    latches: bool


def names_of(table: ControlTable) -> Names:
    """The names for a servo's table; a servo that reports a load reports no current. In the older layout a few bytes
    hold all values."""
    latches, position, last = table.has("hardware_error_status"), "present_position", "present_temperature"
    if table.layout is Layout.OLDER:
        wide, speed = (position, last), "present_speed"
        direction = 1 << (table[speed].direction_bit or 0)
        return Names(wide, wide, position, speed, None, "present_voltage", last, direction, latches)
    current = "present_current" if table.has("present_current") else None
    first = current or "present_load"
    motion, wide = (first, position), (first, last)
    return Names(motion, wide, position, "present_velocity", current, "present_input_voltage", last, 0, latches)


class SlowValues:
    """Voltages and temperatures of n servos, which are read now and then."""

    def __init__(self, tables: Sequence[ControlTable]) -> None:
        self._unit = np.array([_scale(table, names_of(table).voltage) for table in tables])
        self._voltage, self._temperature = np.full(len(tables), np.nan), np.full(len(tables), np.nan)
        self._at = np.full(len(tables), -np.inf)  # [s] when they were read
        self._due = -np.inf  # [s] when they are due again, at the earliest

    def take(self, who: NDArray[np.int64], rows: NDArray[np.void], names: Names, now: float, valid: BoolArray) -> None:
        """Take the values that servos `who` (k,) answered at `now`, s. valid (n,): who has answered in this cycle."""
        self._voltage[who] = rows[names.voltage]
        self._temperature[who] = rows[names.temperature]
        self._at[who] = now
        late = (self._at < now - 2.0 * SLOW_PERIOD) & valid
        self._due = now if late.any() else now + SLOW_PERIOD

    def due(self, now: float, valid: BoolArray) -> bool:
        """Return whether values of a servo that answered in the last cycle are due; at first those of all are."""
        if now < self._due:
            return False
        old = self._at < now - SLOW_PERIOD
        return bool((old & valid).any()) or not np.isfinite(self._at).any()

    def values(self, now: float) -> tuple[FloatArray, FloatArray]:
        """Voltages, V, and temperatures, degrees Celsius, (n,); NaN beyond UNREAD_AFTER_S."""
        known = self._at >= now - UNREAD_AFTER_S
        return np.where(known, self._voltage * self._unit, np.nan), np.where(known, self._temperature, np.nan)


class Readings:
    """The states of the servos whose tables are `tables` (n,), in servo order.

    turns (n,): ticks to add to reported positions, whole turns that a servo has forgotten. drive (n,): the torque that
    each reported last, as `ReportedTorque` values. slow: voltages and temperatures.
    """

    def __init__(self, tables: Sequence[ControlTable]) -> None:
        count = len(tables)
        names = [names_of(table) for table in tables]
        self._velocity_unit = np.array([_scale(t, n.velocity) for t, n in zip(tables, names, strict=True)])
        self._current_unit = np.array([_scale(t, n.current) for t, n in zip(tables, names, strict=True)])
        self.turns: TickArray = np.zeros(count, dtype=np.int64)
        self.drive = np.full(count, ReportedTorque.UNKNOWN, dtype=np.uint8)
        self._position = np.zeros(count, dtype=np.int64)
        self._velocity, self._current = np.zeros(count), np.full(count, np.nan)
        self.slow = SlowValues(tables)
        self._error, self._alert = np.zeros(count, dtype=np.uint8), np.zeros(count, dtype=np.uint8)
        self._faulty = 0  # servos with an error or an alert
        self._valid = np.zeros(count, dtype=np.bool_)
        self._answered = np.full(count, -np.inf)  # [s]

    def begin(self) -> None:
        """Begin a cycle: no servo has answered yet."""
        self._valid[:] = False

    def take(self, who: NDArray[np.int64], rows: NDArray[np.void], errors: bytes, names: Names, now: float) -> None:
        """Take the values that servos `who` (k,) answered at `now`, s: rows (k,) of a block, error bytes (k)."""
        self._position[who] = rows[names.position] + self.turns[who]
        if names.current is not None:
            self._current[who] = rows[names.current]
        speed = rows[names.velocity]
        if names.direction:
            size = (speed & names.direction - 1).astype(np.int64)
            speed = np.where(speed & names.direction, -size, size)
        self._velocity[who] = speed
        if self._faulty or any(errors):
            self._take_errors(who, np.frombuffer(errors, np.uint8), names)
        self._valid[who] = True
        self._answered[who] = now
        if names.voltage in (rows.dtype.names or ()):
            self.slow.take(who, rows, names, now, self._valid)

    def _take_errors(self, who: NDArray[np.int64], errors: NDArray[np.uint8], names: Names) -> None:
        if not names.latches:
            self._alert[who] = sum(np.where(errors & ours, theirs, 0) for ours, theirs in _ALERTS1)
        else:
            # Which error it is, a read shows later. An answer without ALERT ends it.
            known = np.maximum(self._alert[who], UNKNOWN_ALERT * (self._alert[who] == 0))
            self._alert[who] = np.where(errors & ALERT, known, 0)
        self._error[who] = errors
        self._count_faulty()

    def _count_faulty(self) -> None:
        self._faulty = int(np.count_nonzero(self._error | self._alert))

    def alarmed(self) -> list[int]:
        """Servos that report an error of which it is not known yet which it is."""
        return np.flatnonzero(self._alert == UNKNOWN_ALERT).tolist() if self._faulty else []

    def take_alert(self, servo: int, bits: int) -> None:
        """Take a servo's Hardware Error Status; without bits, an error that it reports stays unknown."""
        if bits:
            self._alert[servo] = bits
            self._count_faulty()

    @property
    def driven(self) -> BoolArray:
        """Mask (n,) of the servos that follow their goals, by their last report."""
        on: BoolArray = self.drive == _ON
        return on

    @property
    def valid(self) -> BoolArray:
        """Mask (n,) of the servos that have answered in this cycle; a copy."""
        return self._valid.copy()

    @property
    def complete(self) -> bool:
        """Whether all servos have answered in this cycle."""
        return bool(self._valid.all())

    def states(
        self, now: float, *, retries: int = 0, error_rate: float = 0.0, imu: ImuSample | None = None
    ) -> ServoStates:
        """The states as of `now`, s. They never change later."""
        voltage, temperature = self.slow.values(now)
        age = np.zeros(len(self.turns))
        if not self.complete:
            age = np.where(self._valid, age, np.maximum(now - self._answered, 0.0))
        return ServoStates(
            time=now,
            position=self._position.copy(),
            velocity=self._velocity * self._velocity_unit,
            current=self._current * self._current_unit,
            voltage=voltage,
            temperature=temperature,
            error=self._error.copy(),
            alert=self._alert.copy(),
            age=age,
            valid=self._valid.copy(),
            driven=self.driven,
            retries=retries,
            error_rate=error_rate,
            imu=imu,
        )


def _scale(table: ControlTable, name: str | None) -> float:
    """SI per step of a register; NaN without one."""
    scale = None if name is None else table[name].scale
    return float("nan") if scale is None else scale
