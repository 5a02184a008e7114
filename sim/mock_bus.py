"""Buses without wires: servos with speed limit, first-order lag, encoder and faults, or always at their goals."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from enum import Enum
from itertools import compress

import numpy as np

from hardware.arrays import BoolArray, FloatArray, TickArray
from hardware.bus import ServoGoals, ServoStates
from hardware.clock import Clock
from hardware.errors import BusError, describe
from hardware.servo import ServoSpec, loop_lag
from retarget.model.robot import RobotBody
from sim.servo_model import ServoLoad, saturated_lag

# Faults of the mock bus as data: kind, servo, cycles.


class FaultKind(Enum):
    """What happens while a fault lasts."""

    MISSING = "missing"
    """The servo does not answer, and receives neither goals nor torque commands."""
    ALERT = "alert"
    """The servo reports `alert` bits and its torque is off; it stays so when the fault is over, like a real one until
    its reboot."""
    READ_FAILS = "read fails"
    """The whole bus raises BusError on a read."""
    HOT = "hot"
    """The servo reports `value` degrees Celsius."""
    SUPPLY = "supply"
    """The servo reports a supply of `value` V."""
    STUCK = "stuck"
    """The shaft stays where it is, whatever the goal."""
    WRITE_FAILS = "write fails"
    """The whole bus raises BusError on a write."""


@dataclass(frozen=True)
class MockFault:
    """One fault: `kind`, from read cycle `first` (counted from 0) for `cycles` cycles, on `servo` (index in servo
    order). `alert` bits and `value` as the kind says."""

    kind: FaultKind
    first: int
    cycles: int
    servo: int = 0
    alert: int = 0
    value: float = 0.0

    def lasts(self, cycle: int) -> bool:
        """Whether the fault is present in read cycle `cycle`."""
        return self.first <= cycle < self.first + self.cycles


VELOCITY_UNIT = 0.229 * 2.0 * np.pi / 60.0  # [rad/s] register step
ALERT_BIT = np.uint8(0x80)  # of the error byte


def mock_bus(robot: RobotBody, clock: Clock) -> "MockBus":
    """The bus of a robot whose servos begin in its posture `stand`."""
    protocols = {bus.name: bus.protocol for bus in robot.profile.bus_specs()}
    stand = robot.posture(robot.profile.postures.stand)[robot.servo_columns]
    return MockBus(robot.joint_map.servos, clock, start=robot.joint_map.to_ticks(stand), protocols=protocols)


class MockBus:
    """A `hardware.bus.ServoBus` without wires. Nothing loads the joints: with torque off a servo stays where it is.

    A goal is approached at speed `clip((goal - position) / lag, -top, top)`: the servo's position loop, a pure P gain
    whose drive saturates at its no-load speed. `lag` in s, for all servos; None takes it from the model and its P gain
    (about 45 ms for an XM430-W350 at its default gain of 800). Between calls the motion is exact, however far apart
    they are. `start` in ticks, (n,). protocols: of the buses, by name, for the gains' unit; 2 where it is not given.
    """

    def __init__(
        self,
        servos: Sequence[ServoSpec],
        clock: Clock,
        *,
        start: TickArray | None = None,
        lag: float | None = None,
        faults: Sequence[MockFault] = (),
        protocols: Mapping[str, int] | None = None,
    ) -> None:
        count = len(servos)
        self._clock = clock
        self._servos = tuple(servos)
        self._faults = tuple(faults)
        models = [servo.model for servo in servos]
        self._tick_rad = np.array([model.tick_rad for model in models])  # (n,) [rad]
        self._top = np.array([model.no_load_speed / model.tick_rad for model in models])  # (n,) [tick/s]
        spoken = protocols or {}
        lags = [loop_lag(servo, protocol=spoken.get(servo.bus, 2)) for servo in servos]
        self._lag = np.array([own if lag is None else lag for own in lags])  # (n,) [s]
        self._first = np.array([servo.lowest_tick for servo in servos], dtype=np.int64)  # (n,) [tick]
        self._last = np.array([servo.highest_tick for servo in servos], dtype=np.int64)  # (n,) [tick]
        self._current_unit = np.array([model.current_unit or np.nan for model in models])  # (n,) [A], NaN: reports none
        zero = np.array([servo.zero_tick for servo in servos], dtype=np.int64)
        self._position: FloatArray = np.array(
            zero if start is None else start, dtype=np.float64
        )  # (n,) exact shaft [tick]
        self._goal: FloatArray = np.array(
            [model.centre_tick for model in models], dtype=np.float64
        )  # (n,) register [tick]
        self._velocity = np.zeros(count)  # (n,) [rad/s]
        self._load = ServoLoad(np.array([model.voltage for model in models]), self._top * self._tick_rad)
        self._none = np.zeros(count, dtype=np.bool_)
        self._torque = self._none.copy()
        self._alert = np.zeros(count, dtype=np.uint8)
        self._cycle = -1  # of reads
        self._time = clock.now()
        self._answered = np.full(count, -np.inf)  # (n,) [s]
        self._shown: ServoStates | None = None
        self._open = False

    def open(self) -> None:
        """Open the bus; torque is off."""
        self._open = True
        self._time = self._clock.now()

    def read(self) -> ServoStates:
        """Move time on and return the state of the servos. Raises BusError when closed, and under such a fault."""
        self._require_open("read")
        self._cycle += 1
        self._catch_up()
        if self._failing(FaultKind.READ_FAILS):
            raise BusError(
                describe(what="no answer from any servo", where="mock bus, read", then="Check power and wiring")
            )
        missing = self._struck(FaultKind.MISSING)
        fresh = self._registers()
        self._shown = self._merged(fresh, missing) if missing.any() else fresh
        self._answered[~missing] = self._time
        return self._shown

    def write(self, goals: ServoGoals) -> None:
        """Set the goal registers. Raises BusError when closed, on a goal that a servo does not have, and under such
        a fault."""
        self._require_open("write")
        self._catch_up()
        if self._failing(FaultKind.WRITE_FAILS):
            raise BusError(
                describe(
                    what="the port takes no data", where="mock bus, write", then="Check that the adapter is plugged in"
                )
            )
        check_goals(goals.ticks, self._first, self._last, where="mock bus, write")
        self._goal = np.where(self._struck(FaultKind.MISSING), self._goal, goals.ticks)

    def torque(self, on: bool) -> None:
        """Switch torque; a servo with an alert stays off. The goal registers keep what they had, so goals come
        first. Raises BusError when closed, and, once all others are switched, for servos that do not answer."""
        self._require_open("torque")
        self._catch_up()
        silent = self._struck(FaultKind.MISSING)
        self._torque = np.where(silent, self._torque, on & (self._alert == 0))
        if silent.any():
            names = ", ".join(f"{servo.joint} (id {servo.id})" for servo in compress(self._servos, silent))
            raise BusError(describe(what=f"no answer from {names}", where=f"mock bus, torque {'on' if on else 'off'}"))

    def close(self) -> None:
        """Switch torque off; no further call but `open`. Raises BusError for servos that do not answer."""
        try:
            if self._open:
                self.torque(False)
        finally:
            self._open = False

    @property
    def torque_on(self) -> bool:
        """Whether any servo has torque: for tests and the emulated robot's lamp."""
        return bool(self._torque.any())

    def _catch_up(self) -> None:
        """Move every servo from the last call's time to now, exactly."""
        elapsed = self._clock.now() - self._time
        self._time += elapsed
        for fault in self._faults:
            if fault.kind is FaultKind.ALERT and fault.lasts(self._cycle):
                self._alert[fault.servo] |= fault.alert
                self._torque[fault.servo] &= not fault.alert
        if elapsed <= 0.0:
            return
        before = self._velocity
        moved, velocity = saturated_lag(self._goal - self._position, lag=self._lag, top=self._top, elapsed=elapsed)
        turns = self._torque > self._struck(FaultKind.STUCK)  # has torque, and is not stuck
        self._position = self._position + turns * moved
        self._velocity = turns * velocity * self._tick_rad
        self._load.advance(before=before, after=self._velocity, torque=self._torque, elapsed=elapsed)

    def _registers(self) -> ServoStates:
        """What the registers of all servos show now, rounded as they round."""
        return ServoStates(
            time=self._time,
            position=np.rint(self._position).astype(np.int64),
            velocity=np.rint(self._velocity / VELOCITY_UNIT) * VELOCITY_UNIT,
            current=np.rint(self._load.current / self._current_unit) * self._current_unit,
            voltage=self._said(FaultKind.SUPPLY, np.rint(10.0 * self._load.voltage) / 10.0),
            temperature=self._said(FaultKind.HOT, np.rint(self._load.temperature)),
            error=ALERT_BIT * (self._alert != 0),
            alert=self._alert.copy(),
            age=np.zeros(len(self._servos)),
            valid=~self._none,
            driven=self._torque.copy(),
        )

    def _merged(self, fresh: ServoStates, missing: BoolArray) -> ServoStates:
        """Fresh values of the servos that answer, and the last values of the `missing` ones (n,)."""
        old = self._shown or fresh
        return ServoStates(
            time=self._time,
            position=np.where(missing, old.position, fresh.position),
            velocity=np.where(missing, old.velocity, fresh.velocity),
            current=np.where(missing, old.current, fresh.current),
            voltage=np.where(missing, old.voltage, fresh.voltage),
            temperature=np.where(missing, old.temperature, fresh.temperature),
            error=np.where(missing, old.error, fresh.error),
            alert=np.where(missing, old.alert, fresh.alert),
            age=np.where(missing, self._time - self._answered, 0.0),
            valid=~missing,
            driven=np.where(missing, old.driven, fresh.driven),
        )

    def _struck(self, kind: FaultKind) -> BoolArray:
        """Mask (n,) of servos that have such a fault in this cycle."""
        if not self._faults:
            return self._none
        mask = self._none.copy()
        for fault in self._faults:
            if fault.kind is kind and fault.lasts(self._cycle):
                mask[fault.servo] = True
        return mask

    def _said(self, kind: FaultKind, values: FloatArray) -> FloatArray:
        """Return the registers (n,), changed by faults of this kind."""
        for fault in self._faults:
            if fault.kind is kind and fault.lasts(self._cycle):
                values[fault.servo] = fault.value
        return values

    def _failing(self, kind: FaultKind) -> bool:
        return any(fault.kind is kind and fault.lasts(self._cycle) for fault in self._faults)

    def _require_open(self, action: str) -> None:
        check_open(self._open, where=f"mock bus, {action}")


