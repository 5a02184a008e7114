"""The states of all servos of a robot: values, errors, ages. A silent servo keeps its last values and is marked."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from hardware.arrays import BoolArray, TickArray
from hardware.bus import ServoAlert, ServoStates
from hardware.dynamixel.codec import ALERT, Error1
from hardware.dynamixel.control_table import ControlTable

Scalar = TypeVar("Scalar", bound=np.generic)

SLOW_PERIOD = 0.2
"""[s] Between two reads of voltage and temperature."""
SLOW_AGE = 3.0
"""[s] After which their values are forgotten."""
UNKNOWN_ALERT = 0x80
"""Alert bits of a servo that reports an error, until it is read which."""

_ALERTS1 = (
    (Error1.INPUT_VOLTAGE, ServoAlert.INPUT_VOLTAGE),
    (Error1.OVERHEATING, ServoAlert.OVERHEATING),
    (Error1.OVERLOAD, ServoAlert.OVERLOAD),
)
_SIGN1, _SIZE1 = 0x400, 0x3FF  # direction and size of a 1.0 speed


@dataclass(frozen=True, slots=True)
class Names:
    """The registers that a cycle reads: first and last of the motion block and of the wide one, and what they mean."""

    motion: tuple[str, str]
    wide: tuple[str, str]
    position: str
    velocity: str
    current: str | None
    voltage: str
    temperature: str


_ALL1 = ("present_position", "present_temperature")
NAMES1 = Names(_ALL1, _ALL1, _ALL1[0], "present_speed", None, "present_voltage", _ALL1[1])
"""The names for protocol 1.0: eight bytes hold all values."""


def names_of(table: ControlTable) -> Names:
    """The names for a servo's table; a servo that reports a load reports no current."""
    if table.protocol == 1:
        return NAMES1
    current = "present_current" if table.has("present_current") else None
    first, position, last = current or "present_load", "present_position", "present_temperature"
    wide = (first, last)
    return Names((first, position), wide, position, "present_velocity", current, "present_input_voltage", last)


