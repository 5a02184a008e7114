"""A line of servos as data: its port, its speed, who is on it, and what the servos of it are told once."""

from dataclasses import dataclass

from hardware.servo import ServoModel

BAUDS: dict[int, tuple[int, ...]] = {
    1: (9600, 19200, 57600, 115200, 200000, 250000, 400000, 500000, 1000000, 2000000, 2250000, 2500000, 3000000),
    2: (9600, 57600, 115200, 1000000, 2000000, 3000000, 4000000, 4500000),
}
"""Bits per second that servos can be set to, by protocol (e-Manual, Baud Rate)."""

WATCHDOG_STEP = 0.02  # [s] of register 98
MAX_WATCHDOG = 2.54  # [s]
RETURN_DELAY_STEP = 2e-6  # [s] of register 9 (Protocol 1.0: 5)
MAX_RETURN_DELAY = 508e-6  # [s]


@dataclass(frozen=True)
class PowerSwitch:
    """A register that switches the servos' power: of device `id`, a byte at address `register` := `value`.

    wait: how long the servos take to start, s.
    """

    id: int
    register: int
    value: int
    wait: float


@dataclass(frozen=True)
class BusSpec:
    """One bus of a robot. ids: every device expected on it, servos and others.

    watchdog: longest silence, s, after which a servo stops by itself; 0: off (Protocol 1.0 servos have none).
    return_delay: pause of a servo before it answers, s.
    """

    name: str
    port: str
    baud: int
    protocol: int
    ids: tuple[int, ...]
    watchdog: float = 0.1
    return_delay: float = 0.0
    power: PowerSwitch | None = None

    @property
    def watchdog_value(self) -> int:
        """Value of the register Bus Watchdog."""
        return round(self.watchdog / WATCHDOG_STEP)

    @property
    def return_delay_value(self) -> int:
        """Value of the register Return Delay Time."""
        return round(self.return_delay / RETURN_DELAY_STEP)


def fastest_baud(model: ServoModel) -> int:
    """Highest speed that a model can be set to, bits per second (e-Manual, Baud Rate of each model)."""
    if model.name.startswith("AX-"):
        return 1_000_000
    return 4_000_000 if "330-" in model.name else 4_500_000
