"""Motion strategies: means by which a robot on its soles gets its hands to places beyond its arms' reach.

The cheapest one that the reachability map allows is chosen (R. Boulic et al., "Virtual worker reachable space
evaluation with prioritized inverse kinematics", Int. Symp. Robotics 2004): arm, trunk, crouch, or step. A step is only
named, and the hands go to the edge of the reach.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from enum import Enum
from math import fsum

import numpy as np

from retarget.arithmetic import low_pass, norm
from retarget.ik.hierarchy import Build, Hierarchy
from retarget.ik.support_polygon import Stance
from retarget.model.robot import RobotBody
from retarget.robot.balance import StandingBalance, StandingStrength
from retarget.robot.crouch_envelope import Envelope
from retarget.robot.landmarks import PELVIS, DesiredLandmarks, Reached, limb_names
from retarget.robot.reach_map import HANDS, REACH, FreeTrunk, HandReach, ReachMap, ReachProbe, is_height, reach_map
from retarget.rotations import Vector, as_vector, inverse, minus, plus, rotated
from retarget.schema.priorities import PositionTask, Priorities
from retarget.types import FloatArray

__all__ = ["REACH", "Strategies", "Strategy", "arms_alone", "strategies_of"]

SETTLE_S = 0.15
"""Time constant of changes, s."""
EDGE = 0.17
"""Distance outside the map's edge up to which a strategy is chosen, in spacings."""
INSIDE, CROUCHED = 0.15, 0.5
"""Distances inside the edge, in spacings, of a return to a cheaper strategy, and of the lowered pelvis."""
LEAST, LEAST_M = 1e-3, 1e-5
"""Distances at which a share, and a height, m, have arrived."""
OFF_S = 1.0
"""Time constant with which arms compensate a displaced trunk, s."""
LOOK_S = 0.04
"""Least time between look-ups in the map, s."""


class Strategy(Enum):
    """Means by which hands get to their places, as in files and reports."""

    ARM = "arm"
    TRUNK = "trunk"
    CROUCH = "crouch"
    STEP = "step"

    @property
    def words(self) -> str:
        """Text for pages."""
        return "needs a step" if self is Strategy.STEP else f"hands by {self.value}"


ORDER = tuple(Strategy)
"""Strategies by rising cost."""


def arms_alone(priorities: Priorities) -> Priorities:
    """Priorities without tasks on the places of hands."""
    if not priorities.strategies:
        return priorities
    levels = []
    for level in priorities.levels:
        kept = (
            task
            for task in level.tasks
            if not (isinstance(task, PositionTask) and (set(task.of) <= set(HANDS) or is_height(task)))
        )
        levels.append(level.model_copy(update={"tasks": tuple(kept)}))
    return priorities.model_copy(update={"levels": tuple(levels), "strategies": ()})


@dataclass(frozen=True, eq=False)
class _Hand:
    """A hand: row of the landmarks, line of the limbs, and shoulder from the pelvis of an upright trunk, m."""

    row: int
    line: int
    shoulder: Vector
    reach: HandReach


@dataclass(frozen=True, eq=False)
class _Look:
    """A look-up in the map, m. lower: of the pelvis; shifts: of hands, into reach; carried: hands in the stance's trunk
    frame; room: movement within the arms' reach; off: of the shoulders."""

    strategy: Strategy = Strategy.ARM
    lower: float = 0.0
    shifts: Sequence[Vector] = ((0.0, 0.0, 0.0),) * len(HANDS)
    carried: Sequence[Vector] = ((0.0, 0.0, 0.0),) * len(HANDS)
    room: float = -np.inf
    off: Sequence[Vector] = ((0.0, 0.0, 0.0),) * len(HANDS)


