"""States of all servos of a robot: values, errors, ages. A silent servo keeps its last values and is marked."""

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
"""Alert bits of an error that is not read yet."""

_ALERTS1 = (
    (Error1.INPUT_VOLTAGE, ServoAlert.INPUT_VOLTAGE),
    (Error1.OVERHEATING, ServoAlert.OVERHEATING),
    (Error1.OVERLOAD, ServoAlert.OVERLOAD),
)


class ReportedTorque(IntEnum):
    """Torque that a servo reported last."""

    UNKNOWN = 0
    OFF = 1
    ON = 2
    HELD = 3
    """On, but stopped by its watchdog."""


_ON = int(ReportedTorque.ON)


@dataclass(frozen=True, slots=True)
class Names:
    """Names of the registers that a cycle reads. motion, wide: first and last register of the two blocks. direction:
    mask of the clockwise bit of the velocity, or 0. latches: a register holds the errors, else the error byte."""

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
    """The names for a table. In the older layout a few bytes hold all values."""
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

    def take(
        self, columns: NDArray[np.int64], rows: NDArray[np.void], names: Names, now: float, valid: BoolArray
    ) -> None:
        """Take the values that servos `columns` (k,) answered at `now`, s. valid (n,): those that answered."""
        self._voltage[columns] = rows[names.voltage]
        self._temperature[columns] = rows[names.temperature]
        self._at[columns] = now
        late = (self._at < now - 2.0 * SLOW_PERIOD) & valid
        self._due = now if late.any() else now + SLOW_PERIOD

    def due(self, now: float, valid: BoolArray) -> bool:
        """Return True if values of a servo that answered in the last cycle are due, or none is known."""
        if now < self._due:
            return False
        old = self._at < now - SLOW_PERIOD
        return bool((old & valid).any()) or not np.isfinite(self._at).any()

    def values(self, now: float) -> tuple[FloatArray, FloatArray]:
        """Return voltages, V, and temperatures, degrees Celsius, (n,); NaN beyond UNREAD_AFTER_S."""
        known = self._at >= now - UNREAD_AFTER_S
        return np.where(known, self._voltage * self._unit, np.nan), np.where(known, self._temperature, np.nan)


class Readings:
    """States of n servos in servo order. turns (n,): forgotten whole turns, ticks added to positions. drive (n,):
    `ReportedTorque` values. slow: voltages and temperatures."""

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
        """Begin a cycle."""
        self._valid[:] = False

    def take(self, columns: NDArray[np.int64], rows: NDArray[np.void], errors: bytes, names: Names, now: float) -> None:
        """Take the rows (k,) and error bytes (k) of a block that servos `columns` (k,) answered at `now`, s."""
        self._position[columns] = rows[names.position] + self.turns[columns]
        if names.current is not None:
            self._current[columns] = rows[names.current]
        speed = rows[names.velocity]
        if names.direction:
            size = (speed & names.direction - 1).astype(np.int64)
            speed = np.where(speed & names.direction, -size, size)
        self._velocity[columns] = speed
        if self._faulty or any(errors):
            self._take_errors(columns, np.frombuffer(errors, np.uint8), names)
        self._valid[columns] = True
        self._answered[columns] = now
        if names.voltage in (rows.dtype.names or ()):
            self.slow.take(columns, rows, names, now, self._valid)

    def _take_errors(self, columns: NDArray[np.int64], errors: NDArray[np.uint8], names: Names) -> None:
        if not names.latches:
            self._alert[columns] = sum(np.where(errors & ours, theirs, 0) for ours, theirs in _ALERTS1)
        else:
            # A later read shows which error it is. An answer without ALERT ends it.
            known = np.maximum(self._alert[columns], UNKNOWN_ALERT * (self._alert[columns] == 0))
            self._alert[columns] = np.where(errors & ALERT, known, 0)
        self._error[columns] = errors
        self._count_faulty()

    def _count_faulty(self) -> None:
        self._faulty = int(np.count_nonzero(self._error | self._alert))

    def alarmed(self) -> list[int]:
        """The servos whose error is not read yet."""
        return np.flatnonzero(self._alert == UNKNOWN_ALERT).tolist() if self._faulty else []

    def take_alert(self, servo: int, bits: int) -> None:
        """Take a servo's Hardware Error Status. Zero leaves an error unknown."""
        if bits:
            self._alert[servo] = bits
            self._count_faulty()

    @property
    def driven(self) -> BoolArray:
        """Mask (n,) of servos that follow their goals."""
        on: BoolArray = self.drive == _ON
        return on

    @property
    def valid(self) -> BoolArray:
        """Copy of the mask (n,) of servos that answered in this cycle."""
        return self._valid.copy()

    @property
    def complete(self) -> bool:
        """True if all servos have answered in this cycle."""
        return bool(self._valid.all())

    def states(
        self, now: float, *, retries: int = 0, error_rate: float = 0.0, imu: ImuSample | None = None
    ) -> ServoStates:
        """The states as of `now`, s."""
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
    scale = None if name is None else table[name].scale
    return float("nan") if scale is None else scale
