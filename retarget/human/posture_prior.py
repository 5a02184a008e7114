"""Posture prior: goals of the body where no sensor measures it: balance, the pelvis, a crouch, and virtual feet."""

from collections.abc import Mapping, Sequence
from math import fsum, pi, sqrt

import numpy as np

from retarget.arithmetic import cos, exp, hypot, low_pass, norm, norms, sin
from retarget.model.human import Human, PostureReader
from retarget.model.human_dimensions import FRACTIONS, POINTS, HumanDimensions
from retarget.schema.priorities import CentreOfMassTask
from retarget.types import FloatArray

Point = Sequence[float]
Ground = tuple[float, float]
ANKLES = ("l_ankle", "r_ankle")

SPEED_SETTLE_S = 0.2  # low-pass on the speed of travel
LIFT_M = 0.08  # a foot that is lifted this far above the other carries half as much
HEEL_M = 0.3  # the same in a deep crouch, where a high ankle is a raised heel


class Velocity:
    """The low-passed velocity `now`, m/s, of a point. settle: time constant, s."""

    def __init__(self, settle: float, axes: int = 2) -> None:
        self._settle, self._axes = settle, axes
        self.start()

    def start(self) -> None:
        """Begin at rest."""
        self.now: list[float] = [0.0] * self._axes
        self._before: Point | None = None

    @property
    def speed(self) -> float:
        """m/s."""
        return sqrt(fsum([part * part for part in self.now]))

    def step(self, point: Point | None, dt: float) -> None:
        """Go on by `dt` s. The velocity stays while the point is unknown (None)."""
        before, self._before = self._before, point
        if before is None or point is None:
            return
        for axis, now in enumerate(self.now):
            self.now[axis] = low_pass(now, (point[axis] - before[axis]) / dt, dt / self._settle)


class Balance:
    """The goal of an `over_feet` task: `goal` (3,) m, world (z unused), and its `weight`, 0 to 1.

    The goal is the centre of the feet by their loads. A travelling body need not be in balance, so the weight falls
    with the speed of the feet.
    """

    def __init__(self, task: CentreOfMassTask) -> None:
        self._task = task
        self._travel = Velocity(SPEED_SETTLE_S, 3)
        self.goal: FloatArray = np.zeros(3)
        self.weight = 0.0

    def start(self) -> None:
        """Begin at rest."""
        self._travel.start()

    def step(self, feet: Sequence[Sequence[float]], forward: Ground, *, dt: float, lowered: float = 0.0) -> None:
        """Go on by `dt` s. feet: known ankles, m. forward: heading, unit vector. lowered: share of the crouch."""
        if len(feet) == 2:
            (x, y, z), (u, v, w) = feet
            self._travel.step((0.5 * (x + u), 0.5 * (y + v), 0.5 * (z + w)), dt)
        else:
            self._travel.step(None, dt)
        if not feet:
            self.weight = 0.0
            return
        lowest = min(foot[2] for foot in feet)
        lift = LIFT_M + lowered * lowered * lowered * lowered * (HEEL_M - LIFT_M)
        raised = [(foot[2] - lowest) / lift for foot in feet]
        loads = [1.0 / (1.0 + by * by) for by in raised]
        total = fsum(loads)
        for axis in (0, 1):
            over = fsum(load * foot[axis] for load, foot in zip(loads, feet, strict=True)) / total
            self.goal[axis] = over + self._task.forward * forward[axis]
        fade = self._task.fade_speed
        speed = 0.0 if fade is None else self._travel.speed / fade
        self.weight = 1.0 / (1.0 + speed * speed * speed * speed)


FLYING_M_S = 3.0  # feet count half when their mean speed relative to the head is this


