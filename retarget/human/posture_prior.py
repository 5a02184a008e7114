"""Posture prior: goals of the body where no sensor measures it: balance, the pelvis, a crouch, and virtual feet."""

from bisect import bisect_right
from collections.abc import Mapping, Sequence
from math import fsum, pi, sqrt
from pathlib import Path
from typing import Any

import numpy as np

from retarget.arithmetic import cos, exp, hypot, low_pass, norm, norms, sin
from retarget.model.human import Human, PostureReader
from retarget.model.human_dimensions import FRACTIONS, POINTS, HumanDimensions
from retarget.schema import strict_yaml
from retarget.schema.priorities import CentreOfMassTask, HeadingSettings
from retarget.types import FloatArray

Point = Sequence[float]
Ground = tuple[float, float]

SPEED_SETTLE_S = 0.2  # low-pass on the speed of travel
LIFT_M = 0.08  # a foot that is lifted this far above the other carries half as much
HEEL_M = 0.3  # the same in a deep crouch, where a high ankle is a raised heel


class Velocity:
    """The low-passed velocity `now`, m/s, of a point. settle: time constant, s."""

    def __init__(self, settle: float, axes: int = 2) -> None:
        self._settle, self._axes = settle, axes
        self.start()

    def start(self) -> None:
        """Begin at rest, without a past."""
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

    The goal is the centre of the feet, weighed by their loads. A body that travels need not be in balance, so the
    weight falls with the speed of the feet.
    """

    def __init__(self, task: CentreOfMassTask) -> None:
        self._task = task
        self._travel = Velocity(SPEED_SETTLE_S, 3)
        self.goal: FloatArray = np.zeros(3)
        self.weight = 0.0

    def start(self) -> None:
        """Begin at rest, without a past."""
        self._travel.start()

    def step(self, feet: Sequence[Sequence[float]], forward: Ground, *, dt: float, lowered: float = 0.0) -> None:
        """Go on by `dt` s. feet: known ankles, m. forward: heading, unit vector. lowered: share of the crouch, 0 to 1."""
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
    """The pelvis goes about as far as head and feet do on average (`by`: their shares), without a filter or delay.

    Feet that both fly, as in a jump with the legs drawn up, count less.
    """

    def __init__(self, by: Mapping[str, float]) -> None:
        self._share = by["head"]
        self._others = [(name, share) for name, share in by.items() if name != "head"]
        self._before: dict[str, list[float]] = {}

    def start(self) -> None:
        """Begin without a past."""
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


# Hips, knees and the lumbar spine bend together when a person gets down. In 200 recorded pieces the distance of the
# head from the farther foot gives the bend of the straighter knee to within 9 to 19 degrees, and the height of the
# head, which a wide stance lowers too, to within 8 to 32.


BENT_AHEAD, BENT_LOWERED = 0.35, 0.25
"""A body bends over fully when its head is this far ahead of the feet, as a share of their distance upright, and this
share of the crouch is reached. Fitted to recordings: where the head is ahead gives the lean of the trunk (R^2 0.79)."""


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
        """Share of the crouch, 0 upright to 1 lowered, of a head `away` m from the farther ankle."""
        return min(max((self._upright_m - away) / (self._upright_m - self._lowered_m), 0.0), 1.0)

    def share_by_height(self, height: float) -> float:
        """The same for a head `height` m above standing ankles."""
        lowered = 0.0
        for _ in range(3):  # the head is further ahead in a deeper crouch
            lowered = self.share(hypot(height, self._across[0] + lowered * (self._across[1] - self._across[0])))
        return lowered

    def bent(self, share: float, ahead: float) -> float:
        """Share of bending over, 0 to 1. share: of the crouch. ahead: distance of the head ahead of the feet, m."""
        far = min(max(ahead / (BENT_AHEAD * self._upright_m), 0.0), 1.0)
        return far * min(share / BENT_LOWERED, 1.0)

    def posture(self, share: float) -> FloatArray:
        """The natural posture (nq,) at this share."""
        return np.asarray(self._upright + share * self._change)


# With sensors on head and hands only, nothing measures the legs. The feet stay planted while the head moves above them,
# and step after it when it leaves them behind. The middle of walking feet goes at the head's own velocity. In a jump
# the feet leave the floor.

HEAD_LEAD_M = (0.03, 0.40)  # [m] the head is ahead of the ankles, upright and in a deep crouch
REACH_M = 0.12  # [m] a standing performer's head may wander before the feet follow
STEP_M, STEP_S, STRIDE_M, STEP_LIFT_M = 0.1, 0.3, 0.35, 0.05
"""A foot steps when it is this far (m) from its place. A step takes at most this many s and m of the body's path, less
than people's, so that the legs bend little at an unknown phase of the gait. The ankle rises by the last, m."""
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
        """Stand under the head. The arguments are those of `step`."""
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
        self._stride(head, self._beside(forward), walks * np.array([x, y]), dt)

    def _stride(self, head: list[float], wanted: FloatArray, velocity: FloatArray, dt: float) -> None:
        seconds = min(STEP_S, STRIDE_M / max(norm(velocity), 1e-9))
        if self._swung >= 1.0:
            behind = norms(wanted - self._planted)
            foot = int(behind.argmax())
            if behind[foot] > STEP_M:
                self._swinging, self._swung = foot, 0.0
        ground, foot = self._planted.copy(), self._swinging
        lift = 0.0
        if self._swung < 1.0:
            self._swung = min(self._swung + dt / seconds, 1.0)
            # The foot touches down half a step ahead of the body, which will be there when the other foot does.
            ahead = wanted[foot] + (1.5 - self._swung) * seconds * velocity
            share = 0.5 - 0.5 * cos(pi * self._swung)
            ground[foot] += share * (ahead - ground[foot])
            height = sin(pi * self._swung)
            lift = STEP_LIFT_M * height * height
            if self._swung >= 1.0:
                self._planted[foot] = ground[foot]
        self._place(head, ground, lift)

    def _below(self, head: list[float], forward: Ground, crouch: float) -> Ground:
        lead = HEAD_LEAD_M[0] + crouch * (HEAD_LEAD_M[1] - HEAD_LEAD_M[0])
        return head[0] - lead * forward[0], head[1] - lead * forward[1]

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


