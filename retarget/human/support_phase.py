"""Support phase, from height and speed of the ankles: both feet, left, right, or none in flight.

The floor is estimated from the carrying feet, as recordings tilt and trackers drift. A foot lifts off when it is high
or fast, and touches down when it is low and slow.
"""

from collections.abc import Mapping, Sequence
from math import inf

from retarget.arithmetic import Dwell, low_pass
from retarget.human.posture_prior import Point, Velocity
from retarget.schema.priorities import Phase
from retarget.types import Carrying

LIFTED_M, TOUCHDOWN_M = 0.06, 0.04  # above the other foot's ankle; shoes and noise are less
LEFT_M = 0.1  # above the floor; lower, a foot may carry on its toes
LIFT_M_S, LAST_LIFT_M_S, TOUCHDOWN_M_S = 0.8, 1.5, 0.6
"""A foot lifts off above the first speed, m/s, the last foot above the second, as it rolls over its toes, and touches
down below the third."""
LIFT_DWELL_S, TOUCHDOWN_DWELL_S = 0.05, 0.02  # before the state of a foot changes
LONGEST_FLIGHT_S = 0.8  # a jump of 0.8 m
FOOT_SPEED_SETTLE_S = 0.03  # low-pass on a foot's speed
FLOOR_SETTLE_S = 0.3  # the floor follows the carrying feet


_OF_FEET = {one.feet: one for one in Carrying}


class CarryingFeet:
    """Estimates `carrying` from the ankles tick by tick, in the performer's time."""

    def __init__(self) -> None:
        self.carrying = Carrying.BOTH
        self._velocity: tuple[Velocity, ...] = ()

    def start(self, ankles: Sequence[Point]) -> Carrying:
        """Begin on the lower foot, and on the other unless it is high above. ankles: left and right, m."""
        self._floor, self._flight = min(ankle[2] for ankle in ankles), Dwell()
        self._velocity = (Velocity(FOOT_SPEED_SETTLE_S, 3), Velocity(FOOT_SPEED_SETTLE_S, 3))
        self._speeds(ankles, 0.0)
        self._carries = [ankle[2] - self._floor < LIFTED_M for ankle in ankles]
        self._otherwise = Dwell(), Dwell()  # for how long each foot has seemed to be in the other state
        return self._decide()

    def step(self, ankles: Sequence[Point], dt: float) -> Carrying:
        """Go on by `dt` s of the performer's time."""
        if not self._velocity:
            return self.start(ankles)
        speeds = self._speeds(ankles, dt)
        for foot in (0, 1):
            carries = self._carries[foot]
            if carries:
                otherwise = self._lifts_off(foot, ankles, speeds)
            else:
                otherwise = ankles[foot][2] - self._floor < TOUCHDOWN_M and speeds[foot] < TOUCHDOWN_M_S
            dwell = self._otherwise[foot]
            if dwell.step(dt, holds=otherwise) > (LIFT_DWELL_S if carries else TOUCHDOWN_DWELL_S):
                self._carries[foot], dwell.held = not carries, 0.0
        # The lower foot of a flight that is too long stands on another floor.
        flown = self._flight.step(dt, holds=not any(self._carries))
        lower = 0 if ankles[0][2] < ankles[1][2] else 1
        if flown > LONGEST_FLIGHT_S and speeds[lower] < TOUCHDOWN_M_S:
            self._floor, self._flight.held = ankles[lower][2], 0.0
            self._carries[lower] = True
        down = [ankle[2] for ankle, carries in zip(ankles, self._carries, strict=True) if carries]
        if down:
            lowest = min(down)
            self._floor = low_pass(self._floor, lowest, inf if lowest < self._floor else dt / FLOOR_SETTLE_S)
        return self._decide()

    def _lifts_off(self, foot: int, ankles: Sequence[Point], speeds: list[float]) -> bool:
        """On tiptoe both ankles are high, and alike."""
        height, other = ankles[foot][2], 1 - foot
        if self._carries[other]:
            return speeds[foot] > LIFT_M_S or height - min(self._floor + LEFT_M, ankles[other][2] + LIFTED_M) > 0.0
        return speeds[foot] > LAST_LIFT_M_S or height - self._floor > LEFT_M

    def _speeds(self, ankles: Sequence[Point], dt: float) -> list[float]:
        for velocity, ankle in zip(self._velocity, ankles, strict=True):
            velocity.step(ankle, dt)
        return [velocity.speed for velocity in self._velocity]

    def _decide(self) -> Carrying:
        left, right = self._carries
        self.carrying = _OF_FEET[left, right]
        return self.carrying


# Neither a weight nor its rate may jump, as joints would jump with it. Hence two low-passes in a row.

SHARE_SETTLE_S = 0.03  # a change is half done after 0.05 s; a walking foot is 0.4 s in the air


class PhaseShares:
    """Shares of the phases of support, without a jump of value or rate."""

    def __init__(self) -> None:
        # Load of the left foot + i times that of the right one, behind one low-pass and behind both.
        self._once = self._twice = _loads(Carrying.BOTH)

    @property
    def now(self) -> Mapping[Phase, float]:
        """The share of each phase, as products of the feet's loads."""
        left, right = self._twice.real, self._twice.imag
        return {
            "double": left * right,
            "left": left * (1.0 - right),
            "right": (1.0 - left) * right,
            "flight": (1.0 - left) * (1.0 - right),
        }

    def step(self, carrying: Carrying, dt: float) -> Mapping[Phase, float]:
        """The shares `dt` s later."""
        self._once = low_pass(self._once, _loads(carrying), dt / SHARE_SETTLE_S)
        self._twice = low_pass(self._twice, self._once, dt / SHARE_SETTLE_S)
        return self.now


def _loads(carrying: Carrying) -> complex:
    return complex(*carrying.feet)
