"""Sensor validity: which poses may be used, the state of each sensor, jump detection, swaps of left and right."""

from collections import deque
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from enum import IntEnum
from itertools import groupby
from math import dist, inf, isfinite, isinf

import numpy as np
from numpy.typing import NDArray

from retarget._solver import WatchedSensors
from retarget.errors import UsageError
from retarget.frames import mirrored_name
from retarget.sources.stream_frame import NORM_TOLERANCE, Dropped
from retarget.types import BoolArray, FloatArray, IntArray

# Limits of validity.


@dataclass(frozen=True, kw_only=True)
class ValidityLimits:
    """Limits beyond which a pose or sensor is invalid. Lengths in m, times in s of capture unless said otherwise.

    Raises UsageError for limits out of range.

    fastest: m/s; the fist of a boxer reaches about 10. shortest_step: a shorter time between two poses counts as this:
    stamps taken on arrival are off by 15 ms, and a sender of 200 Hz may repeat a tracker of 60 Hz. settled_after: a
    sensor that jumped or changed places is accepted again when it went on from there for this time. swap: a swap of
    sensors nearer than this is not detected. stale_after: time without an accepted pose, on the local clock; a feed of
    20 Hz may lose one pose of three. frozen_after: time of repeating one value; with `leave` of `ReacquisitionTimes` it
    adds up to less than 0.3 s. noticeable: how far another sensor must have moved, in m and in parts of a unit
    quaternion (0.0087: one degree), to show that the performer moves. not_in_use_after: from the first judgement.
    reach: horizontally from the origin, along each axis. low, high: of the height. norm_tolerance: of a quaternion's
    norm.
    """

    fastest: float = 15.0
    shortest_step: float = 1.0 / 60.0
    settled_after: float = 0.5
    swap: float = 0.08
    stale_after: float = 0.142
    frozen_after: float = 0.2
    noticeable: tuple[float, float] = (0.01, 0.0087)
    not_in_use_after: float = 3.0
    reach: float = 10.0
    low: float = -1.0
    high: float = 3.0
    norm_tolerance: float = NORM_TOLERANCE

    def __post_init__(self) -> None:
        positive = (
            *(self.fastest, self.shortest_step, self.settled_after, self.swap, self.stale_after),
            *(self.frozen_after, *self.noticeable, self.not_in_use_after, self.reach, self.norm_tolerance),
        )
        # Comparisons with NaN are False.
        if not (all(value > 0.0 for value in positive) and -np.inf < self.low < self.high < np.inf):
            raise UsageError(
                "validity limits out of range",
                found=repr(self),
                allowed="positive numbers, and low below high",
                next_step="Correct them",
            )


# The state of one sensor at one instant.

StateArray = NDArray[np.uint8]
"""One ValidityState per sensor, (k,)."""


class ValidityState(IntEnum):
    """The validity of a sensor. Only a FRESH sensor is used."""

    FRESH = 0
    """Its last accepted pose is recent, and no other state applies."""
    STALE = 1
    """No pose of it was accepted for too long: it is lost, or was not received yet."""
    FROZEN = 2
    """It repeats one value to the bit while others move: the sender has lost it and does not report that."""
    JUMPED = 3
    """It went farther than a human can, and stays there."""
    SWAPPED = 4
    """It and the sensor of its other side have changed places at once."""
    NOT_IN_USE = 5
    """It was not received since the start."""
    OUT_OF_RANGE = 6
    """Its position is outside the room."""


# Messages about changes of validity.


@dataclass(frozen=True, slots=True)
class ValidityChange:
    """A change of one sensor's state, judged at `now`, s. seconds: how long it has been in the new state, where known.
    resettled: it is valid again at another place than before its jump or swap."""

    now: float
    name: str
    before: ValidityState
    after: ValidityState
    seconds: float = 0.0
    resettled: bool = False


def net_changes(changes: Sequence[ValidityChange]) -> list[ValidityChange]:
    """The changes of sensors whose last state is not their first. What came and went between needs no message."""
    first: dict[str, ValidityChange] = {}
    last: dict[str, ValidityChange] = {}
    for change in changes:
        first.setdefault(change.name, change)
        last[change.name] = change
    same = {name for name in first if first[name].before is last[name].after and not last[name].resettled}
    return [change for change in changes if change.name not in same]