class Strategies:
    """Chooses the strategy of one robot: `places`, then `choose` in each tick, and `weigh` at last."""

    def __init__(
        self, robot: RobotBody, stance: Stance, reach: ReachMap, free: FreeTrunk, *, allowed: Sequence[str]
    ) -> None:
        """allowed: values of strategies besides arm and step."""
        marks, names = robot.profile.landmarks, limb_names(robot.profile)
        self.reach = reach
        self._free = free
        self._allowed = [one for one in ORDER if one.value in allowed]
        place = stance.points[marks[PELVIS].frame]
        self._pelvis, self._stands = list(marks).index(PELVIS), as_vector(place)
        self._hands = [
            _Hand(
                list(marks).index(name),
                names.index(name),
                as_vector(stance.points[marks[name].anchor[0]] - place),
                reach.hands[number],
            )
            for number, name in enumerate(HANDS)
        ]
        spacing = reach.hands[0].spacing
        self._edge, self._inside, self._crouched = EDGE * spacing, INSIDE * spacing, CROUCHED * spacing
        self.forced: tuple[Strategy, float | None] | None = None
        """A strategy, and a height of the pelvis, m, to use regardless of the map."""
        self.restart()

    def restart(self) -> None:
        """Start with the arm."""
        self.seconds = dict.fromkeys(ORDER, 0.0)
        """Duration of each strategy, s."""
        self._share, self._lower, self._passed = 0.0, 0.0, LOOK_S
        self._seen = _Look()

    @property
    def strategy(self) -> Strategy:
        """The last choice."""
        return self._seen.strategy

    @property
    def is_arm_alone(self) -> bool:
        """True if the trunk is not free."""
        return self._share == 0.0

    def places(self, desired: DesiredLandmarks) -> DesiredLandmarks:
        """Desired landmarks with the hands of the performer's pelvis and trunk, beyond the robot's envelope."""
        pelvis, trunk = desired.whole
        landmarks, limbs = list(desired.landmarks), list(desired.limbs)
        for hand in self._hands:
            place = plus(plus(pelvis, rotated(trunk, hand.shoulder)), limbs[hand.line])
            limbs[hand.line] = plus(limbs[hand.line], minus(place, landmarks[hand.row]))
            landmarks[hand.row] = place
        return replace(desired, landmarks=landmarks, limbs=limbs)

    def choose(self, desired: DesiredLandmarks, reached: Reached, dt: float) -> DesiredLandmarks:
        """Choose for the next `dt` s. Returns landmarks with hands in reach and the pelvis low enough."""
        self._passed += dt
        if self._passed >= LOOK_S:
            self._look_again(desired, reached)
        seen = self._seen
        self.seconds[seen.strategy] += dt
        free = float(seen.strategy is not Strategy.ARM)
        if self._share != free:
            self._share = low_pass(self._share, free, dt / SETTLE_S)
            self._share = free if abs(self._share - free) < LEAST else self._share
        if self._lower != seen.lower:
            self._lower = low_pass(self._lower, seen.lower, dt / SETTLE_S)
            self._lower = seen.lower if abs(self._lower - seen.lower) < LEAST_M else self._lower
        landmarks, limbs = list(desired.landmarks), list(desired.limbs)
        x, y, z = landmarks[self._pelvis]
        landmarks[self._pelvis] = (x, y, z + self._lower)
        for hand, shift, off in zip(self._hands, seen.shifts, seen.off, strict=True):
            landmarks[hand.row] = plus(landmarks[hand.row], shift)
            limbs[hand.line] = plus(limbs[hand.line], minus(shift, off))
        return replace(desired, landmarks=landmarks, limbs=limbs)

    def _look_again(self, desired: DesiredLandmarks, reached: Reached) -> None:
        seen, pelvis, there = self._seen, desired.landmarks[self._pelvis], reached.landmarks[self._pelvis]
        back, share, off, carried = inverse(desired.trunk), self._passed / OFF_S, list[Vector](), list[Vector]()
        for hand, before in zip(self._hands, seen.off, strict=True):
            wrong = minus(rotated(reached.trunk, hand.shoulder), rotated(desired.trunk, hand.shoulder))
            x, y, z = plus(wrong, minus(there, pelvis))
            a, b, c = before
            off.append((low_pass(a, x, share), low_pass(b, y, share), low_pass(c, z, share)))
            place = minus(minus(desired.landmarks[hand.row], off[-1]), pelvis)
            carried.append(plus(self._stands, rotated(back, place)))
        moved = max(fsum(map(abs, minus(*pair))) for pair in zip(carried, seen.carried, strict=True))
        if seen.strategy is Strategy.ARM and moved < seen.room:
            self._seen = replace(seen, off=off)
        else:
            places = [desired.landmarks[hand.row] for hand in self._hands]
            self._seen = replace(self._look(carried, places, pelvis[2]), off=off)
        self._passed = 0.0

    def _look(self, carried: Sequence[Vector], places: Sequence[Vector], height: float) -> _Look:
        """Look up the map. places: of the hands, height: of the desired pelvis, m."""
        maps, low = [hand.reach for hand in self._hands], min(height, self.reach.heights[-1])
        by_arm = max(reach.at(reach.inside(place))[0] for reach, place in zip(maps, carried, strict=True))
        within = [reach.inside(place) for reach, place in zip(maps, places, strict=True)]
        fields = [reach.at(place) for reach, place in zip(maps, within, strict=True)]
        strategy, goes_to = self._cheapest(by_arm, fields, height)
        if strategy is Strategy.STEP:
            within = [_on_edge(place, field) for place, field in zip(within, fields, strict=True)]
            fields = [reach.at(reach.inside(place)) for reach, place in zip(maps, within, strict=True)]
            goes_to = nearest_height(self.reach.heights, farthest(fields), low, -self._crouched)
        shifts = [minus(there, place) for there, place in zip(within, places, strict=True)]
        return _Look(strategy, goes_to - height, shifts, carried, self._edge - by_arm)

    def weigh(self, targets: FloatArray) -> None:
        """Free the trunk in a target vector that is otherwise complete."""
        self._free.weigh(targets, self._share)

    def _cheapest(self, by_arm: float, fields: Sequence[Sequence[float]], height: float) -> tuple[Strategy, float]:
        """Cheapest strategy, and its height of the pelvis, m. by_arm: distance from the arms' edge, m."""
        heights, edges = self.reach.heights, farthest(fields)
        leans_at = min(height, heights[-1])  # straight legs do not lean
        if self.forced is not None:
            one, forced = self.forced
            crouch = nearest_height(heights, edges, leans_at, -self._crouched) if forced is None else forced
            return one, {Strategy.ARM: height, Strategy.TRUNK: leans_at}.get(one, crouch)
        now = ORDER.index(self.strategy)
        limits = [self._edge if place >= now else -self._inside for place in range(len(ORDER))]
        if by_arm <= limits[0]:
            return Strategy.ARM, height
        if Strategy.TRUNK in self._allowed and at_height(heights, edges, leans_at) <= limits[1]:
            return Strategy.TRUNK, leans_at
        crouch = nearest_height(heights, edges, leans_at, -self._crouched)
        reached = Strategy.CROUCH in self._allowed and min(edges) <= limits[2]
        return Strategy.CROUCH if reached else Strategy.STEP, crouch

    def cheapest_standing(self, hand: int, place: Vector) -> Strategy:
        """Cheapest strategy for a place, m, of one hand, 0 or 1, in the stance."""
        reach = self.reach.hands[hand]
        inside = reach.inside(place)
        if inside != place:
            return Strategy.STEP
        by_arm, *edges = reach.at(inside)[:-3]
        if by_arm <= self._edge:
            return Strategy.ARM
        if Strategy.TRUNK in self._allowed and edges[-1] <= self._edge:
            return Strategy.TRUNK
        return Strategy.CROUCH if Strategy.CROUCH in self._allowed and min(edges) <= self._edge else Strategy.STEP