# No single hint is enough: the line between the ankles is wrong by 69 degrees on average while walking. So the hints
# are summed as vectors on the ground, which adds up the evidence of von Mises distributions. Hands and head hint by
# their place relative to the middle of the body, with fitted weights (`heading.yaml`, by `python -m
# benchmarks.heading_fit`).

_LEARNED: Mapping[str, Any] = strict_yaml.load(Path(__file__).with_name("heading.yaml")).data

_NO_HINT_M = 0.01  # a shorter sum gives no direction, and the last heading stays
_NEAR = 0.03  # share of the head's height; the direction of a nearer hand is unclear, so its hint fades once more
STANCE_S = 10.0  # longest time over which the hints of one stance are averaged
_STEP_SETTLE_S = 0.05  # low-pass on the speed of the feet
_PLANTED_M_S = 0.4  # feet are planted when both are slower
_APART_M = 0.05  # nearer feet do not show how they turn


class _Table:
    """Bilinear weights on a grid, constant outside of it, and 0 at distance 0."""

    def __init__(
        self, distances: Sequence[float], heights: Sequence[float], weights: Sequence[Sequence[complex]]
    ) -> None:
        self._distances, self._heights = [0.0, *distances], list(heights)
        self._weights = [[0j] * len(heights), *(list(row) for row in weights)]

    def at(self, distance: float, height: float) -> complex:
        """The weight at a distance on the ground and a height, as shares of the head's height."""
        i, s = _between(self._distances, distance)
        j, t = _between(self._heights, height)
        near, far = self._weights[i], self._weights[i + 1]
        return (1.0 - s) * ((1.0 - t) * near[j] + t * near[j + 1]) + s * ((1.0 - t) * far[j] + t * far[j + 1])