def sentences(changes: Iterable[ValidityChange]) -> list[str]:
    """Messages about changes in order, one for all sensors that changed alike at one time."""
    messages = []
    for _, alike in groupby(changes, key=lambda change: (change.now, change.before, change.after, change.resettled)):
        group = list(alike)
        names = [change.name for change in group]
        if group[0].after is ValidityState.SWAPPED:
            messages += _swaps(names)
        else:
            messages.append(f"{', '.join(names)}: {_text(group[0], max(change.seconds for change in group))}")
    return messages


def _swaps(names: Sequence[str]) -> list[str]:
    pairs = [f"{name} and {mirrored_name(name)}" for name in names if name.startswith("l_")]
    return [f"{pair} have changed places: the robot holds until they change back" for pair in pairs]


def _text(change: ValidityChange, seconds: float) -> str:
    if change.after is ValidityState.FRESH:
        if change.resettled:
            return "accepted again at its new place"
        return "received now" if change.before is ValidityState.NOT_IN_USE else "back"
    return {
        ValidityState.STALE: f"nothing that can be used for {seconds:.1f} s" if seconds else "not received yet",
        ValidityState.FROZEN: f"frozen since {seconds:.1f} s (tracker lost?)",
        ValidityState.JUMPED: "jumped farther than a human can",
        ValidityState.NOT_IN_USE: "not received since the start (not worn?)",
        ValidityState.OUT_OF_RANGE: "position outside the room",
    }[change.after]


# The last accepted pose of each sensor, and the checks of single poses.


def watched_sensors(count: int, limits: ValidityLimits) -> WatchedSensors:
    """The memory of `count` sensors that were never received."""
    return WatchedSensors(
        count,
        reach=limits.reach,
        height=(limits.low, limits.high),
        norm_tolerance=limits.norm_tolerance,
        stale_after=limits.stale_after,
        frozen_after=limits.frozen_after,
        noticeable=limits.noticeable,
        not_in_use_after=limits.not_in_use_after,
    )


# Why a pose is invalid by itself: not finite, not in the room, no rotation, or marked as lost by the sender.

VALID = 0
"""The verdict of `WatchedSensors` on a valid pose."""
UNTRACKED = "pose that the sender marks as lost"
NOT_FINITE = "pose that is not finite"
NOT_A_ROTATION = "orientation that is no unit quaternion"
OUT_OF_RANGE = "position outside the room"
REASONS = {1: UNTRACKED, 2: NOT_FINITE, 3: NOT_A_ROTATION, 4: OUT_OF_RANGE}
"""The reasons of the other verdicts; the first of them where several hold."""


# Whether two sensors have changed places, or one has taken the place of the other.

HARDEST = 50.0
"""Hardest acceleration, m/s^2: half of it times the time squared is how far a sensor may be from where it was due."""
MUCH_NEARER = 0.35
"""A sensor is much nearer to the other's place than to its own below this ratio of the distances."""
_Point = list[float] | tuple[float, float, float]
_Two = tuple[_Point, _Point]


def sides_swapped(was: _Two, due: _Two, now: _Two, elapsed: float, least: float) -> bool:
    """Whether two sensors, reported at `now`, have changed places.

    was: where they were reported `elapsed` s ago. due: where they would be at constant velocity. Each must be much
    nearer to where the other was due than to where it was due itself, and nearer to where the other was: two hands that
    meet and rebound are not due where they are, but stay on their own side. Sensors nearer than `least` m, or within
    reach of a hard movement, are not distinguished.
    """
    threshold = least + _by_hard_movement(elapsed)
    for one, other in ((0, 1), (1, 0)):
        own = dist(now[one], due[one])
        if own <= threshold or dist(now[one], due[other]) > MUCH_NEARER * own:
            return False
        if dist(now[one], was[other]) >= dist(now[one], was[one]):
            return False
    return True


