"""Current, supply and heat of simulated servos: a stated model that nobody has calibrated on hardware.

Current is torque / kt. The supply is the nominal voltage of each model less what all servos together lose in battery
and wires. A servo warms as a first-order lag: its final rise is HEAT_PER_WATT times the loss R i^2 in its windings
(the thermal resistance of `sim.servo_load`, whose servo has 12 V / 2.3 A = 5.2 ohm), reached with HEAT_TIME.
"""

from collections.abc import Sequence

import numpy as np

from hardware.arrays import BoolArray, ByteArray, FloatArray
from hardware.bus import ServoAlert
from sim.emulator.power import OVERLOAD_EFFORT, OVERLOAD_TIME
from sim.physics.motors import Drive
from sim.servo_load import AMBIENT, HEAT_PER_AMPERE2, HEAT_TIME, IDLE_CURRENT, LARGEST_CURRENT, SUPPLY_RESISTANCE

__all__ = ["HEAT_PER_WATT", "Electrics"]

HEAT_PER_WATT = HEAT_PER_AMPERE2 / (12.0 / LARGEST_CURRENT)
"""Final rise of temperature per loss, K/W."""
_OVERLOAD, _OVERHEATING = np.uint8(ServoAlert.OVERLOAD), np.uint8(ServoAlert.OVERHEATING)
NOTICED_V = 0.05
"""By so much the supply changes before the motors are told, V."""


class Electrics:
    """Of n servos, arrays (n,): voltage V, temperature degrees Celsius, alert bits."""

    def __init__(self, drives: Sequence[Drive]) -> None:
        numbers = [drive.numbers for drive in drives]
        self._nominal = np.array([drive.servo.model.voltage for drive in drives])
        self._constant = np.array([one.torque_constant for one in numbers])
        self._resistance = np.array([one.resistance for one in numbers])
        self._hottest = np.array([one.temperature_limit for one in numbers])
        self._strain = OVERLOAD_EFFORT * np.array([drive.most_torque for drive in drives])
        self._strained = np.zeros(len(drives))  # [s]
        self.voltage: FloatArray = self._nominal.copy()
        self.temperature: FloatArray = np.full(len(drives), AMBIENT)
        self.alert: ByteArray = np.zeros(len(drives), dtype=np.uint8)
        self.trips = True
        """Whether what is wrong becomes an alert."""

    def current(self, torque: FloatArray, driven: BoolArray) -> FloatArray:
        """Of motors (n,) that give `torque` N m, A."""
        return np.asarray(driven * torque / self._constant)

    def advance(self, torque: FloatArray, driven: BoolArray, elapsed: float) -> bool:
        """Go on by `elapsed` s in which the motors gave `torque` (n,) N m. Returns whether the supply has changed so
        much, or an alert is new, that the motors should know."""
        size = self.current(torque, driven)
        loss = self._resistance * size * size  # [W]
        final = AMBIENT + HEAT_PER_WATT * loss
        self.temperature = self.temperature - (final - self.temperature) * np.expm1(-elapsed / HEAT_TIME)
        strained = driven & (np.abs(torque) > self._strain)
        self._strained = (self._strained + elapsed) * strained
        overloaded, hot = self._strained >= OVERLOAD_TIME, self.temperature > self._hottest
        alert = self.alert | _OVERLOAD * overloaded | _OVERHEATING * hot
        fresh = self.trips and bool((alert != self.alert).any())
        if fresh:
            self.alert = alert
        voltage = self._nominal - SUPPLY_RESISTANCE * (IDLE_CURRENT * size.size + float(loss.sum()) / self._nominal[0])
        changed = abs(float(voltage[0] - self.voltage[0])) > NOTICED_V
        if changed:
            self.voltage = voltage
        return changed or fresh
