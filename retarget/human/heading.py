"""Heading: where the performer faces, from a few sensors.

No hint is enough alone: the line between the ankles is wrong by 69 degrees on average while walking, that between the
wrists by 38 where one hand works. So hints are summed, each a vector on the ground, as the evidence of von Mises
distributions is. Hands and head hint by where they are seen from the middle of the body (`heading.yaml`, learned);
sensors with a left and a right, or with an orientation, hint by themselves.
"""

from bisect import bisect_right
from collections.abc import Mapping, Sequence
from math import fsum
from pathlib import Path
from typing import Any

import numpy as np

from retarget.arithmetic import exp, hypot
from retarget.human.posture_prior import Ground, Point, Velocity
from retarget.schema import strict_yaml
from retarget.schema.priorities import HeadingSettings

_LEARNED: Mapping[str, Any] = strict_yaml.load(Path(__file__).with_name("heading.yaml")).data

_NO_HINT_M = 0.01
"""A sum shorter than this gives no direction: the last heading stays."""
_NEAR = 0.03
"""Share of the height of the head. A hand or head nearer to where it is seen from has no clear direction, and its hint
falls with the distance once more."""
STANCE_S = 10.0
"""Longest time over which the hints of one stance are averaged."""
_STEP_SETTLE_S = 0.05
"""Time constant of the low-pass on the speed of the feet."""
_PLANTED_M_S = 0.4
"""Feet that are both slower are planted."""
_APART_M = 0.05
"""Feet nearer to each other than this do not show how they turn."""


class _Table:
    """Weights between the nodes of a grid, bilinear: clamped outside the grid; weight 0 at distance 0."""

    def __init__(
        self, distances: Sequence[float], heights: Sequence[float], weights: Sequence[Sequence[complex]]
    ) -> None:
        self._distances, self._heights = [0.0, *distances], list(heights)
        self._weights = [[0j] * len(heights), *(list(row) for row in weights)]

    def at(self, distance: float, height: float) -> complex:
        """The weight at a distance on the ground and a height, both as shares of the height of the head."""
        i, s = _between(self._distances, distance)
        j, t = _between(self._heights, height)
        near, far = self._weights[i], self._weights[i + 1]
        return (1.0 - s) * ((1.0 - t) * near[j] + t * near[j + 1]) + s * ((1.0 - t) * far[j] + t * far[j + 1])


def _between(nodes: list[float], value: float) -> tuple[int, float]:
    """The node before a value, and the share of the way to the next."""
    value = min(max(value, nodes[0]), nodes[-1])
    before = min(bisect_right(nodes, value), len(nodes) - 1) - 1
    return before, (value - nodes[before]) / (nodes[before + 1] - nodes[before])


_HAND = _Table(
    _LEARNED["reach"],
    _LEARNED["height"],
    (np.array(_LEARNED["hand"]["forward"]) - 1j * np.array(_LEARNED["hand"]["side"])).tolist(),
)
"""A hint's turn and weight by where the left hand is; the right hand's are the conjugate."""
_HEAD = _Table(_LEARNED["lead"], _LEARNED["head_height"], _LEARNED["head"])


