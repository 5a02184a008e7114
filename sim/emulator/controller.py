"""The OpenCR of an OP3: a device of protocol 2.0 that switches the servos' power.

Id 200; register 24 is the power switch in public OP3 code, and 50 the voltage; not verified on hardware.
"""

from collections.abc import Sequence
from math import inf

from hardware.dynamixel.control_table import ControlTable, Register
from sim.emulator.device import Device
from sim.emulator.power import BROWN_OUT

ID = 200
NUMBER = 0x7400
POWER = 24
"""Id, model number and register of the power switch of an OpenCR (ROBOTIS' public firmware of OP3)."""
VOLTAGE = 12.0  # [V]


def _row(name: str, address: int, size: int, bounds: tuple[int, int] | None, initial: int) -> Register:
    """A register without sign; bounds: what may be written, None: read only."""
    low, high = bounds or (None, None)
    return Register(name, address, size, False, bounds is not None, None, None, low, high, initial)


TABLE = ControlTable(
    model="OpenCR",
    number=NUMBER,
    protocol=2,
    firmware=(0, 255),
    usual_firmware=1,
    fast_since=None,
    modes=(),
    baud_family="x",
    registers=(
        _row("model_number", 0, 2, None, NUMBER),
        _row("firmware_version", 6, 1, None, 1),
        _row("id", 7, 1, (0, 252), ID),
        _row("baud_rate", 8, 1, (0, 7), 4),
        _row("return_delay_time", 9, 1, (0, 254), 0),
        _row("status_return_level", 16, 1, (0, 2), 2),
        _row("dynamixel_power", POWER, 1, (0, 1), 0),
        _row("led", 25, 1, (0, 7), 0),
        _row("present_voltage", 50, 1, None, 120),
    ),
)
"""Registers of an OpenCR that a host of OP3 uses."""


class EmulatedController(Device):
    """A controller at `baud` bits/s, whatever its register says, that switches the power of `powered` devices.

    on: whether they have power at first. It answers ping, read and write only.
    """

    def __init__(
        self,
        powered: Sequence[Device] = (),
        *,
        baud: int,
        id: int = ID,
        now: float = 0.0,
        on: bool = False,
    ) -> None:
        super().__init__(TABLE, -inf)
        self.defaults(0, TABLE.size)
        self.id, self.baud = id, baud
        self._powered = tuple(powered)
        self._volts = VOLTAGE
        self._switch(on, now)

    def tune(self) -> None:
        """Take every setting but the speed from the registers."""
        baud = self.baud
        super().tune()
        self.baud = baud

    def react(self, names: set[str], now: float) -> None:
        """Switch the servos' power as written."""
        self.tune()
        if "dynamixel_power" in names:
            self._switch(bool(self.memory.value("dynamixel_power")), now)

    def show(self, address: int, length: int, now: float) -> None:
        """Refresh the register of the voltage, 0.1 V."""
        self.memory.put("present_voltage", round(10.0 * self._volts))

    def supply(self, volts: float | None, now: float) -> None:
        """Set the supply voltage in V; below BROWN_OUT of the nominal it is silent, and so are the servos."""
        self._volts = VOLTAGE if volts is None else volts
        if self._volts < BROWN_OUT * VOLTAGE:
            self.power_cut(now)
        elif self.booting(now):
            self.power_back(now)

    def power_cut(self, now: float) -> None:
        """Switch the power off; the servos lose theirs with it."""
        self._awake_at = inf
        self._switch(False, now)

    def power_back(self, now: float) -> None:
        """Switch the power on; that of the servos stays off until register 24 is written."""
        self._awake_at = now

    def _switch(self, on: bool, now: float) -> None:
        """Switch the servos' power."""
        self.memory.put("dynamixel_power", int(on))
        for device in self._powered:
            if on:
                device.power_back(now)
            else:
                device.power_cut(now)