class Carried:
    """The pelvis goes about as far as head and feet do on average (`by`: their shares), without delay.

    Feet that both fly, as in a jump with the legs drawn up, count less.
    """

    def __init__(self, by: Mapping[str, float]) -> None:
        self._share = by["head"]
        self._others = [(name, share) for name, share in by.items() if name != "head"]
        self._before: dict[str, list[float]] = {}

    def start(self) -> None:
        """Begin anew."""
        self._before = {}

    def step(self, at: Sequence[float], points: dict[str, list[float]], dt: float) -> Point:
        """Return where a pelvis at (3,) m is after `dt` s in which the sensors went to `points`, m."""
        before, self._before = self._before, points
        x = y = z = total = 0.0
        for name, share in self._others:
            if name in points and name in before:
                (u, v, w), (a, b, c) = points[name], before[name]
                x, y, z, total = x + share * (u - a), y + share * (v - b), z + share * (w - c), total + share
        if total > 0.0:
            x, y, z = x / total, y / total, z / total
        if "head" in points and "head" in before:
            (u, v, w), (a, b, c) = points["head"], before["head"]
            u, v, w = u - a, v - b, w - c
            a, b, c, usual = x - u, y - v, z - w, FLYING_M_S * dt
            beside = (a * a + b * b + c * c) / (usual * usual)
            total /= 1.0 + beside
            share = total / (self._share + total)
            x, y, z = u + share * (x - u), v + share * (y - v), w + share * (z - w)
        return at[0] + x, at[1] + y, at[2] + z


# In 200 recorded pieces the distance of the head from the farther foot gives the bend of the straighter knee to within
# 9 to 19 degrees, and the height of the head, which a wide stance lowers too, to within 8 to 32.


BENT_AHEAD, BENT_LOWERED = 0.35, 0.25
"""A body bends over fully when its head is this far ahead of the feet, as a share of their distance upright, and this
share of the crouch is reached. Fitted to recordings (R^2 0.79)."""


class Crouch:
    """Interpolates between two postures of the human by the distance of the head from the feet."""

    def __init__(self, human: Human, *, upright: str, lowered: str) -> None:
        postures = np.stack([human.posture(upright), human.posture(lowered)])
        self._upright = postures[0]
        self._change = postures[1] - postures[0]
        joints = PostureReader(human).joints(postures)
        line = joints[:, POINTS.index("head")] - joints[:, POINTS.index("l_ankle")]
        self._upright_m, self._lowered_m = (float(away) for away in norms(line))
        self._across = [float(away) for away in norms(line[:, :2])]

    def share(self, away: float) -> float:
        """Share of the crouch, 0 upright to 1 lowered, by the distance, m, of the head from the farther ankle."""
        return min(max((self._upright_m - away) / (self._upright_m - self._lowered_m), 0.0), 1.0)

    def share_by_height(self, height: float) -> float:
        """The same for a head `height` m above the ankles."""
        lowered = 0.0
        for _ in range(3):  # the head is further ahead in a deeper crouch
            lowered = self.share(hypot(height, self._across[0] + lowered * (self._across[1] - self._across[0])))
        return lowered

    def bent(self, share: float, ahead: float) -> float:
        """Share of bending over, 0 to 1. share: of the crouch. ahead: m, of the head ahead of the feet."""
        far = min(max(ahead / (BENT_AHEAD * self._upright_m), 0.0), 1.0)
        return far * min(share / BENT_LOWERED, 1.0)

    def posture(self, share: float) -> FloatArray:
        """The natural posture (nq,) at this share."""
        return np.asarray(self._upright + share * self._change)


# Feet that are not measured stay planted while the head moves above them, and then step after it. The middle of walking
# feet goes at the head's own velocity.

HEAD_AHEAD_M = (0.03, 0.40)  # [m] the head is ahead of the ankles, upright and in a deep crouch
REACH_M = 0.12  # [m] a standing performer's head may wander before the feet follow
STEP_M, STEP_S, STRIDE_M, STEP_LIFT_M = 0.1, 0.3, 0.35, 0.05
"""A foot steps when it is this far (m) from its place. A step takes at most this many s and m of the body's path, less
than people's, so that legs bend little at an unknown phase of the gait. The ankle rises by the last, m."""
GLIDE_S = 0.15  # the feet follow with this time constant
SLACK_M = 0.03  # legs that leave the floor bend by this: a straight leg leaves the solver no freedom
TRAVEL_M_S = (0.5, 1.0)  # speeds of the head at which a performer begins to walk, and walks
TRAVEL_SETTLE_S = 0.3  # low-pass on the velocity of the head


