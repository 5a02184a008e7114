"""Travel of a performer: the velocity of a walking robot, from the path of the performer's feet and their heading.

The robot begins to walk when the performer lifts their feet in turn, and ends when both stay down.
"""

from collections import deque
from dataclasses import dataclass
from math import inf, isfinite
from typing import TYPE_CHECKING

import numpy as np

from retarget.arithmetic import arctan2, cos, hypot, sin
from retarget.human.support_phase import FOOT_SPEED_SETTLE_S, LIFT_DWELL_S, TOUCHDOWN_DWELL_S
from retarget.robot.walking.pattern import Gait, Request, Swing
from retarget.types import Carrying, FloatArray

if TYPE_CHECKING:
    from retarget.types import HumanPosture

STRIDE_S, LONGEST_S = 2.0, 5.0
"""Duration of an unknown and of the longest stride, s, over which the performer's velocity is a mean."""
STEP_S = 0.7
"""Duration of an unknown step, s."""
SEEN_S = 0.5 * (LIFT_DWELL_S + TOUCHDOWN_DWELL_S) + FOOT_SPEED_SETTLE_S
"""Delay of a detected swing, s."""
CATCH_UP_S = 2.5
"""Time constant of making up for a backlog, s."""
LEASH = 2.0
"""Greatest backlog, in steps at full speed."""
MOST_TURN = 1.5
"""Greatest backlog of turning during a walk, rad."""
LIFTED_S, LIFTED = 0.7, 0.4
"""Time since the last swing after which a performer stands: the longer of s and strides."""
ONE_LEG_S = 3.0
"""Time on one foot after which a performer stands, s."""
SLOWEST = 0.25
"""Speed from which a single lifted foot begins a walk, relative to the robot's fastest."""
LEFT_OVER = 0.5
"""Backlog, in steps at full speed, that is not made up for."""
_FOOT = {Carrying.LEFT: 1, Carrying.RIGHT: 0}  # the foot in the air, by the one that carries


@dataclass(frozen=True)
class WalkTally:
    """Totals of a walk: by the robot, and requested by the performer (scaled by the leg) or the stick."""

    steps: int = 0
    walked_m: float = 0.0
    asked_m: float = 0.0
    turned_deg: float = 0.0
    asked_turn_deg: float = 0.0


class Strides:
    """Detects a performer's swings, and whether they walk (`walks`)."""

    def __init__(self, dt: float) -> None:
        """dt: s between ticks."""
        self._dt, self.walks = dt, False
        self._in_air = [inf, inf]  # s since each foot was in the air
        self._lifts = list[float]()  # s since the last three lifts of a foot
        self._foot = 0  # the foot of the last lift
        self._swung: tuple[int, float] | None = None  # last foot that swung, and s since its middle

    @property
    def duration(self) -> float:
        """Duration of the last stride, s; STRIDE_S if unknown."""
        return min(self._lifts[0] - self._lifts[2], LONGEST_S) if len(self._lifts) == 3 else STRIDE_S

    @property
    def swing(self) -> Swing | None:
        """The last swing, or the first one in progress; None: there was none."""
        if not self._lifts:
            return None
        period = self._lifts[-2] - self._lifts[-1] if len(self._lifts) == 2 else 0.5 * self.duration
        period = STEP_S if len(self._lifts) == 1 else period
        foot, since = self._swung or (self._foot, self._lifts[-1] - 0.5 * STEP_S)
        return Swing(foot, since, period)

    def look(self, carrying: Carrying, *, travels: bool) -> None:
        """Take in the feet after a tick. travels: their middle moves."""
        dt, lifted = self._dt, _FOOT.get(carrying)
        self._lifts = [since + dt for since in self._lifts]
        self._swung = (self._swung[0], self._swung[1] + dt) if self._swung else None
        if self._lifts and self._in_air[self._foot] == 0.0 and lifted != self._foot:  # touchdown
            self._swung = self._foot, 0.5 * self._lifts[-1] + SEEN_S
        for foot in (0, 1):
            if foot == lifted and self._in_air[foot] > self._in_air[1 - foot]:
                self._lifts = [*self._lifts[-2:], 0.0]
                self._foot = foot
            self._in_air[foot] = 0.0 if foot == lifted else self._in_air[foot] + dt
        soon, late = sorted(self._in_air)
        stays = max(LIFTED_S, LIFTED * self.duration) if self.walks else LIFTED_S
        steps = soon < stays and bool(self._lifts) and self._lifts[-1] < ONE_LEG_S
        self.walks = steps and (self.walks or late < 3.0 * LIFTED_S or travels)
        if not self.walks:
            self._lifts, self._swung = [since for since in self._lifts[-1:] if since < ONE_LEG_S], None


