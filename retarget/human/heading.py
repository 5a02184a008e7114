"""Heading: where the performer faces, from a few sensors.

No single hint is enough: the line between the ankles is wrong by 69 degrees on average while walking. So hints are
summed as vectors on the ground, as the evidence of von Mises distributions adds up. Hands and head hint by their place
relative to the body, with fitted weights (`heading.yaml`, by `python -m benchmarks.heading_fit`).
"""

from bisect import bisect_right
from collections.abc import Mapping, Sequence
from math import fsum
from pathlib import Path
from typing import Any

import numpy as np

from retarget.arithmetic import hypot, low_pass
from retarget.human.posture_prior import ANKLES, Ground, Point, Velocity
from retarget.schema import strict_yaml
from retarget.schema.priorities import HeadingSettings

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
        """Weight at a distance on the ground and a height, as shares of the head's height."""
        i, s = _between(self._distances, distance)
        j, t = _between(self._heights, height)
        near, far = self._weights[i], self._weights[i + 1]
        return (1.0 - s) * ((1.0 - t) * near[j] + t * near[j + 1]) + s * ((1.0 - t) * far[j] + t * far[j + 1])


def _between(nodes: list[float], value: float) -> tuple[int, float]:
    value = min(max(value, nodes[0]), nodes[-1])
    before = min(bisect_right(nodes, value), len(nodes) - 1) - 1
    return before, (value - nodes[before]) / (nodes[before + 1] - nodes[before])


# Turn and weight of a hint by the place of the left hand. The right hand's are the conjugate.
_HAND = _Table(
    _LEARNED["reach"],
    _LEARNED["height"],
    (np.array(_LEARNED["hand"]["forward"]) - 1j * np.array(_LEARNED["hand"]["side"])).tolist(),
)
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
        """Go on by `dt` s. positions: x, y (and z) m of valid sensors. facing: forward axes (x, y) of oriented
        sensors."""
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
        """Sum of the hints that turn with the body."""
        total = _lines(positions, self._trunk_pairs)
        for name, axis in facing.items():
            total += self._settings.facing.get(name, 0.0) * complex(*axis)
        return total

    def _seen(self, positions: Mapping[str, Point]) -> complex:
        head = positions.get("head")
        if head is None:
            return 0j
        feet = [positions[name] for name in ANKLES if name in positions]
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
    """a b, written out, as compilers may fuse a product of complex numbers with its sum."""
    return complex(a.real * b.real - a.imag * b.imag, a.real * b.imag + a.imag * b.real)


def _lines(positions: Mapping[str, Point], pairs: Sequence[tuple[str, str, float]]) -> complex:
    """Weighted sum, m, of the lines from right to left of known pairs, turned forward."""
    total = 0j
    for left, right, weight in pairs:
        if left in positions and right in positions:
            to, of = positions[left], positions[right]
            total += weight * complex(to[1] - of[1], of[0] - to[0])
    return total


_BETWEEN_FEET = ((*ANKLES, 1.0),)  # a pair of sensors and its weight


def _hands_ahead(positions: Mapping[str, Point]) -> complex:
    try:
        hands = positions["l_wrist"], positions["r_wrist"]
        feet = positions["l_ankle"], positions["r_ankle"]
    except KeyError:
        return 0j
    x, y = (0.5 * (hands[0][k] + hands[1][k] - feet[0][k] - feet[1][k]) for k in (0, 1))
    return complex(x, y)


class _Stance:
    """The mean of the hints since both feet were planted, as such feet do not turn. Shuffling feet turn it along."""

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
        for foot, name in zip(self._feet, ANKLES, strict=True):
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
