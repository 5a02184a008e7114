"""Motion strategies: how a robot on its soles gets its hands to places that its arms alone do not reach.

In the order of their cost: the arm, with the trunk where the performer has it; the trunk, which leans and twists as
far as the hand needs it; a crouch, with the pelvis at the nearest height from which the hand gets there; a step. The
cheapest one that the reachability map allows is taken (R. Boulic et al., "Virtual worker reachable space evaluation
with prioritized inverse kinematics", Int. Symp. Robotics 2004). A step is only named: the hands then go to the edge of
what the robot reaches from where it stands.

A strategy is left for a cheaper one only well inside the reach of that, and one goes over into another by weights and
heights that change smoothly.
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
"""Time constant (s) with which the trunk becomes free, or stiff, and the pelvis goes to another height."""
EDGE = 0.17
"""Distance beyond the edge, in spacings of the map's grid, up to which a strategy is taken: between nodes the map shows
the edge of what is round nearer than it is."""
INSIDE, CROUCHED = 0.15, 0.5
"""Distances inside of the edge in spacings of the map's grid: where a cheaper strategy is taken again; and to which the
pelvis goes where it can, as the edge is not straight between the heights of the map."""
LEAST, LEAST_M = 1e-3, 1e-5
"""A share, or a height, that is off its end by less is there."""
OFF_S = 1.0
"""Time constant (s) with which the arms make up for a trunk that is not where it is asked: longer than it lags."""
LOOK_S = 0.04
"""Least time (s) between two looks at the map."""


class Strategy(Enum):
    """How hands get to their places. The value is its name in files and reports."""

    ARM = "arm"
    TRUNK = "trunk"
    CROUCH = "crouch"
    STEP = "step"

    @property
    def words(self) -> str:
        """It in words, on pages."""
        return "needs a step" if self is Strategy.STEP else f"hands by {self.value}"

    def costs_no_less(self, other: "Strategy") -> bool:
        """Return whether it is the other one, or comes after it."""
        return ORDER.index(self) >= ORDER.index(other)


ORDER = tuple(Strategy)
"""From the cheapest to the dearest."""


def arms_alone(priorities: Priorities) -> Priorities:
    """The same without tasks on the places of hands: those that a robot has that chooses no strategies."""
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
    """A hand. row: of the landmarks; line: of the limbs; shoulder: from the pelvis of an upright trunk, m."""

    row: int
    line: int
    shoulder: Vector
    reach: HandReach


@dataclass(frozen=True, eq=False)
class _Look:
    """What the map said. lower: of the pelvis, from where it was asked; shifts: of the hands, into reach; carried:
    where the hands were, as the stance's trunk carries them; room: that they have until the arms no longer reach; off:
    of the robot's shoulders from where they are asked, for long; m."""

    strategy: Strategy = Strategy.ARM
    lower: float = 0.0
    shifts: Sequence[Vector] = ((0.0, 0.0, 0.0),) * len(HANDS)
    carried: Sequence[Vector] = ((0.0, 0.0, 0.0),) * len(HANDS)
    room: float = -np.inf
    off: Sequence[Vector] = ((0.0, 0.0, 0.0),) * len(HANDS)