class Heading:
    """The low-passed heading. `forward` (x, y) is a unit vector on the ground, world frame."""

    def __init__(self, settings: HeadingSettings, head_height: float, *, feet: bool = True) -> None:
        """head_height: m, of the head above the ankles, standing. feet: whether ankles are measured."""
        self._settings, self._head_height = settings, head_height
        self._stance = _Stance(settings.settle) if feet else None
        self._sum = 0j
        self._head = Velocity(settings.velocity_settle)
        named = [(f"l_{part}", f"r_{part}", weight) for part, weight in settings.pairs.items() if weight > 0.0]
        self._moving_pairs = [pair for pair in named if pair[0][2:] in _LIMBS]
        self._trunk_pairs = [pair for pair in named if pair[0][2:] not in _LIMBS]
        self.forward: Ground = (1.0, 0.0)

    def start(self, positions: Mapping[str, Point], facing: Mapping[str, Ground]) -> None:
        """Take the heading of one instant, without any filtering. Arguments as of `step`."""
        self._head.start()
        moving, measured = self._moving(positions), self._measured(positions, facing)
        share = 0.0 if self._stance is None else self._settings.stance  # of the moving hints, which the stance keeps
        self._sum = (1.0 - share) * moving + measured
        if self._stance is not None:
            self._stance.start(moving)
        self._turn(moving + measured)

    def step(self, positions: Mapping[str, Point], facing: Mapping[str, Ground], *, dt: float) -> None:
        """Go on by `dt` seconds.

        positions: x, y (and z) m by sensor, valid ones only. facing: forward axes (x, y) of sensors with an
        orientation, shorter than one where they point up or down.
        """
        self._head.step(positions.get("head"), dt)
        moving = self._moving(positions)
        now = moving + self._measured(positions, facing)
        stance = 0j
        if self._stance is not None and self._settings.stance > 0.0:
            stance = self._settings.stance * self._stance.step(positions, moving, dt)
            now -= self._settings.stance * moving
        self._sum += (1.0 - exp(-dt / self._settings.settle)) * (now - self._sum)
        self._turn(self._sum + stance)

    def _moving(self, positions: Mapping[str, Point]) -> complex:
        """Sum of the hints of parts that move about the body: of head, hands and ankles. x + i y, forward."""
        settings = self._settings
        slow, fast = settings.walking
        share = min(max((self._head.speed - slow) / (fast - slow), 0.0), 1.0)
        total = settings.velocity * share * complex(*self._head.now)
        if settings.hands > 0.0:
            total += settings.hands * _hands_ahead(positions)
        total += _lines(positions, self._moving_pairs)
        return total + (settings.learned * self._seen(positions) if settings.learned > 0.0 else 0j)

    def _measured(self, positions: Mapping[str, Point], facing: Mapping[str, Ground]) -> complex:
        """Sum of the hints of parts that turn with the body: lines across the trunk, and orientations."""
        total = _lines(positions, self._trunk_pairs)
        for name, axis in facing.items():
            total += self._settings.facing.get(name, 0.0) * complex(*axis)
        return total

    def _seen(self, positions: Mapping[str, Point]) -> complex:
        """What the learned tables say of where hands and head are."""
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
"""Parts of which the line from right to left moves about the body."""


def _hint(table: _Table, away: complex, up: float, height: float, *, mirror: bool = False) -> complex:
    """What a table says of a part that is `away` (m, on the ground) from where it is seen, `up` m above the floor."""
    distance = hypot(away.real, away.imag) / height
    weight = table.at(distance, up / height)
    return _times(weight.conjugate() if mirror else weight, away / height) / max(distance, _NEAR)


def _times(a: complex, b: complex) -> complex:
    """a b. A compiler may fuse a product of complex numbers with its sum."""
    return complex(a.real * b.real - a.imag * b.imag, a.real * b.imag + a.imag * b.real)


def _lines(positions: Mapping[str, Point], pairs: Sequence[tuple[str, str, float]]) -> complex:
    """Sum of the lines from the right of each pair to the left, turned forward, m by weight; 0 for those not known."""
    total = 0j
    for left, right, weight in pairs:
        if left in positions and right in positions:
            to, of = positions[left], positions[right]
            total += weight * complex(to[1] - of[1], of[0] - to[0])
    return total


_BETWEEN_FEET = (("l_ankle", "r_ankle", 1.0),)
"""The line of a stance: from the right ankle to the left one."""


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
    """The mean of hints since both feet were planted, over `STANCE_S` at most.

    Planted feet do not turn, so what hands and head said a while ago is still true of the hips. Feet that shuffle take
    it along."""

    def __init__(self, settle: float) -> None:
        self._settle = settle
        self._feet = (Velocity(_STEP_SETTLE_S, 3), Velocity(_STEP_SETTLE_S, 3))
        self.start(0j)

    def start(self, hints: complex) -> None:
        """Begin with the hints of one instant."""
        for foot in self._feet:
            foot.start()
        self._mean, self._age = hints, self._settle
        self._line = 0j

    def step(self, positions: Mapping[str, Point], hints: complex, dt: float) -> complex:
        """The mean `dt` s later, with these hints. positions: as of `Heading.step`."""
        for foot, name in zip(self._feet, ("l_ankle", "r_ankle"), strict=True):
            foot.step(positions.get(name), dt)
        speed = max(foot.speed for foot in self._feet)
        before, self._line = self._line, _lines(positions, _BETWEEN_FEET)
        if speed < _PLANTED_M_S and "l_ankle" in positions and "r_ankle" in positions:
            self._age = min(self._age + dt, STANCE_S)
            if min(hypot(line.real, line.imag) for line in (before, self._line)) > _APART_M:
                turn = _times(self._line, before.conjugate())
                self._mean = _times(self._mean, turn / hypot(turn.real, turn.imag))
        else:  # The mean of the stance before is forgotten as fast as any other.
            self._age += (1.0 - exp(-dt / self._settle)) * (self._settle - self._age)
        self._mean += (1.0 - exp(-dt / self._age)) * (hints - self._mean)
        return self._mean