def taken_over(due: _Two, now: _Point, elapsed: tuple[float, float], *, least: float, calm: float) -> bool:
    """Whether a sensor that is reported at `now` is in fact the other one, which is not reported any more.

    due: where itself and the other would be at constant velocity. elapsed: s since each was reported. It must go on
    from where the other was, within `calm` m and a hard movement, and be far from where it was due itself.
    """
    own, near = dist(now, due[0]), dist(now, due[1])
    far = own > least + _by_hard_movement(elapsed[0])
    return far and near <= min(MUCH_NEARER * own, calm + _by_hard_movement(elapsed[1]))


def _by_hard_movement(elapsed: float) -> float:
    """The largest distance, m, of a sensor from where it was due after `elapsed` s."""
    return 0.5 * HARDEST * min(elapsed, 0.1) ** 2


# Positions that no human can have reached: jumps, and swaps of left and right.

CALM = 0.06
"""m; a shorter step is neither a jump nor a swap."""
TOGETHER_S = 0.1
"""Jumps of both sides within this time may be a swap that was sent in two datagrams."""


class _Elsewhere:
    """One sensor at an impossible place: its first and its last place there, and since when. home: where it would be
    otherwise, at its last accepted place, or where the other side of a swap is reported. settles: time alone makes it
    valid again, also after a swap. alone: only one of the two swapped sensors has been reported since."""

    __slots__ = ("alone", "count", "first", "home", "kind", "last", "place", "settles", "since")

    def __init__(self, kind: ValidityState, place: _Point, time: float, *, home: _Point) -> None:
        self.kind, self.home, self.settles, self.alone = kind, home, False, False
        self.first = self.place = place
        self.since = self.last = time
        self.count = 1


