"""The states of the guard, why it stopped, and the limits that it watches: data only."""

from dataclasses import dataclass
from enum import Enum


class GuardState(Enum):
    """Where a robot stands between lying limp and moving. Only the guard changes it."""

    IDLE = "idle"
    """Torque off or unknown; nothing is written."""
    ARMED = "armed"
    """Torque on, holding the posture in which it was switched on; no goal has been followed yet."""
    MOVING = "moving"
    """Goals are followed, through the filter."""
    STOPPING = "stopping"
    """Goals are ignored; the last verified braking trajectory is followed until the robot stands."""
    STOPPED = "stopped"
    """Latched: nothing is written until a person acknowledges the reason."""


class StopCause(Enum):
    """What made the guard stop."""

    REQUESTED = "requested"
    BUS = "bus"
    SERVO_LOST = "servo lost"
    SERVO_ALERT = "servo alert"
    SOURCE = "source"
    FILTER = "filter"


@dataclass(frozen=True)
class Stop:
    """A latched stop: its cause, a text for a person, and when it began, in s on the guard's clock."""

    cause: StopCause
    reason: str
    time: float


@dataclass(frozen=True)
class GuardLimits:
    """What the guard tolerates. `max_age` s since a servo's last answer; `max_brake_ticks` until the robot must
    stand."""

    max_age: float = 0.1
    max_brake_ticks: int = 2000
