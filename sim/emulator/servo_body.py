"""The common part of emulated servos of both protocols: shaft, electrics, power, start and faults."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from math import inf

from hardware.dynamixel.control_table import ControlTable
from hardware.servo import ServoModel
from sim.emulator.device import Device
from sim.emulator.power import BROWN_OUT, WINDOW, ServoElectrics, Supply
from sim.emulator.shaft import Shaft
from sim.servo_model import AMBIENT

REALTIME_TICKS = 32768  # [ms] after which the realtime tick wraps

VOLTAGE_BIT, HEAT_BIT, OVERLOAD_BIT = 0x01, 0x04, 0x20
"""Bits of errors in a status of protocol 1.0 and in Hardware Error Status (70) of the X layout."""
BOOT_TIME = 0.2  # [s] not documented; long enough for the pauses of field software


@dataclass(frozen=True, slots=True)
class ServoBuild:
    """The begin of a servo: awake at `now` (s), its shaft at `position` (tick), at `warmth` (degrees Celsius).

    supply: shared with others, None: its own. boot_time: s of every later start.
    """

    position: float
    now: float = 0.0
    supply: Supply | None = None
    boot_time: float = BOOT_TIME
    warmth: float = AMBIENT


class ServoBody(Device):
    """A servo of a table, as the maker delivers it, that begins as `build`.

    A subclass defines a start (`_reset`), the reaction to errors (`note`) and the registers that show its state
    (`live`). top: no-load speed at the nominal voltage, tick/s. let_go: called with the time, s, when it stops driving.
    """

    shown: tuple[int, int]
    """Range of addresses of the registers that show its state."""

    def __init__(self, table: ControlTable, model: ServoModel, build: ServoBuild) -> None:
        super().__init__(table, build.now)
        self.servo_model = model
        self.boot_time = build.boot_time
        self.top = top = model.no_load_speed / model.tick_rad
        self.shaft = Shaft(build.position, top)
        self.shaft.time = build.now
        supply = build.supply or Supply()
        self.electrics = ServoElectrics(supply, model.voltage, turn=model.tick_rad, top=top, warmth=build.warmth)
        self.electrics.time = build.now
        self.started = build.now
        self._starting = False
        self._eventless = -inf  # [s] before then nothing happens but motion
        self._power_is_cut = False
        self.let_go: Callable[[float], object] = lambda now: None

    @property
    def barred(self) -> bool:
        """True if an error keeps torque off."""
        raise NotImplementedError

    def live(self, now: float) -> dict[str, float]:
        """The values of the registers that show its state at `now` (s)."""
        raise NotImplementedError

    def realtime_tick(self, now: float) -> int:
        """The realtime tick, ms since the last start, wrapped."""
        return int(1000.0 * (now - self.started)) % REALTIME_TICKS

    def show(self, address: int, length: int, now: float) -> None:
        """Refresh the registers of a range that show its state."""
        if self.memory.touches(address, length, *self.shown):
            self.show_values(self.live(now))

    def show_values(self, values: Mapping[str, float]) -> None:
        """Set registers by name, rounded; names that the model does not have are left out."""
        for name, value in values.items():
            self.memory.put(name, round(value))

    def catch_up(self, now: float) -> None:
        """Let time pass up to `now` (s)."""
        if now < self._eventless:
            self.shaft.advance(now)
        else:
            self.pass_events(now)

    def pass_events(self, now: float) -> None:
        """Let time pass up to `now` (s), with the events until then."""
        if self._starting and now >= self._awake_at:
            self._starting = False
            self.shaft.time = max(self.shaft.time, self._awake_at)
            self.wake(self._awake_at)
        self.shaft.advance(now)
        if now - self.electrics.time >= WINDOW:
            self.measure(now)
        self._eventless = min(self.electrics.time + WINDOW, self._awake_at if self._starting else inf)

    def measure(self, now: float) -> None:
        """Bring current, voltage and heat up to `now` (s), and check for errors."""
        shaft = self.shaft
        if self._awake_at == inf:
            self.electrics.time = now
            return
        motor = None if shaft.mechanics is None else shaft.mechanics.current(shaft)
        self.electrics.advance(now, shaft.velocity, effort=shaft.effort(), torque=shaft.torque, motor=motor)
        self.check()

    def reboot(self, now: float) -> None:
        """Start anew at `now` (s): silence for the boot time, everything in RAM lost."""
        if self.shaft.torque:
            self.let_go(now)
        self.shaft.torque = False
        self._awake_at = now + self.boot_time
        self._starting = True
        self.started = self._awake_at
        self.electrics.rest(now)
        self._reset()

    def supply(self, volts: float | None, now: float) -> None:
        """Set the supply voltage in V, None: nominal less the sag; below BROWN_OUT of nominal it resets."""
        self.catch_up(now)
        self.electrics.set_voltage = volts
        self._power(now)
        self.tune()
        self.check()

    def heat(self, celsius: float | None, now: float) -> None:
        """Set the temperature in degrees Celsius, None: that of the model."""
        self.catch_up(now)
        self.electrics.set_heat = celsius
        self.check()

    def jam(self, stuck: bool, now: float) -> None:
        """Block the shaft, or free it."""
        self.catch_up(now)
        self.shaft.stuck = stuck
        self.tune()

    def power_cut(self, now: float) -> None:
        """Switch the power off."""
        self.catch_up(now)
        self._power_is_cut = True
        self._power(now)

    def power_back(self, now: float) -> None:
        """Switch the power on: the servo starts."""
        self.catch_up(now)
        self._power_is_cut = False
        self._power(now)

    def _power(self, now: float) -> None:
        powered = not self._power_is_cut and self.electrics.supplied >= BROWN_OUT
        if not powered and self._awake_at < inf:
            self.reboot(now)
            self._awake_at = inf
            self._starting = False
            self.electrics.draw(0.0)
        elif powered and self._awake_at == inf:
            self.reboot(now)

    def wake(self, now: float) -> None:
        """End a start, at `now` (s)."""

    def tune(self) -> None:
        """Apply every setting in the registers."""
        self._eventless = -inf
        super().tune()

    def check(self) -> None:
        """Check voltage, temperature and effort of a servo that is awake."""
        if self._awake_at == inf or self._starting:
            return
        memory, electrics = self.memory, self.electrics
        wrong = OVERLOAD_BIT if electrics.overloaded else 0
        tenths = round(10.0 * electrics.voltage)
        if not memory.value("min_voltage_limit") <= tenths <= memory.value("max_voltage_limit"):
            wrong |= VOLTAGE_BIT
        if electrics.warmth > memory.value("temperature_limit"):
            wrong |= HEAT_BIT
        self.note(wrong)

    def note(self, wrong: int) -> None:
        """React to the present errors, bits."""
        raise NotImplementedError

    def switch(self, on: bool) -> bool:
        """Switch torque, unless it is barred; return whether it changes."""
        on = on and not self.barred
        self.memory.put("torque_enable", int(on))
        shaft = self.shaft
        if on == shaft.torque:
            return False
        shaft.torque, shaft.path = on, None
        if not on:
            self.let_go(shaft.time)
        return True

    def _reset(self) -> None:
        self.registered = None
        self.defaults(self.table.eeprom_end, self.table.size)
        self.shaft.path, self.shaft.speed = None, 0.0