class JumpDetection:
    """Judges positions of k sensors against where each was last accepted, by capture time.

    A sensor that jumped is refused until it jumps back, or has gone on from its new place for `settled_after`. Once
    `keep_sides` was called, swapped sides are refused until they change back.
    `state` (k,): FRESH, JUMPED (from the second pose on; a single outlier is only dropped), or SWAPPED.
    `refused_at` (k,): s, of the last refused pose. `resettled` (k,): whether it was accepted again at a new place.
    """

    def __init__(self, names: tuple[str, ...], last: WatchedSensors, limits: ValidityLimits) -> None:
        count = len(names)
        self._last = last
        self._limits = limits
        self._elsewhere: dict[int, _Elsewhere] = {}
        self._keeps_sides = False
        self.state: StateArray = np.zeros(count, dtype=np.uint8)
        self.refused_at = np.full(count, -np.inf)
        self.resettled: BoolArray = np.zeros(count, dtype=bool)
        self._other: dict[int, int] = {
            row: names.index(mirrored_name(name))
            for row, name in enumerate(names)
            if name != mirrored_name(name) and mirrored_name(name) in names
        }

    def keep_sides(self) -> None:
        """From now on left and right are known: a swap no longer settles by time alone."""
        self._keeps_sides = True
        for jump in self._elsewhere.values():
            jump.settles = True

    @property
    def any_refused(self) -> bool:
        """Whether a sensor is refused for its place."""
        return bool(self._elsewhere)

    def take(self, rows: IntArray, time: float, position: FloatArray) -> tuple[BoolArray, BoolArray]:
        """Judge the positions (m, 3) m of one capture. Returns which may be used, and which become the last accepted
        place; (m,) each."""
        calm = np.linalg.norm(position - self._last.pose[rows, :3], axis=1) <= CALM
        elapsed = (time - self._last.at[rows]).tolist()
        places, order = position.tolist(), rows.tolist()
        swapped = self._swaps(order, places, elapsed, calm)
        took_over = self._take_overs(order, places, time, calm)
        usable, stored = np.ones(len(rows), dtype=bool), np.ones(len(rows), dtype=bool)
        for row in self._changed_back(dict(zip(order, places, strict=True)), time):
            self._accept(row, resettled=False)
        for i, row in enumerate(order):
            if row in swapped:
                self._refuse(row, ValidityState.SWAPPED, places[i], time)
                usable[i] = stored[i] = False
            elif row in took_over:
                self._refuse_alone(row, places[i], time)
                usable[i] = stored[i] = False
            elif row in self._elsewhere:
                usable[i] = stored[i] = self._go_on(row, places[i], time)
            elif -self._limits.settled_after <= elapsed[i] <= 0.0:
                # Late or sent twice: good enough to use, but not the last accepted place.
                usable[i] = dist(places[i], self._last.pose[row, :3]) <= self._within(0.0)
                stored[i] = False
            elif elapsed[i] > 0.0 and dist(places[i], self._last.pose[row, :3]) > self._within(elapsed[i]):
                self._refuse(row, ValidityState.JUMPED, places[i], time)
                usable[i] = stored[i] = False
        self._swaps_in_two()
        self._note_homes(order, places)
        return usable, stored

    def _changed_back(self, at: dict[int, _Point], time: float) -> list[int]:
        """The swapped rows among those at these places that are back where the other side was reported."""
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
        jump = self._elsewhere.get(row)
        if jump is None or not self._swapped(row) or time <= jump.last:
            return False
        on, back = dist(place, jump.place), dist(place, jump.home)
        apart = dist(jump.place, jump.home) > self._limits.swap
        return apart and on > CALM and back < 0.5 * on and back <= self._within(time - jump.last)

    def _swapped(self, row: int) -> bool:
        """Whether a row is swapped until it changes back."""
        jump = self._elsewhere.get(row)
        return self._keeps_sides and jump is not None and jump.kind is ValidityState.SWAPPED and not jump.settles

    def _note_homes(self, order: list[int], places: list[_Point]) -> None:
        for row, place in zip(order, places, strict=True):
            if self._swapped(row) and self._swapped(self._other[row]):
                self._elsewhere[self._other[row]].home = place

    def _swaps(self, order: list[int], places: list[_Point], elapsed: list[float], calm: BoolArray) -> set[int]:
        """Rows of pairs that changed places between their last capture and this one."""
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
            if sides_swapped(was, due, (places[i], places[at[other]]), since, self._limits.swap):
                found |= {row, other}
        return found

    def _take_overs(self, order: list[int], places: list[_Point], time: float, calm: BoolArray) -> set[int]:
        """Rows that go on from the place of their other side, which is missing in this capture."""
        found: set[int] = set()
        if calm.all():
            return found
        present = set(order)
        for i, row in enumerate(order):
            other = self._other.get(row, -1)
            if calm[i] or other < 0 or other in present or not self._elsewhere.keys().isdisjoint((row, other)):
                continue
            elapsed = (time - float(self._last.at[row]), time - float(self._last.at[other]))
            if 0.0 < elapsed[0] < inf and 0.0 < elapsed[1] <= TOGETHER_S:
                due = (self._due(row, elapsed[0]), self._due(other, elapsed[1]))
                if taken_over(due, places[i], elapsed, least=self._limits.swap, calm=CALM):
                    found.add(row)
        return found

    def _due(self, row: int, elapsed: float) -> _Point:
        """Where a sensor would be now at constant velocity."""
        span = max(self._last.at[row] - self._last.before[row], self._limits.shortest_step)
        if max(span, elapsed) > TOGETHER_S:
            return _point(self._last.pose[row, :3])
        share = max(elapsed, self._limits.shortest_step) / span
        return _point(self._last.pose[row, :3] + share * self._last.step[row, :3])

    def _swaps_in_two(self) -> None:
        """Mark as swapped both sides that jumped one after the other to each other's place."""
        for row, here in self._elsewhere.items():
            there = self._elsewhere.get(self._other.get(row, -1))
            if there is None or here.kind is ValidityState.SWAPPED or abs(here.since - there.since) > TOGETHER_S:
                continue
            was = (_point(self._last.pose[row, :3]), _point(self._last.pose[self._other[row], :3]))
            if sides_swapped(was, was, (here.first, there.first), TOGETHER_S, self._limits.swap):
                for one, jump in ((row, here), (self._other[row], there)):
                    jump.kind = ValidityState.SWAPPED
                    self.state[one] = ValidityState.SWAPPED

    def _within(self, elapsed: float) -> float:
        """How far, m, a human can move in `elapsed` s."""
        return self._limits.fastest * max(elapsed, self._limits.shortest_step)

    def _refuse(self, row: int, kind: ValidityState, place: _Point, time: float) -> None:
        self._elsewhere[row] = _Elsewhere(kind, place, time, home=_point(self._last.pose[row, :3]))
        self.refused_at[row] = time
        self.state[row] = kind if kind is ValidityState.SWAPPED else ValidityState.FRESH

    def _refuse_alone(self, row: int, place: _Point, time: float) -> None:
        """Refuse a sensor that is where its other side was. The other side may still be reported, so both states stay
        FRESH until the second pose there."""
        other = self._other[row]
        home = _point(self._last.pose[row, :3])
        self._refuse(other, ValidityState.SWAPPED, home, float(self._last.at[other]))
        self._refuse(row, ValidityState.SWAPPED, place, time)
        for one in (row, other):
            self._elsewhere[one].alone, self.state[one] = True, ValidityState.FRESH
        self._elsewhere[other].count = 0

    def _report_alone(self, row: int, place: _Point, time: float) -> None:
        """Set both states to SWAPPED at the next pose of a swap of which only one side was reported."""
        jump, there = self._elsewhere[row], self._elsewhere.get(self._other[row])
        if there is None or not (
            jump.count == 1 or (jump.count == 0 and dist(place, jump.place) < dist(place, jump.home))
        ):
            return
        if jump.count == 0:  # the side that was missing
            jump.alone = there.alone = False
        self.refused_at[self._other[row]], self.state[self._other[row]] = time, ValidityState.SWAPPED

    def _stay_swapped(self, row: int, place: _Point, time: float) -> bool:
        """Take one more pose of a swapped sensor. Returns whether it is accepted again."""
        jump = self._elsewhere[row]
        if jump.alone and self._other[row] not in self._elsewhere:  # the other is back at its own place: no swap
            if dist(place, self._last.pose[row, :3]) <= self._within(time - float(self._last.at[row])):
                return self._accept(row, resettled=False)
            self._refuse(row, ValidityState.JUMPED, place, time)
            self.state[row] = ValidityState.JUMPED
            return False
        jump.place, jump.last = place, time
        jump.count += 1
        self.refused_at[row], self.state[row] = time, jump.kind
        return False

    def _go_on(self, row: int, place: _Point, time: float) -> bool:
        """Take one more pose of a refused sensor. Returns whether it is accepted again."""
        jump = self._elsewhere[row]
        gap = time - jump.last
        if -self._limits.settled_after <= gap <= 0.0:
            return False
        if jump.alone:
            self._report_alone(row, place, time)
        if self._swapped(row):
            return self._stay_swapped(row, place, time)
        on, back = dist(place, jump.place), dist(place, self._last.pose[row, :3])
        if gap > 0.0 and on > CALM and back < 0.5 * on and back <= self._within(min(time - jump.since, TOGETHER_S)):
            return self._accept(row, resettled=False)
        if not 0.0 < gap <= self._limits.stale_after or on > self._within(gap):
            self._refuse(row, ValidityState.JUMPED, place, time)
            self.state[row] = ValidityState.JUMPED  # not the first one
            return False
        jump.place, jump.last = place, time
        jump.count += 1
        self.refused_at[row] = time
        self.state[row] = jump.kind
        if time - jump.since >= self._limits.settled_after:
            return self._accept(row, resettled=True)
        return False

    def _accept(self, row: int, *, resettled: bool) -> bool:
        del self._elsewhere[row]
        self.state[row] = ValidityState.FRESH
        self.resettled[row] = resettled
        return True