class Travel:
    """Desired velocity of a robot from one performer's travel, or from a stick. desired, walked: totals (2,), m and
    rad; swing: to keep step with."""

    def __init__(self, gait: Gait, fastest: Request, *, scale: float) -> None:
        """scale: of lengths, from the performer's leg to the robot's."""
        self._scale, self._gait = scale, gait
        self.swing: Swing | None
        self._most = np.array([fastest.forward, fastest.left, fastest.turn])
        self.desired, self.walked = np.zeros(2), np.zeros(2)
        self.resume()

    def resume(self) -> None:
        """Go on after a hold, without the performer's travel meanwhile."""
        self._strides, self.swing = Strides(self._gait.dt), None
        self._before: tuple[float, float, float] | None = None
        longest = round(LONGEST_S / self._gait.dt) + 1
        self._gone = deque([np.zeros(3)], longest)  # forward and left, m, and turning, rad, at every tick
        self._sums = deque([np.zeros(3)], longest)
        self._followed = np.zeros(3)
        self._behind = np.zeros(3)
        self._goes = False

    def step(self, human: "HumanPosture", robot: Request) -> Request | None:
        """Velocity for the next step; None: stand. robot: velocity of its present step."""
        dt, step = self._gait.dt, self._gait.period * self._most
        self._gone.append(self._gone[-1] + self._moved(human))
        self._sums.append(self._sums[-1] + self._gone[-1])
        far = self._gone[-1] - self._gone[max(len(self._gone) - 1 - round(LIFTED_S / dt), 0)]
        travels = bool((np.abs(far) > SLOWEST * LIFTED_S * self._most)[:2].any())
        self._strides.look(human.carrying, travels=travels)
        self.swing = self._strides.swing
        walks, speed, mean = self._strides.walks, np.zeros(3), self._gone[-1]
        if walks or not self._goes:  # the robot walks on to a performer who stands
            count = min(round(self._strides.duration / dt), len(self._gone) - 1)
            speed = (self._gone[-1] - self._gone[-1 - count]) / (count * dt)
            mean = (self._sums[-1] - self._sums[-1 - count]) / count
        came, self._followed = mean - self._followed, mean
        walked = dt * np.array([robot.forward, robot.left, robot.turn])
        leash = LEASH * step
        leash[2] = max(leash[2], MOST_TURN) if walks else leash[2]
        self._behind = np.clip(self._behind + came - walked, -leash, leash)
        self.walked += _length(walked)
        self._goes = walks or (self._goes and bool((np.abs(self._behind) > LEFT_OVER * step).any()))
        if not self._goes:
            self._behind = np.zeros(3)
            return None
        self.desired += _length(came)
        forward, left, turn = (
            speed + self._behind / (max(CATCH_UP_S, 0.5 * self._strides.duration) if walks else self._gait.period)
        ).tolist()
        return Request(forward, left, turn)

    def steer(self, robot: Request, stick: Request) -> Request | None:
        """As `step`, for the velocity of a stick, all zeros to stand."""
        self.swing = None
        for gone, one in ((self.walked, robot), (self.desired, stick)):
            gone += self._gait.dt * _length(np.array([one.forward, one.left, one.turn]))
        return None if stick == Request() else stick

    def _moved(self, human: "HumanPosture") -> FloatArray:
        """Movement (3,) of the feet since the last tick: forward and left, m, scaled, and turning, rad."""
        left, right = human.joint("l_ankle").tolist(), human.joint("r_ankle").tolist()
        x, y = 0.5 * (left[0] + right[0]), 0.5 * (left[1] + right[1])
        yaw = arctan2(human.heading[1], human.heading[0])
        if not isfinite(x + y + yaw):  # no posture was found
            return np.zeros(3)
        a, b, before = (x, y, yaw) if self._before is None else self._before
        self._before = x, y, yaw
        c, s = self._scale * cos(yaw), self._scale * sin(yaw)
        turned = arctan2(sin(yaw - before), cos(yaw - before))
        return np.array([c * (x - a) + s * (y - b), c * (y - b) - s * (x - a), turned])


def _length(moved: FloatArray) -> FloatArray:
    return np.array([hypot(float(moved[0]), float(moved[1])), abs(float(moved[2]))])
