"""The states of the guard, the causes of a stop, the limits that it watches, and the protocol of a goal filter."""

import math
from dataclasses import dataclass
from enum import Enum
from typing import Protocol

from hardware.arrays import FloatArray


class GuardState(Enum):
    """State of a robot, from limp to moving. Only the guard changes it."""

    IDLE = "idle"
    """Torque off or unknown; nothing is written."""
    ARMED = "armed"
    """Torque on, holding the posture in which it was switched on; no goal has been followed yet."""
    MOVING = "moving"
    """Goals are followed, through the filter."""
    HOLDING = "holding"
    """There is no goal: the robot brakes and stands, torque on, until there is one again (stop category 2)."""
    STOPPING = "stopping"
    """Goals are ignored; the robot brakes, goes to rest if the caller gives a rest trajectory, and stands (stop
    category 1)."""
    STOPPED = "stopped"
    """Latched: nothing is written until the operator acknowledges the reason."""


class StopCause(Enum):
    """What made the guard stop."""

    REQUESTED = "requested"
    BUS = "bus"
    BUS_SILENT = "bus silent"
    SERVO_LOST = "servo lost"
    SERVO_ALERT = "servo alert"
    SERVO_LIMP = "servo limp"
    TEMPERATURE = "temperature"
    VOLTAGE = "voltage"
    CURRENT = "current"
    FOLLOWING_ERROR = "following error"
    STALE_GOAL = "stale goal"
    SOURCE = "source"
    FILTER = "filter"
    FALLEN = "fallen"
    """Detected by the simulation of the robot."""


@dataclass(frozen=True)
class Stop:
    """A latched stop: its cause, its reason in words, and when it began, in s on the guard's clock.

    powered: not every servo confirmed that its torque is off; the operator has to cut the power, and `reason` says so.
    then: what ended the braking before the robot stood, if anything did.
    """

    cause: StopCause
    reason: str
    time: float
    powered: bool = False
    then: StopCause | None = None


@dataclass(frozen=True)
class GuardLimits:
    """What the guard tolerates; limits that are not given are not watched.

    max_age: s since a servo's last answer, from the start of a tick to its goal, and between ticks. max_silence: s
    without a valid answer from any servo of a bus: until then the robot holds. max_temperature: degrees Celsius.
    voltage: lowest and highest, V. following_error: rad of the joint between the present position and the way to
    the goal of the last tick, at once; sustained_error: rad, for sustained_time, s. max_current: A, for
    current_time, s. max_brake_ticks: until the robot must stand; max_rest_ticks: from there until it is at rest.
    max_hold: s without a goal (see `NoCommand`). period: s between ticks, so that late ones are counted; infinite:
    none is late. lag: s by which each servo's loop follows its goal, in servo order: errors are measured from the
    response that such a loop has; none: from the goal. The fields named warn_ are warning levels, in the same
    units. Beyond those of temperature and current the robot moves at slow_share of its speed.
    """

    max_age: float = 0.1
    max_silence: float = 0.05
    max_temperature: float = math.inf
    voltage: tuple[float, float] = (-math.inf, math.inf)
    following_error: float = math.inf
    max_brake_ticks: int = 1000
    max_rest_ticks: int = 5000
    max_hold: float = math.inf
    sustained_error: float = math.inf
    sustained_time: float = 0.2
    max_current: float = math.inf
    current_time: float = 1.0
    warn_age: float = math.inf
    warn_temperature: float = math.inf
    warn_voltage: tuple[float, float] = (-math.inf, math.inf)
    warn_current: float = math.inf
    warn_following_error: float = math.inf
    slow_share: float = 0.5
    period: float = math.inf
    lag: tuple[float, ...] = ()


# The filter between a goal and the bus: the guard sends nothing that has not passed through a `GoalFilter`.


class GoalFilter(Protocol):
    """Last check of a goal. It can always stop: from every posture that it returns, it has a braking trajectory within
    the limits.

    Postures are joint positions in rad, (n,), in the profile's servo order.
    """

    @property
    def position(self) -> FloatArray:
        """The posture returned last, rad; a copy. Where a filter compensates the deflection of the servos, its goals
        differ from the posture, and this is the posture."""
        ...

    @property
    def sent(self) -> FloatArray:
        """The goals returned last, rad; a copy. They keep the limits of the servos."""
        ...

    @property
    def at_rest(self) -> bool:
        """Whether the posture returned last equals the one before it, so that nothing is left to brake."""
        ...

    def seed(self, position: FloatArray) -> None:
        """Start at rest at the robot's present `position`, which may lie beyond a limit. Raises HardwareError if not
        finite."""
        ...

    def admit(self, goal: FloatArray) -> FloatArray:
        """Return what to send this tick: `goal`, or the next posture of the last verified braking trajectory."""
        ...

    def brake(self) -> FloatArray:
        """Return the next posture of the last verified braking trajectory; once at rest, the same posture for ever."""
        ...