def _between(nodes: list[float], value: float) -> tuple[int, float]:
    value = min(max(value, nodes[0]), nodes[-1])
    before = min(bisect_right(nodes, value), len(nodes) - 1) - 1
    return before, (value - nodes[before]) / (nodes[before + 1] - nodes[before])


_HAND = _Table(
    _LEARNED["reach"],
    _LEARNED["height"],
    (np.array(_LEARNED["hand"]["forward"]) - 1j * np.array(_LEARNED["hand"]["side"])).tolist(),
)  # turn and weight of a hint by the place of the left hand; the right hand's are the conjugate
_HEAD = _Table(_LEARNED["lead"], _LEARNED["head_height"], _LEARNED["head"])


class Heading:
    """The low-passed heading. `forward` (x, y) is a unit vector on the ground, world frame."""

    def __init__(self, settings: HeadingSettings, head_height: float, *, feet: bool = True) -> None:
        """head_height: m, above the ankles, standing. feet: True if ankles are measured."""
        self._settings, self._head_height = settings, head_height
        self._stance = _Stance(settings.settle) if feet else None
        self._sum = 0j
        self._head = Velocity(settings.velocity_settle)
        named = [(f"l_{part}", f"r_{part}", weight) for part, weight in settings.pairs.items() if weight > 0.0]
        self._moving_pairs = [pair for pair in named if pair[0][2:] in _LIMBS]
        self._trunk_pairs = [pair for pair in named if pair[0][2:] not in _LIMBS]
        self.forward: Ground = (1.0, 0.0)

    def start(self, positions: Mapping[str, Point], facing: Mapping[str, Ground]) -> None:
        """Take the heading of one instant, unfiltered."""
        self._head.start()
        moving, measured = self._moving(positions), self._measured(positions, facing)
        share = 0.0 if self._stance is None else self._settings.stance  # of the moving hints that the stance averages
        self._sum = (1.0 - share) * moving + measured
        if self._stance is not None:
            self._stance.start(moving)
        self._turn(moving + measured)

    def step(self, positions: Mapping[str, Point], facing: Mapping[str, Ground], *, dt: float) -> None:
        """Go on by `dt` s. positions: x, y (and z) m by sensor, valid ones only. facing: forward axes (x, y) of
        oriented sensors, shorter than one where they point up or down."""
        self._head.step(positions.get("head"), dt)
        moving = self._moving(positions)
        now = moving + self._measured(positions, facing)
        stance = 0j
        if self._stance is not None and self._settings.stance > 0.0:
            stance = self._settings.stance * self._stance.step(positions, moving, dt)
            now -= self._settings.stance * moving
        self._sum = low_pass(self._sum, now, dt / self._settings.settle)
        self._turn(self._sum + stance)

    def _moving(self, positions: Mapping[str, Point]) -> complex:
        """Sum of the hints of head, hands and ankles, which move about the body: x + i y, forward."""
        settings = self._settings
        slow, fast = settings.walking
        share = min(max((self._head.speed - slow) / (fast - slow), 0.0), 1.0)
        total = settings.velocity * share * complex(*self._head.now)
        if settings.hands > 0.0:
            total += settings.hands * _hands_ahead(positions)
        total += _lines(positions, self._moving_pairs)
        return total + (settings.learned * self._seen(positions) if settings.learned > 0.0 else 0j)

    def _measured(self, positions: Mapping[str, Point], facing: Mapping[str, Ground]) -> complex:
        """Sum of the hints that turn with the body: lines across the trunk, and orientations."""
        total = _lines(positions, self._trunk_pairs)
        for name, axis in facing.items():
            total += self._settings.facing.get(name, 0.0) * complex(*axis)
        return total

    def _seen(self, positions: Mapping[str, Point]) -> complex:
        """Hints of the fitted tables for hands and head."""
        head = positions.get("head")
        if head is None:
            return 0j
        feet = [positions[name] for name in ("l_ankle", "r_ankle") if name in positions]
        height, middle = self._head_height, complex(head[0], head[1])
        floor = head[2] - height
        total = 0j
        if feet:
            under = complex(*(fsum(foot[k] for foot in feet) / len(feet) for k in (0, 1)))
            floor = min(foot[2] for foot in feet)
            total += _hint(_HEAD, middle - under, head[2] - floor, height)
            middle = 0.5 * (middle + under)
        for side in "lr":
            hand = positions.get(side + "_wrist")
            if hand is not None:
                hint = _hint(_HAND, complex(hand[0], hand[1]) - middle, hand[2] - floor, height, mirror=side == "r")
                total += hint
        return total

    def _turn(self, total: complex) -> None:
        size = hypot(total.real, total.imag)
        if size > _NO_HINT_M:
            self.forward = (total.real / size, total.imag / size)