class Readings:
    """The states of the servos whose tables are `tables` (n,), in servo order."""

    def __init__(self, tables: Sequence[ControlTable]) -> None:
        count = len(tables)
        names = [names_of(table) for table in tables]
        self._velocity_unit = np.array([_scale(t, n.velocity) for t, n in zip(tables, names, strict=True)])
        self._current_unit = np.array([_scale(t, n.current) for t, n in zip(tables, names, strict=True)])
        self._voltage_unit = np.array([_scale(t, n.voltage) for t, n in zip(tables, names, strict=True)])
        self._turns, self._turned = np.zeros(count, dtype=np.int64), False
        self._position = np.zeros(count, dtype=np.int64)
        self._velocity, self._current = np.zeros(count), np.full(count, np.nan)
        self._voltage, self._temperature = np.full(count, np.nan), np.full(count, np.nan)
        self._error, self._alert = np.zeros(count, dtype=np.uint8), np.zeros(count, dtype=np.uint8)
        self._driven = np.zeros(count, dtype=np.bool_)
        self._valid = np.zeros(count, dtype=np.bool_)
        self._answered = np.full(count, -np.inf)  # [s]
        self._slow_at = np.full(count, -np.inf)  # [s] when voltage and temperature were read
        self._slow_due = -np.inf  # [s] when they are due again, at the earliest
        self._slow_until = -np.inf  # [s] until when `_slow` is valid
        self._slow = (self._voltage, self._temperature)  # as given out last
        self._erring = self._alarming = False  # whether any servo may have an error, an alert
        # Read-only arrays, given out while no servo has an error and all have answered.
        self._no_error = _fixed(np.zeros(count, dtype=np.uint8))
        self._no_age = _fixed(np.zeros(count))
        self._all_valid = _fixed(np.ones(count, dtype=np.bool_))

    @property
    def turns(self) -> TickArray:
        """Ticks (n,) to add to reported positions: whole turns that a servo has forgotten."""
        return self._turns

    @turns.setter
    def turns(self, turns: TickArray) -> None:
        self._turns, self._turned = turns, bool(turns.any())

    def begin(self) -> None:
        """Begin a cycle: no servo has answered yet."""
        self._valid[:] = False

    def take(self, who: NDArray[np.int64], rows: NDArray[np.void], errors: bytes, names: Names, now: float) -> None:
        """Take the values that servos `who` (k,) answered at `now`, s: rows (k,) of a block, error bytes (k)."""
        self._position[who] = rows[names.position]
        if self._turned:
            self._position[who] += self._turns[who]
        if names.current is not None:
            self._current[who] = rows[names.current]
        fields = rows.dtype.names
        if fields and names.voltage in fields:
            self._slow_until = -np.inf
            self._voltage[who] = rows[names.voltage]
            self._temperature[who] = rows[names.temperature]
            self._slow_at[who] = now
            late = (self._slow_at < now - 2.0 * SLOW_PERIOD) & self._valid
            self._slow_due = now if late.any() else now + SLOW_PERIOD
        if names is NAMES1:
            speed = rows[names.velocity].astype(np.int64)
            self._velocity[who] = np.where(speed & _SIGN1, -(speed & _SIZE1), speed)
        else:
            self._velocity[who] = rows[names.velocity]
        if self._erring or self._alarming or any(errors):
            self._take_errors(who, np.frombuffer(errors, np.uint8), protocol1=names is NAMES1)
        self._valid[who] = True
        self._answered[who] = now

    def _take_errors(self, who: NDArray[np.int64], errors: NDArray[np.uint8], *, protocol1: bool) -> None:
        if protocol1:
            self._alert[who] = sum(np.where(errors & ours, theirs, 0) for ours, theirs in _ALERTS1)
        else:
            # Which error it is, a read shows later. An answer without ALERT ends it.
            known = np.maximum(self._alert[who], UNKNOWN_ALERT * (self._alert[who] == 0))
            self._alert[who] = np.where(errors & ALERT, known, 0)
        self._error[who] = errors
        self._erring, self._alarming = bool(self._error.any()), bool(self._alert.any())

    def slow_due(self, now: float) -> bool:
        """Whether voltage and temperature of a servo that answered in the last cycle are due; at first those of all
        are."""
        if now < self._slow_due:
            return False
        old = self._slow_at < now - SLOW_PERIOD
        return bool((old & self._valid).any()) or not np.isfinite(self._slow_at).any()

    def alarmed(self) -> list[int]:
        """Servos that report an error of which it is not known yet which it is."""
        return np.flatnonzero(self._alert == UNKNOWN_ALERT).tolist() if self._alarming else []

    def take_alert(self, servo: int, bits: int) -> None:
        """Take a servo's Hardware Error Status; without bits, an error that it reports stays unknown."""
        if bits:
            self._alert[servo] = bits
            self._alarming = True

    def take_drive(self, servo: int, driven: bool) -> None:
        """Take whether a servo follows its goals, as read just now."""
        self._driven[servo] = driven

    @property
    def driven(self) -> BoolArray:
        """Which servos follow their goals, by their last report, (n,); not a copy."""
        return self._driven

    @property
    def valid(self) -> BoolArray:
        """Which servos have answered in this cycle, (n,); a copy."""
        return self._valid.copy()

    @property
    def complete(self) -> bool:
        """Whether all servos have answered in this cycle."""
        return bool(self._valid.all())

    def states(self, now: float, *, retries: int = 0, error_rate: float = 0.0) -> ServoStates:
        """The states as of `now`, s. They never change later; arrays that stay as they were may be given again.
        Voltages and temperatures beyond SLOW_AGE are not known."""
        if now > self._slow_until:
            self._make_slow(now)
        complete = self.complete
        voltage, temperature = self._slow
        return ServoStates(
            time=now,
            position=self._position.copy(),
            velocity=self._velocity * self._velocity_unit,
            current=self._current * self._current_unit,
            voltage=voltage,
            temperature=temperature,
            error=self._error.copy() if self._erring else self._no_error,
            alert=self._alert.copy() if self._alarming else self._no_error,
            age=self._no_age if complete else np.where(self._valid, 0.0, np.maximum(now - self._answered, 0.0)),
            valid=self._all_valid if complete else self._valid.copy(),
            driven=self._driven.copy(),
            retries=retries,
            error_rate=error_rate,
        )

    def _make_slow(self, now: float) -> None:
        """Voltages and temperatures, as far as they are known."""
        known = self._slow_at >= now - SLOW_AGE
        voltage = np.where(known, self._voltage * self._voltage_unit, np.nan)
        self._slow = _fixed(voltage), _fixed(np.where(known, self._temperature, np.nan))
        self._slow_until = float(self._slow_at[known].min(initial=np.inf)) + SLOW_AGE


def _fixed(array: NDArray[Scalar]) -> NDArray[Scalar]:
    """The array, read-only from now on."""
    array.flags.writeable = False
    return array


def _scale(table: ControlTable, name: str | None) -> float:
    """SI per step of a register; NaN without one."""
    scale = None if name is None else table[name].scale
    return float("nan") if scale is None else scale
