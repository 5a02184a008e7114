"""The bus watchdog of a 2.0 servo (register 98, 20 ms steps): when the bus has been silent for too long."""

from enum import Enum
from math import inf

STEP = 0.02  # [s] of register 98


class FedBy(Enum):
    """Which sound instructions are a life sign. The e-Manual says 'all instruction packets', and not whether those for
    other ids count."""

    ANY = "any"
    """All on the line."""
    OWN = "own"
    """Those to the servo's id or secondary id, and broadcasts (group reads and writes are, whomever they name)."""


class BusWatchdog:
    """Runs only while armed. `tripped`: it has stopped the servo, and register 98 has not been cleared since."""

    def __init__(self) -> None:
        self.deadline = inf
        """When it trips unless something is heard, s."""
        self.tripped = False
        self._period = 0.0

    def arm(self, value: int, now: float, *, torque: bool) -> None:
        """Begin to count at `now` (s) for register value `value`; a value of 0 or less, or no torque: off."""
        self._period = max(value, 0) * STEP
        self.deadline = now + self._period if self._period and torque and not self.tripped else inf

    def feed(self, now: float) -> None:
        """Something was heard at `now` (s), before the deadline."""
        if self.deadline < inf:
            self.deadline = max(self.deadline, now + self._period)

    def trip(self) -> None:
        """Note that it has stopped the servo."""
        self.deadline = inf
        self.tripped = True
