"""The causes of a stop, the latched stop, and the limits that the guard watches."""

import math
from dataclasses import dataclass
from enum import Enum, IntEnum


class StopCategory(IntEnum):
    """Stop categories of IEC 60204-1."""

    TORQUE_OFF = 0
    """At once: the robot cannot brake."""
    BRAKE_AND_TORQUE_OFF = 1
    """The robot brakes, goes to rest where it may, and torque goes off."""
    HOLD = 2
    """The robot brakes and stands, torque on, while it lasts."""


class StopCause(Enum):
    """What made the guard stop."""

    REQUESTED = "requested"
    BUS = "bus"
    BUS_SILENT = "bus silent"
    SERVO_LOST = "servo lost"
    LIMB_LOST = "limb lost"
    """Only servos that carry nothing are silent: of arms or head."""
    NOT_READ = "not read"
    """Temperature or supply is not read any more: nothing is known to be wrong with the servo."""
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
    """By its IMU, or by its simulation."""


FAULTLESS = (StopCause.REQUESTED, StopCause.STALE_GOAL, StopCause.SOURCE)
"""Causes that are no fault of the robot."""
BEARABLE = (*FAULTLESS, StopCause.LIMB_LOST, StopCause.NOT_READ, StopCause.FILTER)
"""Causes with which the robot may still go to rest."""


@dataclass(frozen=True)
class Stop:
    """A latched stop: its cause, and its reason in words.

    powered: not every servo confirmed that its torque is off; the operator has to cut the power, and `reason` says so.
    then: what ended the braking before the robot stood, if anything did.
    """

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
    """What the guard tolerates; limits that are not given are not watched.

    max_age: s since a servo's last answer. max_silence: s without a valid answer from any servo of a bus; until then
    the robot holds. max_pause: s between ticks.
    max_temperature: degrees Celsius. voltage: lowest and highest, V. following_error: rad of the joint between the
    present position and the way to the goal of the last tick, at once; sustained_error: rad, for sustained_time, s.
    max_current: A, for current_time, s. lag: s by which each servo's loop follows its goal, in servo order: errors are
    measured from the response that such a loop has; none: from the goal. The fields named warn_ are warning levels, in
    the same units. Beyond those of temperature and current the robot moves at slow_share of its speed. limbs: whether
    each servo, in servo order, carries nothing, so that the robot goes to rest without it; none: all are needed.
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
