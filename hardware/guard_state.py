"""Stop causes, the latched stop, and the limits that the guard watches."""

import math
from dataclasses import dataclass
from enum import Enum, IntEnum


class StopCategory(IntEnum):
    """Stop categories of IEC 60204-1."""

    TORQUE_OFF = 0
    """At once: the robot cannot brake."""
    BRAKE_AND_TORQUE_OFF = 1
    """The robot brakes, goes to rest if it may, then torque goes off."""
    HOLD = 2
    """The robot brakes and stands with torque."""


class StopCause(Enum):
    """The cause of a stop."""

    REQUESTED = "requested"
    BUS = "bus"
    BUS_SILENT = "bus silent"
    SERVO_LOST = "servo lost"
    LIMB_LOST = "limb lost"
    """Only servos that carry nothing are silent."""
    NOT_READ = "not read"
    """Temperature or supply."""
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
    """By the IMU, or the simulation."""


FAULTLESS = (StopCause.REQUESTED, StopCause.STALE_GOAL, StopCause.SOURCE)
"""Causes without a fault of the robot."""
BEARABLE = (*FAULTLESS, StopCause.LIMB_LOST, StopCause.NOT_READ, StopCause.FILTER)
"""Causes with which the robot may still go to rest."""


@dataclass(frozen=True)
class Stop:
    """A latched stop. powered: torque is not confirmed as off, so the operator must cut the power. then: a later cause
    that ended the braking early."""

    cause: StopCause
    reason: str
    powered: bool = False
    then: StopCause | None = None

    @property
    def is_bearable(self) -> bool:
        """True if the robot may still go to rest."""
        return self.cause in BEARABLE and (self.then is None or self.then in BEARABLE)


@dataclass(frozen=True)
class GuardLimits:
    """Limits of the guard. Infinite ones are not watched.

    max_age: s since a servo's last answer. max_silence: s without an answer from a whole bus, during which the robot
    holds. max_pause: s between ticks. max_temperature: degrees Celsius. voltage: lowest and highest, V.
    following_error: rad of the joint, at once; sustained_error: for sustained_time, s. max_current: A, for
    current_time, s. lag: time constants of the position loops, s (n,), from whose response errors count; (): from
    the goal. warn_...: warning levels. slow_share: speed override during a warning that slows the robot. limbs (n,):
    True for a dispensable servo, without which the robot goes to rest; (): every servo is needed.
    """

    max_age: float = 0.1
    max_pause: float = 0.1
    max_silence: float = 0.05
    max_temperature: float = math.inf
    voltage: tuple[float, float] = (-math.inf, math.inf)
    following_error: float = math.inf
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
    lag: tuple[float, ...] = ()
    limbs: tuple[bool, ...] = ()