class Strategies:
    """The strategy of one robot: `places`, then `choose` in each tick, and `weigh` once its targets are set."""

    def __init__(
        self, robot: RobotBody, stance: Stance, reach: ReachMap, free: FreeTrunk, *, allowed: Sequence[str]
    ) -> None:
        """free: of the robot's hierarchy. allowed: values of strategies besides the arm and the step."""
        marks, names = robot.profile.landmarks, limb_names(robot.profile)
        self.reach = reach
        """What it chooses by."""
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
        """Taken whatever the map says, with the pelvis at a height, m, for comparisons; None: chosen, or by the map."""
        self.restart()

    def restart(self) -> None:
        """Begin with the arm."""
        self.seconds = dict.fromkeys(ORDER, 0.0)
        """For how long each was taken, s."""
        self._share, self._lower, self._passed = 0.0, 0.0, LOOK_S
        self._seen = _Look()

    @property
    def strategy(self) -> Strategy:
        """The one that was chosen last."""
        return self._seen.strategy

    @property
    def is_arm_alone(self) -> bool:
        """True if the trunk is not free at all."""
        return self._share == 0.0

    def places(self, asked: DesiredLandmarks) -> DesiredLandmarks:
        """The same, with the hands where they are with the performer's own pelvis and trunk, also where those of the
        robot cannot follow."""
        pelvis, trunk = asked.whole
        landmarks, limbs = list(asked.landmarks), list(asked.limbs)
        for hand in self._hands:
            place = plus(plus(pelvis, rotated(trunk, hand.shoulder)), limbs[hand.line])
            limbs[hand.line] = plus(limbs[hand.line], minus(place, landmarks[hand.row]))
            landmarks[hand.row] = place
        return replace(asked, landmarks=landmarks, limbs=limbs)

    def choose(self, asked: DesiredLandmarks, reached: Reached, dt: float) -> DesiredLandmarks:
        """Choose for the next `dt` s. Returns what is to be asked: hands within reach, and the pelvis low enough."""
        self._passed += dt
        if self._passed >= LOOK_S:
            self._look_again(asked, reached)
        seen = self._seen
        self.seconds[seen.strategy] += dt
        free = float(seen.strategy is not Strategy.ARM)
        if self._share != free:
            self._share = low_pass(self._share, free, dt / SETTLE_S)
            self._share = free if abs(self._share - free) < LEAST else self._share
        if self._lower != seen.lower:
            self._lower = low_pass(self._lower, seen.lower, dt / SETTLE_S)
            self._lower = seen.lower if abs(self._lower - seen.lower) < LEAST_M else self._lower
        landmarks, limbs = list(asked.landmarks), list(asked.limbs)
        x, y, z = landmarks[self._pelvis]
        landmarks[self._pelvis] = (x, y, z + self._lower)
        for hand, shift, off in zip(self._hands, seen.shifts, seen.off, strict=True):
            landmarks[hand.row] = plus(landmarks[hand.row], shift)
            limbs[hand.line] = plus(limbs[hand.line], minus(shift, off))
        return replace(asked, landmarks=landmarks, limbs=limbs)

    def _look_again(self, asked: DesiredLandmarks, reached: Reached) -> None:
        """Look at the map where it may say something else than at the last look. Within the arms' reach it says the
        same as long as no hand has moved as far as it was from the edge."""
        seen, pelvis, there = self._seen, asked.landmarks[self._pelvis], reached.landmarks[self._pelvis]
        back, share, off, carried = inverse(asked.trunk), self._passed / OFF_S, list[Vector](), list[Vector]()
        for hand, before in zip(self._hands, seen.off, strict=True):
            wrong = minus(rotated(reached.trunk, hand.shoulder), rotated(asked.trunk, hand.shoulder))
            x, y, z = plus(wrong, minus(there, pelvis))
            a, b, c = before
            off.append((low_pass(a, x, share), low_pass(b, y, share), low_pass(c, z, share)))
            # Where the hand would be in the stance, carried by a trunk that is upright there.
            place = minus(minus(asked.landmarks[hand.row], off[-1]), pelvis)
            carried.append(plus(self._stands, rotated(back, place)))
        moved = max(fsum(map(abs, minus(*pair))) for pair in zip(carried, seen.carried, strict=True))
        if seen.strategy is Strategy.ARM and moved < seen.room:
            self._seen = replace(seen, off=off)
        else:
            places = [asked.landmarks[hand.row] for hand in self._hands]
            self._seen = replace(self._look(carried, places, pelvis[2]), off=off)
        self._passed = 0.0

    def _look(self, carried: Sequence[Vector], places: Sequence[Vector], height: float) -> _Look:
        """Look at the map. carried: as of `_Look`; places: of the hands in the world; height: of the pelvis that is
        asked; all m."""
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
        """Let the trunk go, as far as the strategy does, in a target vector in which all else is set."""
        self._free.weigh(targets, self._share)

    def _cheapest(self, by_arm: float, fields: Sequence[Sequence[float]], height: float) -> tuple[Strategy, float]:
        """The cheapest strategy, and the height (m) of the pelvis in it. by_arm: distance, m, from the edge of what the
        arms reach; height: that is asked."""
        heights, edges = self.reach.heights, farthest(fields)
        leans_at = min(height, heights[-1])  # straight legs do not lean
        if self.forced is not None:
            one, forced = self.forced
            crouch = nearest_height(heights, edges, leans_at, -self._crouched) if forced is None else forced
            return one, {Strategy.ARM: height, Strategy.TRUNK: leans_at}.get(one, crouch)
        limits = [self._edge if one.costs_no_less(self.strategy) else -self._inside for one in ORDER]
        if by_arm <= limits[0]:
            return Strategy.ARM, height
        if Strategy.TRUNK in self._allowed and at_height(heights, edges, leans_at) <= limits[1]:
            return Strategy.TRUNK, leans_at
        crouch = nearest_height(heights, edges, leans_at, -self._crouched)
        reached = Strategy.CROUCH in self._allowed and min(edges) <= limits[2]
        return Strategy.CROUCH if reached else Strategy.STEP, crouch

    def cheapest_standing(self, hand: int, place: Vector) -> Strategy:
        """The cheapest strategy for a place, m, of one hand, 0 or 1, of a robot that is asked to stand as in its
        stance."""
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

    def standing_place(self, places: Sequence[Vector]) -> tuple[float, float] | None:
        """How far (x, y) m the robot has to go on the ground, without turning, so that it reaches both places, m, from
        where it stands then; the shortest way, None where there is none."""
        first, second = self.reach.hands
        level = round((first.inside(places[0])[2] - float(first.low[2])) / first.spacing)
        reached = first.field[:, :, level, 1:-3].min(axis=2) <= -self._inside
        ways = np.array(places[0][:2]) - first.nodes[:, :, level, :2][reached]
        for x, y in sorted(ways.tolist(), key=lambda way: norm(np.array(way))):
            moved = minus(places[1], (x, y, 0.0))
            place = second.inside(moved)
            if place == moved and min(second.at(place)[1:-3]) <= 0.0:
                return x, y
        return None


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
    """The strategies of priorities that have some; None of a robot without two hands and a pelvis that its legs move.
    hierarchy: of following. build: one as REACH has it, without rates. standing: the landmarks of the stance."""
    marks = robot.profile.landmarks
    if not {*HANDS, PELVIS} <= marks.keys():
        return None

    def probe() -> ReachProbe:
        unhurried = build(priorities, np.zeros(robot.body.nv, dtype=np.bool_))
        return ReachProbe(robot, priorities, stance, unhurried, standing, balance, strength, envelope)

    found, free = reach_map(robot, priorities, probe), FreeTrunk(priorities, hierarchy)
    return Strategies(robot, stance, found, free, allowed=priorities.strategies)


