"""What may go wrong on the mock bus, as data: which servo, which cycles, what."""

from dataclasses import dataclass
from enum import Enum


class FaultKind(Enum):
    """What happens while a fault lasts."""

    MISSING = "missing"
    """The servo does not answer, and hears neither goals nor that its torque is to be switched."""
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