def check_open(is_open: bool, *, where: str) -> None:
    """Raise BusError for a bus that is closed."""
    if not is_open:
        raise BusError(describe(what="the bus is closed", where=where, then="Call open first"))


def check_goals(ticks: TickArray, first: TickArray, last: TickArray, *, where: str) -> None:
    """Raise BusError unless goals (n,) lie from `first` to `last` (n,)."""
    if ticks.shape != last.shape or ((ticks < first) | (ticks > last)).any():
        text = describe(what="goal ticks out of range", where=where, found=ticks, allowed=f"{first} to {last}")
        raise BusError(text)


# No bus: servos that are always at their goals, for runs that only compute.


class NoBus:
    """A `hardware.bus.ServoBus` that answers every goal with itself. `start` in ticks, (n,)."""

    def __init__(self, clock: Clock, *, start: TickArray) -> None:
        self._clock = clock
        self._position = np.array(start, dtype=np.int64)
        count = self._position.size
        self._zeros = np.zeros(count)
        self._unknown = np.full(count, np.nan)
        self._no_bits = np.zeros(count, dtype=np.uint8)
        self._all = np.ones(count, dtype=np.bool_)
        self._open = False

    def open(self) -> None:
        """Nothing to open."""
        self._open = True

    def read(self) -> ServoStates:
        """Every servo at its goal, at rest and healthy; currents, voltages and temperatures are unknown."""
        check_open(self._open, where="no bus")
        return ServoStates(
            time=self._clock.now(),
            position=self._position,
            velocity=self._zeros,
            current=self._unknown,
            voltage=self._unknown,
            temperature=self._unknown,
            error=self._no_bits,
            alert=self._no_bits,
            age=self._zeros,
            valid=self._all,
            driven=self._all,
        )

    def write(self, goals: ServoGoals) -> None:
        """Take the goals as positions."""
        check_open(self._open, where="no bus")
        self._position = goals.ticks

    def torque(self, on: bool) -> None:
        """Nothing to switch."""

    def close(self) -> None:
        """Nothing to close; no further call but `open`."""
        self._open = False