def _point(array: FloatArray) -> list[float]:
    return [float(number) for number in array]


MAX_CHANGES = 64
"""Changes that wait for the next messages; older ones are forgotten."""
NO_TIME = "pose at a time that is not finite"
UNREACHABLE = "position that no human can have reached"


class SensorValidity:
    """The validity of k sensors. Times are s of the local clock; memory is bounded; no data from outside raise.

    refused: poses that were not used, by reason. A pose that may be used is finite and a rotation, inside the room,
    tracked by the sender, and within reach of the last one.
    """

    def __init__(self, names: Sequence[str], limits: ValidityLimits | None = None) -> None:
        self.names = tuple(names)
        self.limits = limits or ValidityLimits()
        self.refused = Dropped()
        count = len(self.names)
        self._watched = watched_sensors(count, self.limits)
        self._jumps = JumpDetection(self.names, self._watched, self.limits)
        self._states: StateArray = np.full(count, ValidityState.STALE, dtype=np.uint8)
        self._noted = self._states.tobytes()
        self._was_fresh = np.zeros(count, dtype=bool)
        self._changes: deque[ValidityChange] = deque(maxlen=MAX_CHANGES)

    def take(
        self, rows: IntArray, time: float, *, position: FloatArray, orientation: FloatArray, tracked: BoolArray
    ) -> BoolArray:
        """Judge m poses of one capture at `time`. Returns which may be used, (m,), until the next call.

        rows (m,): their sensors, indices into names, each once. position (m, 3) m, world, needed. orientation (m, 4)
        wxyz, all NaN where it is missing. tracked (m,): False where the sender marks them as lost.
        """
        if not isfinite(time):
            self.refused.reasons[NO_TIME] += len(rows)
            return np.zeros(len(rows), dtype=bool)
        position, orientation = np.ascontiguousarray(position), np.ascontiguousarray(orientation)
        found = self._watched.take(rows, time, position, orientation, tracked, self._jumps.any_refused)
        if found is None:  # all are valid and calm
            return tracked
        verdicts, taken = found
        usable: BoolArray = np.equal(verdicts, VALID)
        for verdict in verdicts[~usable].tolist():
            self.refused.reasons[REASONS[verdict]] += 1
        if not taken:
            usable[usable] = self._take_jumps(rows[usable], time, position[usable], orientation[usable])
        return usable

    def _take_jumps(self, rows: IntArray, time: float, position: FloatArray, orientation: FloatArray) -> BoolArray:
        """Judge valid poses of which some made more than a calm step."""
        usable, stored = self._jumps.take(rows, time, position)
        if jumped := len(rows) - int(np.count_nonzero(usable)):
            self.refused.reasons[UNREACHABLE] += jumped
        self._watched.put(rows[stored], time, np.concatenate((position, orientation), axis=1)[stored])
        self._watched.forget_turn(rows[usable & np.isnan(orientation[:, 0])])
        return usable

    def keep_sides(self) -> None:
        """From now on swapped sides are refused until they change back."""
        self._jumps.keep_sides()

    def judge(self, now: float) -> StateArray:
        """The ValidityState of each sensor at `now`, (k,), read-only."""
        states: StateArray = self._watched.judge(now)
        if not isfinite(now):
            now = np.inf
        if self._jumps.any_refused:
            refused = self._jumps.state != ValidityState.FRESH
            refused &= np.abs(now - self._jumps.refused_at) <= self.limits.stale_after
            states[refused] = self._jumps.state[refused]
        if (noted := states.tobytes()) != self._noted:
            self._note(np.flatnonzero(states != self._states), states, now)
        states.flags.writeable = False
        self._states, self._noted = states, noted
        return states

    def messages(self) -> list[str]:
        """What has changed since the last call, in sentences for the user."""
        if not self._changes:
            return []
        messages = sentences(net_changes(self._changes))
        self._changes.clear()
        return messages

    def forget_recovered(self) -> None:
        """Drop the waiting changes of sensors that are fresh now."""
        fresh = {name for name, state in zip(self.names, self._states, strict=True) if state == ValidityState.FRESH}
        kept = [change for change in self._changes if change.name not in fresh]
        self._changes.clear()
        self._changes.extend(kept)

    def _note(self, rows: IntArray, states: StateArray, now: float) -> None:
        still, at = self._watched.still_for, self._watched.at
        for row in rows.tolist():
            before, after = ValidityState(self._states[row]), ValidityState(states[row])
            first = not self._was_fresh[row]
            self._was_fresh[row] |= after is ValidityState.FRESH
            if first and before is ValidityState.STALE and after is ValidityState.FRESH:
                continue
            since = now - at[row]
            seconds = float(still[row] if after is ValidityState.FROZEN else since) if isfinite(since) else 0.0
            resettled = bool(self._jumps.resettled[row]) and before in (ValidityState.JUMPED, ValidityState.SWAPPED)
            self._changes.append(
                ValidityChange(now, self.names[row], before, after, seconds, resettled and after is ValidityState.FRESH)
            )