def strategies_of(
    robot: RobotBody,
    priorities: Priorities,
    stance: Stance,
    hierarchy: Hierarchy,
    build: Build,
    standing: DesiredLandmarks,
    balance: StandingBalance,
    strength: StandingStrength | None,
    envelope: Envelope,
) -> Strategies | None:
    """Strategies of a robot; None without two hands and a pelvis. build: of a hierarchy without rates, for REACH."""
    marks = robot.profile.landmarks
    if not {*HANDS, PELVIS} <= marks.keys():
        return None

    def probe() -> ReachProbe:
        unhurried = build(priorities, np.zeros(robot.body.nv, dtype=np.bool_))
        return ReachProbe(robot, priorities, stance, unhurried, standing, balance, strength, envelope)

    found, free = reach_map(robot, priorities, probe), FreeTrunk(priorities, hierarchy)
    return Strategies(robot, stance, found, free, allowed=priorities.strategies)


def _on_edge(place: Vector, field: Sequence[float]) -> Vector:
    beyond, (x, y, z) = min(field[1:-3]), field[-3:]
    length = norm(np.array([x, y, z]))
    if beyond <= 0.0 or length == 0.0:
        return place
    share = beyond / length
    return plus(place, (share * x, share * y, share * z))


def farthest(fields: Sequence[Sequence[float]]) -> list[float]:
    """Greater distance of both hands at each height, m."""
    return [max(pair) for pair in zip(*(field[1:-3] for field in fields), strict=True)]


def at_height(heights: Sequence[float], edges: Sequence[float], height: float) -> float:
    """Distance at a height, m, interpolated."""
    last = len(heights) - 1
    along = min(max((height - heights[0]) / (heights[last] - heights[0]), 0.0), 1.0) * last
    node = min(int(along), last - 1)
    return edges[node] + (along - node) * (edges[node + 1] - edges[node])


def nearest_height(heights: Sequence[float], edges: Sequence[float], height: float, limit: float) -> float:
    """Height, m, nearest to another one with a distance within a limit; else that of the least distance."""
    if at_height(heights, edges, height) <= limit:
        return height
    crossings = [height for height, edge in zip(heights, edges, strict=True) if edge <= limit]
    for (low, a), (high, b) in zip(zip(heights, edges), zip(heights[1:], edges[1:])):  # noqa: B905 - of one length
        if min(a, b) <= limit < max(a, b):
            crossings.append(low + (limit - a) / (b - a) * (high - low))
    if not crossings:
        return heights[min(range(len(edges)), key=lambda node: edges[node])]
    return min(crossings, key=lambda one: abs(one - height))
