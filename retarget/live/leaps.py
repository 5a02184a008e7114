"""Which positions no human can have reached: jumps, and left and right changing places."""

from math import dist, inf, isinf

import numpy as np

from retarget._solver import WatchedSensors
from retarget.body import IntArray
from retarget.frames import BoolArray, mirrored_name
from retarget.live.exchange import exchanged, taken_over
from retarget.live.trust_limits import TrustLimits
from retarget.live.trust_state import StateArray, TrustState
from retarget.rotations import FloatArray

__all__ = ["Leaps"]

CALM = 0.06
"""m; a step shorter than this needs no second look: it is neither a jump nor an exchange."""
TOGETHER_S = 0.1
"""Jumps of both sides within this time may be an exchange told in two datagrams."""

_Point = list[float] | tuple[float, float, float]


class _Elsewhere:
    """One sensor that is not where it could be: where it went first, where it is now, and since when. home: where it
    would be otherwise: at its last place, or where its other side is told with which it has changed places. settles:
    time alone makes it believed again, also when it has changed places. alone: of the two that have changed places only
    one has been told since."""

    __slots__ = ("alone", "count", "first", "home", "kind", "last", "place", "settles", "since")

    def __init__(self, kind: TrustState, place: _Point, time: float, *, home: _Point) -> None:
        self.kind, self.home, self.settles, self.alone = kind, home, False, False
        self.first = self.place = place
        self.since = self.last = time
        self.count = 1


