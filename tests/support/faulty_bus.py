"""A mock bus with faults: servos that are silent, hot, stuck or alarmed, and a port that fails."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from enum import Enum
from itertools import compress

import numpy as np

from hardware.arrays import BoolArray, TickArray
from hardware.bus import ServoGoals, ServoStates
from hardware.clock import Clock
from hardware.errors import BusError, describe
from hardware.servo import ServoSpec
from retarget.model.robot import RobotBody
from sim.mock_bus import ALERT_BIT, MockBus
from sim.servo_model import AMBIENT, IDLE_CURRENT


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


class FaultyBus(MockBus):
    """A mock bus with `faults`, as data. Its servos measure current, supply and temperature, which stay the same."""

    def __init__(
        self,
        servos: Sequence[ServoSpec],
        clock: Clock,
        *,
        start: TickArray | None = None,
        faults: Sequence[MockFault] = (),
        imu_of: RobotBody | None = None,
    ) -> None:
        super().__init__(servos, clock, start=start, imu_of=imu_of)
        models = [servo.model for servo in servos]
        self._current = np.array([np.nan if model.current_unit is None else IDLE_CURRENT for model in models])  # [A]
        self._voltage = np.array([model.voltage for model in models])
        self._faults = tuple(faults)
        self._alert = np.zeros(len(servos), dtype=np.uint8)
        self._cycle = -1  # of reads
        self._answered = np.full(len(servos), -np.inf)  # (n,) [s]
        self._shown: ServoStates | None = None

    def read(self) -> ServoStates:
        """Read it. Raises BusError under such a fault."""
        self._cycle += 1
        fresh = super().read()
        if self._failing(FaultKind.READ_FAILS):
            raise BusError(
                describe(what="no answer from any servo", where="mock bus, read", then="Check power and wiring")
            )
        for fault in self._faults:
            if fault.lasts(self._cycle) and fault.kind in (FaultKind.HOT, FaultKind.SUPPLY):
                values = fresh.temperature if fault.kind is FaultKind.HOT else fresh.voltage
                values[fault.servo] = fault.value
        fresh = replace(fresh, error=ALERT_BIT * (self._alert != 0), alert=self._alert.copy())
        missing = self._struck(FaultKind.MISSING)
        self._shown = self._merged(fresh, missing) if missing.any() else fresh
        self._answered[~missing] = self._time
        return self._shown

    def write(self, goals: ServoGoals) -> None:
        """Set the goal registers. Raises BusError under such a fault."""
        if self._open and self._failing(FaultKind.WRITE_FAILS):
            self._catch_up()
            raise BusError(
                describe(
                    what="the port takes no data", where="mock bus, write", then="Check that the adapter is plugged in"
                )
            )
        before = self._goal
        super().write(goals)
        self._goal = np.where(self._struck(FaultKind.MISSING), before, self._goal)

    def torque(self, on: bool) -> None:
        """Switch torque; a servo with an alert stays off. Raises BusError, once all others are switched, for servos
        that do not answer."""
        self._catch_up()
        silent, before = self._struck(FaultKind.MISSING), self._torque
        super().torque(on)
        self._torque = np.where(silent, before, self._torque & (self._alert == 0))
        if silent.any():
            names = ", ".join(f"{servo.joint} (id {servo.id})" for servo in compress(self._map.servos, silent))
            raise BusError(describe(what=f"no answer from {names}", where=f"mock bus, torque {'on' if on else 'off'}"))

    def _catch_up(self) -> None:
        """Apply alerts, and move the servos that have torque and are not stuck."""
        for fault in self._faults:
            if fault.kind is FaultKind.ALERT and fault.lasts(self._cycle):
                self._alert[fault.servo] |= fault.alert
                self._torque[fault.servo] &= not fault.alert
        torque, self._torque = self._torque, self._torque > self._struck(FaultKind.STUCK)
        super()._catch_up()
        self._torque = torque

    def _registers(self) -> ServoStates:
        """The registers, with what healthy servos at rest would measure; a servo without a current register none."""
        return replace(
            super()._registers(),
            current=self._current.copy(),
            voltage=self._voltage.copy(),
            temperature=np.full(len(self._map.servos), AMBIENT),
        )

    def _merged(self, fresh: ServoStates, missing: BoolArray) -> ServoStates:
        """Fresh values of the servos that answer, and the last values of the `missing` ones (n,)."""
        old = self._shown or fresh
        kept = ("position", "velocity", "current", "voltage", "temperature", "error", "alert", "driven")
        values = {name: np.where(missing, getattr(old, name), getattr(fresh, name)) for name in kept}
        return replace(fresh, **values, age=np.where(missing, self._time - self._answered, 0.0), valid=~missing)

    def _struck(self, kind: FaultKind) -> BoolArray:
        """Mask (n,) of servos that have such a fault in this cycle."""
        mask = np.zeros(len(self._map.servos), dtype=np.bool_)
        for fault in self._faults:
            if fault.kind is kind and fault.lasts(self._cycle):
                mask[fault.servo] = True
        return mask

    def _failing(self, kind: FaultKind) -> bool:
        return any(fault.kind is kind and fault.lasts(self._cycle) for fault in self._faults)