_LIMBS = ("ankle", "wrist", "knee", "elbow")


def _hint(table: _Table, away: complex, up: float, height: float, *, mirror: bool = False) -> complex:
    distance = hypot(away.real, away.imag) / height
    weight = table.at(distance, up / height)
    return _times(weight.conjugate() if mirror else weight, away / height) / max(distance, _NEAR)


def _times(a: complex, b: complex) -> complex:
    """a b. Written out, as compilers may fuse a product of complex numbers with its sum."""
    return complex(a.real * b.real - a.imag * b.imag, a.real * b.imag + a.imag * b.real)


def _lines(positions: Mapping[str, Point], pairs: Sequence[tuple[str, str, float]]) -> complex:
    """Weighted sum, m, of the lines from right to left of known pairs, turned forward."""
    total = 0j
    for left, right, weight in pairs:
        if left in positions and right in positions:
            to, of = positions[left], positions[right]
            total += weight * complex(to[1] - of[1], of[0] - to[0])
    return total


_BETWEEN_FEET = (("l_ankle", "r_ankle", 1.0),)


def _hands_ahead(positions: Mapping[str, Point]) -> complex:
    """From the middle of the ankles to that of the wrists, m."""
    try:
        hands = positions["l_wrist"], positions["r_wrist"]
        feet = positions["l_ankle"], positions["r_ankle"]
    except KeyError:
        return 0j
    x, y = (0.5 * (hands[0][k] + hands[1][k] - feet[0][k] - feet[1][k]) for k in (0, 1))
    return complex(x, y)


class _Stance:
    """The mean of the hints since both feet were planted, over at most `STANCE_S`.

    Planted feet do not turn, so earlier hints still hold for the hips. Feet that shuffle turn the mean.
    """

    def __init__(self, settle: float) -> None:
        self._settle = settle
        self._feet = (Velocity(_STEP_SETTLE_S, 3), Velocity(_STEP_SETTLE_S, 3))
        self.start(0j)

    def start(self, hints: complex) -> None:
        for foot in self._feet:
            foot.start()
        self._mean, self._age = hints, self._settle
        self._line = 0j

    def step(self, positions: Mapping[str, Point], hints: complex, dt: float) -> complex:
        for foot, name in zip(self._feet, ("l_ankle", "r_ankle"), strict=True):
            foot.step(positions.get(name), dt)
        speed = max(foot.speed for foot in self._feet)
        before, self._line = self._line, _lines(positions, _BETWEEN_FEET)
        if speed < _PLANTED_M_S and "l_ankle" in positions and "r_ankle" in positions:
            self._age = min(self._age + dt, STANCE_S)
            if min(hypot(line.real, line.imag) for line in (before, self._line)) > _APART_M:
                turn = _times(self._line, before.conjugate())
                self._mean = _times(self._mean, turn / hypot(turn.real, turn.imag))
        else:  # the mean of the stance before fades as fast as any other
            self._age = low_pass(self._age, self._settle, dt / self._settle)
        self._mean = low_pass(self._mean, hints, dt / self._age)
        return self._mean