class Leaps:
    """Judges positions of k sensors against where each was last accepted, by capture time.

    A sensor that leapt is refused until it leaps back, or has gone on from its new place for `settled_after`. Sides
    that have changed places are, once `keep_sides` was called, until they change back.
    `state` (k,): FRESH, JUMPED (from the second pose on: one outlier is dropped and no more), or SWAPPED.
    `doubted_at` (k,): s, of the last refused pose. `resettled` (k,): whether it was believed again at a new place.
    """

    def __init__(self, names: tuple[str, ...], last: WatchedSensors, limits: TrustLimits) -> None:
        count = len(names)
        self._last = last
        self._limits = limits
        self._elsewhere: dict[int, _Elsewhere] = {}
        self._keeps_sides = False
        self.state: StateArray = np.zeros(count, dtype=np.uint8)
        self.doubted_at = np.full(count, -np.inf)
        self.resettled: BoolArray = np.zeros(count, dtype=bool)
        self._other: dict[int, int] = {
            row: names.index(mirrored_name(name))
            for row, name in enumerate(names)
            if name != mirrored_name(name) and mirrored_name(name) in names
        }

    def keep_sides(self) -> None:
        """From now on which side is which is known, and no time makes another of it."""
        self._keeps_sides = True
        for leap in self._elsewhere.values():
            leap.settles = True

    @property
    def any_doubted(self) -> bool:
        """Whether a sensor is refused for where it is."""
        return bool(self._elsewhere)

    def take(self, rows: IntArray, time: float, position: FloatArray) -> tuple[BoolArray, BoolArray]:
        """Which of the positions (m, 3) m of one capture may be used, and which are the place to go on from; (m,)
        each."""
        calm = np.linalg.norm(position - self._last.pose[rows, :3], axis=1) <= CALM
        elapsed = (time - self._last.at[rows]).tolist()
        places, order = position.tolist(), rows.tolist()
        swapped = self._exchanges(order, places, elapsed, calm)
        took_over = self._take_overs(order, places, time, calm)
        usable, stored = np.ones(len(rows), dtype=bool), np.ones(len(rows), dtype=bool)
        for row in self._changed_back(dict(zip(order, places, strict=True)), time):
            self._believe(row, resettled=False)
        for i, row in enumerate(order):
            if row in swapped:
                self._doubt(row, TrustState.SWAPPED, places[i], time)
                usable[i] = stored[i] = False
            elif row in took_over:
                self._doubt_alone(row, places[i], time)
                usable[i] = stored[i] = False
            elif row in self._elsewhere:
                usable[i] = stored[i] = self._go_on(row, places[i], time)
            elif -self._limits.settled_after <= elapsed[i] <= 0.0:
                # Late or told twice: good enough to use, but not the place to go on from.
                usable[i] = dist(places[i], self._last.pose[row, :3]) <= self._within(0.0)
                stored[i] = False
            elif elapsed[i] > 0.0 and dist(places[i], self._last.pose[row, :3]) > self._within(elapsed[i]):
                self._doubt(row, TrustState.JUMPED, places[i], time)
                usable[i] = stored[i] = False
        self._exchanges_in_two()
        self._note_homes(order, places)
        return usable, stored

    def _changed_back(self, at: dict[int, _Point], time: float) -> list[int]:
        """Rows, of those told at these places, that are where their other sides were told while they were exchanged."""
        if not self._elsewhere:
            return []
        back = {row for row, place in at.items() if self._is_back(row, place, time)}
        both = [
            row
            for row in back
            if (other := self._other[row]) not in at
            or other in back
            or not self._swapped(other)
            or self._elsewhere[row].alone
        ]
        return sorted(both)

    def _is_back(self, row: int, place: _Point, time: float) -> bool:
        leap = self._elsewhere.get(row)
        if leap is None or not self._swapped(row) or time <= leap.last:
            return False
        on, back = dist(place, leap.place), dist(place, leap.home)
        apart = dist(leap.place, leap.home) > self._limits.exchange
        return apart and on > CALM and back < 0.5 * on and back <= self._within(time - leap.last)

    def _swapped(self, row: int) -> bool:
        """For good, until it changes back."""
        leap = self._elsewhere.get(row)
        return self._keeps_sides and leap is not None and leap.kind is TrustState.SWAPPED and not leap.settles

    def _note_homes(self, order: list[int], places: list[_Point]) -> None:
        for row, place in zip(order, places, strict=True):
            if self._swapped(row) and self._swapped(self._other[row]):
                self._elsewhere[self._other[row]].home = place

    def _exchanges(self, order: list[int], places: list[_Point], elapsed: list[float], calm: BoolArray) -> set[int]:
        """Rows of pairs that changed places from their last capture to this one."""
        found: set[int] = set()
        if calm.all():
            return found
        at = {row: i for i, row in enumerate(order) if not calm[i] and row not in self._elsewhere}
        for row, i in at.items():
            other = self._other.get(row, -1)
            if other <= row or other not in at:
                continue
            since = min(elapsed[i], elapsed[at[other]])
            if not 0.0 < since <= 1.0 or isinf(max(elapsed[i], elapsed[at[other]])):
                continue
            was = (_point(self._last.pose[row, :3]), _point(self._last.pose[other, :3]))
            due = (self._due(row, elapsed[i]), self._due(other, elapsed[at[other]]))
            if exchanged(was, due, (places[i], places[at[other]]), since, self._limits.exchange):
                found |= {row, other}
        return found

    def _take_overs(self, order: list[int], places: list[_Point], time: float, calm: BoolArray) -> set[int]:
        """Rows that go on from the place of their other side, which is not told in this capture."""
        found: set[int] = set()
        if calm.all():
            return found
        told = set(order)
        for i, row in enumerate(order):
            other = self._other.get(row, -1)
            if calm[i] or other < 0 or other in told or not self._elsewhere.keys().isdisjoint((row, other)):
                continue
            elapsed = (time - float(self._last.at[row]), time - float(self._last.at[other]))
            if 0.0 < elapsed[0] < inf and 0.0 < elapsed[1] <= TOGETHER_S:
                due = (self._due(row, elapsed[0]), self._due(other, elapsed[1]))
                if taken_over(due, places[i], elapsed, least=self._limits.exchange, calm=CALM):
                    found.add(row)
        return found

    def _due(self, row: int, elapsed: float) -> _Point:
        """Where a sensor would be now if it went on as it went."""
        span = max(self._last.at[row] - self._last.before[row], self._limits.shortest_step)
        if max(span, elapsed) > TOGETHER_S:
            return _point(self._last.pose[row, :3])
        share = max(elapsed, self._limits.shortest_step) / span
        return _point(self._last.pose[row, :3] + share * self._last.step[row, :3])

    def _exchanges_in_two(self) -> None:
        """Jumps of both sides that were told one after the other, and lead to each other's place."""
        for row, here in self._elsewhere.items():
            there = self._elsewhere.get(self._other.get(row, -1))
            if there is None or here.kind is TrustState.SWAPPED or abs(here.since - there.since) > TOGETHER_S:
                continue
            was = (_point(self._last.pose[row, :3]), _point(self._last.pose[self._other[row], :3]))
            if exchanged(was, was, (here.first, there.first), TOGETHER_S, self._limits.exchange):
                for one, leap in ((row, here), (self._other[row], there)):
                    leap.kind = TrustState.SWAPPED
                    self.state[one] = TrustState.SWAPPED

    def _within(self, elapsed: float) -> float:
        """How far, m, a human gets in `elapsed` s."""
        return self._limits.fastest * max(elapsed, self._limits.shortest_step)

    def _doubt(self, row: int, kind: TrustState, place: _Point, time: float) -> None:
        self._elsewhere[row] = _Elsewhere(kind, place, time, home=_point(self._last.pose[row, :3]))
        self.doubted_at[row] = time
        self.state[row] = kind if kind is TrustState.SWAPPED else TrustState.FRESH

    def _doubt_alone(self, row: int, place: _Point, time: float) -> None:
        """A sensor is where its other side was, which may be told yet: it is said from its second pose there on."""
        other = self._other[row]
        home = _point(self._last.pose[row, :3])
        self._doubt(other, TrustState.SWAPPED, home, float(self._last.at[other]))
        self._doubt(row, TrustState.SWAPPED, place, time)
        for one in (row, other):
            self._elsewhere[one].alone, self.state[one] = True, TrustState.FRESH
        self._elsewhere[other].count = 0

    def _tell_alone(self, row: int, place: _Point, time: float) -> None:
        """Of two that have changed places, of which only one was told, one is told again: now it is said of both."""
        leap, there = self._elsewhere[row], self._elsewhere.get(self._other[row])
        if there is None or not (
            leap.count == 1 or (leap.count == 0 and dist(place, leap.place) < dist(place, leap.home))
        ):
            return
        if leap.count == 0:  # the one that was not told
            leap.alone = there.alone = False
        self.doubted_at[self._other[row]], self.state[self._other[row]] = time, TrustState.SWAPPED

    def _stay_swapped(self, row: int, place: _Point, time: float) -> bool:
        """One more pose of one of two that have changed places; whether it is believed again."""
        leap = self._elsewhere[row]
        if leap.alone and self._other[row] not in self._elsewhere:  # it was told at its own place: each is itself
            if dist(place, self._last.pose[row, :3]) <= self._within(time - float(self._last.at[row])):
                return self._believe(row, resettled=False)
            self._doubt(row, TrustState.JUMPED, place, time)
            self.state[row] = TrustState.JUMPED
            return False
        leap.place, leap.last = place, time
        leap.count += 1
        self.doubted_at[row], self.state[row] = time, leap.kind
        return False

    def _go_on(self, row: int, place: _Point, time: float) -> bool:
        """One more pose of a doubted sensor; whether it is believed again."""
        leap = self._elsewhere[row]
        gap = time - leap.last
        if -self._limits.settled_after <= gap <= 0.0:
            return False
        if leap.alone:
            self._tell_alone(row, place, time)
        if self._swapped(row):
            return self._stay_swapped(row, place, time)
        on, back = dist(place, leap.place), dist(place, self._last.pose[row, :3])
        if gap > 0.0 and on > CALM and back < 0.5 * on and back <= self._within(min(time - leap.since, TOGETHER_S)):
            return self._believe(row, resettled=False)
        if not 0.0 < gap <= self._limits.stale_after or on > self._within(gap):
            self._doubt(row, TrustState.JUMPED, place, time)
            self.state[row] = TrustState.JUMPED  # not the first one
            return False
        leap.place, leap.last = place, time
        leap.count += 1
        self.doubted_at[row] = time
        self.state[row] = leap.kind
        if time - leap.since >= self._limits.settled_after:
            return self._believe(row, resettled=True)
        return False

    def _believe(self, row: int, *, resettled: bool) -> bool:
        del self._elsewhere[row]
        self.state[row] = TrustState.FRESH
        self.resettled[row] = resettled
        return True


def _point(array: FloatArray) -> list[float]:
    return [float(number) for number in array]