def _on_edge(place: Vector, field: Sequence[float]) -> Vector:
    """The place, or the one on the edge of the map that is nearest to it. field: there."""
    beyond, (x, y, z) = min(field[1:-3]), field[-3:]
    length = norm(np.array([x, y, z]))
    if beyond <= 0.0 or length == 0.0:
        return place
    share = beyond / length
    return plus(place, (share * x, share * y, share * z))


def farthest(fields: Sequence[Sequence[float]]) -> list[float]:
    """Distances, m, of that hand at each height that is farther from the edge."""
    return [max(pair) for pair in zip(*(field[1:-3] for field in fields), strict=True)]


def at_height(heights: Sequence[float], edges: Sequence[float], height: float) -> float:
    """The distance at a height, m, between those of the map."""
    last = len(heights) - 1
    along = min(max((height - heights[0]) / (heights[last] - heights[0]), 0.0), 1.0) * last
    node = min(int(along), last - 1)
    return edges[node] + (along - node) * (edges[node + 1] - edges[node])


def nearest_height(heights: Sequence[float], edges: Sequence[float], height: float, limit: float) -> float:
    """The height, m, nearest to another one at which the distance is within a limit; else that of the least."""
    if at_height(heights, edges, height) <= limit:
        return height
    crossings = [height for height, edge in zip(heights, edges, strict=True) if edge <= limit]
    for (low, a), (high, b) in zip(zip(heights, edges), zip(heights[1:], edges[1:])):  # noqa: B905 - of one length
        if min(a, b) <= limit < max(a, b):
            crossings.append(low + (limit - a) / (b - a) * (high - low))
    if not crossings:
        return heights[min(range(len(edges)), key=lambda node: edges[node])]
    return min(crossings, key=lambda one: abs(one - height))
