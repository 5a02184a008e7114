"""Travel of a performer: how fast a robot is to walk and turn, from where their feet go and where they face.

The robot walks in its own frame as the performer does in theirs, scaled by the length of the leg. It begins when they
lift their feet in turn, on the spot or on their way, and ends when both stay down. What it is behind, because it is
late or slower than they are, it makes up for, but no more than two steps: so it stops when they do.
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
"""Duration (s) of a stride that is not known yet, and the longest. The performer's velocity is a mean over their last
stride: within it their feet go by turns, and pelvis and shoulders swing."""
STEP_S = 0.7
"""Duration (s) of a step that is not known yet."""
SEEN_S = 0.5 * (LIFT_DWELL_S + TOUCHDOWN_DWELL_S) + FOOT_SPEED_SETTLE_S
"""Time (s) by which the middle of a swing is seen late."""
CATCH_UP_S = 2.5
"""Time (s) in which what the robot is behind would be made up for; once the performer stands, that of a step."""
LEASH = 2.0
"""Most that it may be behind, in steps at its fastest."""
MOST_TURN = 1.5
"""Most (rad) that it may be behind in its turn while they walk on: so it faces their way in the end."""
LIFTED_S, LIFTED = 0.7, 0.4
"""s since a foot was lifted last, after which both stay down, or as a share of a stride if that is longer: more than a
walker has both on the floor."""
ONE_LEG_S = 3.0
"""A performer with one foot in the air for so long (s) stands on one leg."""
SLOWEST = 0.25
"""Share of the robot's fastest walk at which the middle of the feet of a performer goes who walks: with it one lifted
foot is enough to begin, else feet are lifted in turn."""
LEFT_OVER = 0.5
"""Steps behind, at its fastest, that are not worth another one."""
_FOOT = {Carrying.LEFT: 1, Carrying.RIGHT: 0}
"""The foot in the air, by the one that carries."""


@dataclass(frozen=True)
class WalkTally:
    """What became of a walk. steps: made. walked_m, turned_deg: gone by the robot; asked_m, asked_turn_deg: by the
    performer, m scaled by the leg, or by a stick."""

    steps: int = 0
    walked_m: float = 0.0
    asked_m: float = 0.0
    turned_deg: float = 0.0
    asked_turn_deg: float = 0.0


class Strides:
    """Finds out when a performer's feet are in the air, and from that whether they walk. `duration`: s of their last
    stride."""

    def __init__(self, dt: float) -> None:
        """dt: s between ticks."""
        self._dt, self.walks = dt, False
        self._in_air = [inf, inf]  # s since either foot was
        self._lifts = list[float]()  # s since the last three times that a foot left the floor
        self._foot = 0  # the last of these
        # The foot that was in the air last, and s since the middle of that.
        self._swung: tuple[int, float] | None = None

    @property
    def duration(self) -> float:
        """s of the last stride; STRIDE_S of one that is not known."""
        return min(self._lifts[0] - self._lifts[2], LONGEST_S) if len(self._lifts) == 3 else STRIDE_S

    @property
    def swing(self) -> Swing | None:
        """The last swing of a foot, or the first one while it lasts; None: there was none."""
        if not self._lifts:
            return None
        period = self._lifts[-2] - self._lifts[-1] if len(self._lifts) == 2 else 0.5 * self.duration
        period = STEP_S if len(self._lifts) == 1 else period
        foot, since = self._swung or (self._foot, self._lifts[-1] - 0.5 * STEP_S)
        return Swing(foot, since, period)

    def look(self, carrying: Carrying, *, travels: bool) -> None:
        """Look at the feet after another tick. travels: whether their middle goes somewhere."""
        dt, lifted = self._dt, _FOOT.get(carrying)
        self._lifts = [since + dt for since in self._lifts]
        self._swung = (self._swung[0], self._swung[1] + dt) if self._swung else None
        if self._lifts and self._in_air[self._foot] == 0.0 and lifted != self._foot:  # it has landed
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
    """Turns the travel of one performer, or the velocity of a stick, into the velocity that is asked of one robot.
    `asked`, `walked`: m gone by both, scaled, and rad turned. `swing`: of the performer with whom the robot is to keep
    step; None: with nobody."""

    def __init__(self, gait: Gait, fastest: Request, *, scale: float) -> None:
        """fastest: what the robot can. scale: of lengths, from the performer's leg to the robot's."""
        self._scale, self._gait = scale, gait
        self.swing: Swing | None
        self._most = np.array([fastest.forward, fastest.left, fastest.turn])
        self.asked, self.walked = np.zeros(2), np.zeros(2)
        self.resume()

    def resume(self) -> None:
        """Go on after a hold: what the performer did meanwhile is no way to go."""
        self._strides, self.swing = Strides(self._gait.dt), None
        self._before: tuple[float, float, float] | None = None
        longest = round(LONGEST_S / self._gait.dt) + 1
        self._gone = deque([np.zeros(3)], longest)  # [m, m, rad] at every tick
        self._sums = deque([np.zeros(3)], longest)  # of these
        self._followed = np.zeros(3)  # of that, what the robot has been asked for
        self._behind = np.zeros(3)
        self._goes = False

    def step(self, human: "HumanPosture", robot: Request) -> Request | None:
        """The velocity for the next step after another tick; None: stand. robot: the velocity of its present step."""
        dt, step = self._gait.dt, self._gait.period * self._most
        self._gone.append(self._gone[-1] + self._moved(human))
        self._sums.append(self._sums[-1] + self._gone[-1])
        self._strides.look(human.carrying, travels=self._travels())
        self.swing = self._strides.swing
        walks, speed, mean = self._strides.walks, np.zeros(3), self._gone[-1]
        if walks or not self._goes:  # once they stand, the robot goes to where they are
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
        self.asked += _length(came)
        forward, left, turn = (
            speed + self._behind / (max(CATCH_UP_S, 0.5 * self._strides.duration) if walks else self._gait.period)
        ).tolist()
        return Request(forward, left, turn)

    def steer(self, robot: Request, stick: Request) -> Request | None:
        """As `step`, of a robot that a stick asks for a velocity, all zeros to stand."""
        self.swing = None
        for gone, one in ((self.walked, robot), (self.asked, stick)):
            gone += self._gait.dt * _length(np.array([one.forward, one.left, one.turn]))
        return None if stick == Request() else stick

    def _moved(self, human: "HumanPosture") -> FloatArray:
        """How far the middle of both feet went since the last tick, forward and left of the performer, scaled, m; and
        how far they turned, rad."""
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

    def _travels(self) -> bool:
        """Whether the middle of the feet goes somewhere."""
        far = self._gone[-1] - self._gone[max(len(self._gone) - 1 - round(LIFTED_S / self._gait.dt), 0)]
        return bool((np.abs(far) > SLOWEST * LIFTED_S * self._most)[:2].any())


def _length(moved: FloatArray) -> FloatArray:
    """Length [m, rad] of a way forward, left and turned (3,)."""
    return np.array([hypot(float(moved[0]), float(moved[1])), abs(float(moved[2]))])