class VirtualFeet:
    """Feet of a performer without ankle sensors: `ankles` (2, 3) m, left and right, world."""

    def __init__(self, dimensions: HumanDimensions) -> None:
        self._half_width = 0.5 * float(dimensions.of("l_hip")[1] - dimensions.of("r_hip")[1])
        self.ankle_height = FRACTIONS.ankle_height * dimensions.stature
        standing = dict(zip(POINTS, dimensions.standing(), strict=True))
        self._longest = norm(standing["head"] - standing["l_ankle"])  # [m] from head to ankle, standing
        self._travel = Velocity(TRAVEL_SETTLE_S)
        self._middle: Ground | None = None
        self._planted: FloatArray = np.zeros((2, 2))  # [m] where each foot stands, or stood last
        self._swinging, self._swung = 0, 1.0  # the foot that steps, or stepped last; share of its step
        self.ankles: FloatArray = np.zeros((2, 3))

    def start(self, head: list[float], forward: Ground, *, crouch: float) -> None:
        """Stand under the head."""
        self._travel.start()
        self._middle, self._swung = self._below(head, forward, crouch), 1.0
        self._planted = self._beside(forward)
        self._place(head, self._planted, 0.0)

    def step(self, head: list[float], forward: Ground, *, crouch: float, dt: float) -> None:
        """Go on by `dt` s. head: m. forward: heading, unit vector. crouch: its share, 0 to 1."""
        if self._middle is None:
            self.start(head, forward, crouch=crouch)
            return
        self._travel.step(head, dt)
        x, y = self._travel.now
        slow, fast = TRAVEL_M_S
        walks = min(max((hypot(x, y) - slow) / (fast - slow), 0.0), 1.0)
        u, v = self._middle[0] + walks * x * dt, self._middle[1] + walks * y * dt
        below, reach = self._below(head, forward, crouch), (1.0 - walks) * REACH_M
        dx, dy = below[0] - u, below[1] - v
        distance = hypot(dx, dy)
        share = low_pass(0.0, max(distance - reach, 0.0), dt / GLIDE_S) / max(distance, 1e-9)
        self._middle = (u + share * dx, v + share * dy)
        desired, velocity = self._beside(forward), walks * np.array([x, y])
        seconds = min(STEP_S, STRIDE_M / max(norm(velocity), 1e-9))
        if self._swung >= 1.0:
            behind = norms(desired - self._planted)
            foot = int(behind.argmax())
            if behind[foot] > STEP_M:
                self._swinging, self._swung = foot, 0.0
        ground, foot = self._planted.copy(), self._swinging
        lift = 0.0
        if self._swung < 1.0:
            self._swung = min(self._swung + dt / seconds, 1.0)
            # The foot touches down half a step ahead of the body.
            ahead = desired[foot] + (1.5 - self._swung) * seconds * velocity
            share = 0.5 - 0.5 * cos(pi * self._swung)
            ground[foot] += share * (ahead - ground[foot])
            height = sin(pi * self._swung)
            lift = STEP_LIFT_M * height * height
            if self._swung >= 1.0:
                self._planted[foot] = ground[foot]
        self._place(head, ground, lift)

    def _below(self, head: list[float], forward: Ground, crouch: float) -> Ground:
        ahead = HEAD_AHEAD_M[0] + crouch * (HEAD_AHEAD_M[1] - HEAD_AHEAD_M[0])
        return head[0] - ahead * forward[0], head[1] - ahead * forward[1]

    def _beside(self, forward: Ground) -> FloatArray:
        assert self._middle is not None
        aside = self._half_width * np.array([-forward[1], forward[0]])
        return np.asarray(np.array(self._middle) + np.array([aside, -aside]))

    def _place(self, head: list[float], ground: FloatArray, lift: float) -> None:
        self.ankles[:, :2], self.ankles[:, 2] = ground, self.ankle_height
        self.ankles[self._swinging, 2] += lift
        away = self.ankles - head
        distance = norms(away)
        for foot in np.flatnonzero(distance > self._longest):
            bent = SLACK_M * (1.0 - exp((self._longest - distance[foot]) / SLACK_M))
            self.ankles[foot] = head + (self._longest - bent) / distance[foot] * away[foot]
