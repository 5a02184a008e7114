"""Supply, current and heat of emulated servos: by the numbers of `sim.servo_model`, with overload."""

from retarget.arithmetic import Dwell, expm1
from sim.servo_model import (
    AMBIENT,
    FRICTION_CURRENT,
    HEAT_PER_AMPERE2,
    HEAT_TIME,
    IDLE_CURRENT,
    INERTIA,
    LARGEST_CURRENT,
    SPEED_CURRENT,
    SUPPLY_RESISTANCE,
    TORQUE_PER_AMPERE,
)

WINDOW = 16e-3  # [s] shortest time over which current and acceleration are taken
STILL_SHARE = 1e-3  # of the top speed
OVERLOAD_EFFORT = 0.8  # share of the stall torque that a servo holds for OVERLOAD_TIME only
OVERLOAD_TIME = 1.0  # [s]
BROWN_OUT = 0.4  # share of the nominal voltage below which the electronics reset


class Supply:
    """One power supply and its wires. `drawn`: the current of all servos on it, A."""

    def __init__(self) -> None:
        self.drawn = 0.0

    @property
    def sag(self) -> float:
        """Voltage lost in battery and wires, V."""
        return SUPPLY_RESISTANCE * self.drawn


class ServoElectrics:
    """Current (A), voltage (V) and temperature (degrees Celsius) of one servo of `nominal` V.

    turn: rad per tick; top: tick/s. current is positive, with the sign in `direction`. set_voltage and set_heat
    override the model.
    """

    def __init__(self, supply: Supply, nominal: float, *, turn: float, top: float, warmth: float = AMBIENT) -> None:
        self.nominal = nominal
        self.temperature = warmth
        self.current = 0.0
        self.direction = 1.0
        self.set_voltage: float | None = None
        self.set_heat: float | None = None
        self.time = 0.0
        self._supply = supply
        self._turn = turn
        self._top = top
        self._velocity = 0.0
        self._overload = Dwell()
        self.draw(IDLE_CURRENT)

    @property
    def voltage(self) -> float:
        """Present input voltage, V."""
        return self.nominal - self._supply.sag if self.set_voltage is None else self.set_voltage

    @property
    def supplied(self) -> float:
        """Supply as a share of the nominal voltage, without sag, so that a shaft moves as on the mock bus."""
        return 1.0 if self.set_voltage is None else max(self.set_voltage, 0.0) / self.nominal

    @property
    def overloaded(self) -> bool:
        """True if the effort has been too high for too long."""
        return self._overload.held >= OVERLOAD_TIME

    @property
    def warmth(self) -> float:
        """Present temperature, degrees Celsius."""
        return self.temperature if self.set_heat is None else self.set_heat

    def draw(self, current: float) -> None:
        """Take `current` A from the supply from now on."""
        self._supply.drawn += current - self.current
        self.current = current

    def rest(self, now: float) -> None:
        """Begin again at `now` (s), without overload, after a start."""
        self.time = now
        self._velocity = 0.0
        self._overload.held = 0.0

    def advance(self, now: float, velocity: float, *, effort: float, torque: bool, motor: float | None = None) -> None:
        """Go on to `now` (s), where the shaft turns at `velocity` tick/s with `effort` as a share of stall torque.

        motor: its signed current, A, where that is known. Call it no more often than every WINDOW.
        """
        elapsed = now - self.time
        if elapsed <= 0.0:
            return
        self.time = now
        share = abs(velocity) / self._top
        gain = abs(velocity - self._velocity) * self._turn
        self._velocity = velocity
        drive = SPEED_CURRENT * share + INERTIA / TORQUE_PER_AMPERE * gain / elapsed + LARGEST_CURRENT * abs(effort)
        if share > STILL_SHARE:
            drive += FRICTION_CURRENT
        drive = drive if motor is None else abs(motor)
        current = IDLE_CURRENT + (min(drive, LARGEST_CURRENT) if torque else 0.0)
        self.direction = -1.0 if (motor or effort or velocity) < 0.0 else 1.0
        if current != self.current:
            self.draw(current)
        final = AMBIENT + HEAT_PER_AMPERE2 * current * current
        self.temperature -= (final - self.temperature) * expm1(-elapsed / HEAT_TIME)
        self._overload.step(elapsed, holds=torque and abs(effort) > OVERLOAD_EFFORT)
