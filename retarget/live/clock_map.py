"""Clock alignment: capture times on the local clock, from the sender's stamps and the least delay.

arrival - stamp is the offset of the clocks plus the delay of a datagram. Its minimum over a few seconds is the offset
plus the least delay (on a Motive recording within 0.42 ms of asking the sender).
"""

from collections import OrderedDict
from dataclasses import dataclass
from enum import StrEnum
from math import frexp, inf, isfinite, ldexp

from retarget.sources.streams.stream_frame import Dropped

ALIKE_S = 0.020  # agreement of the offsets after one jump, jitter included
ENOUGH = 3  # datagrams that must agree, as one or two may be strays
SPREAD_S = 0.010  # least time over which they arrive, as a backlog comes at once


class JumpKind(StrEnum):
    """Direction of a jump of the sender's clock."""

    RESTARTED = "restarted"
    FORWARD = "forward"
    BACK = "back"


@dataclass(frozen=True, slots=True)
class ClockJump:
    """A jump of the sender's clock, or of the delay. shift: s by which local minus sender time grew."""

    kind: JumpKind
    arrival: float
    shift: float


class OddRun:
    """A run of datagrams that do not fit the present estimate. `least`: their least (arrival - stamp), s."""

    def __init__(self) -> None:
        self.least = inf
        self._agreed = 0
        self._since = self._gap = self._stamp = 0.0

    def clear(self) -> None:
        """Start a new run, as a datagram fits."""
        self._agreed, self.least = 0, inf

    def note(self, arrival: float, stamp: float, step: float) -> None:
        """Add one datagram. step: s, of the sender's clock."""
        gap = arrival - stamp
        if self._agreed and abs(gap - self._gap) <= ALIKE_S + step and stamp > self._stamp:
            self._agreed += 1
            self.least = min(self.least, gap)
        else:
            self._agreed, self._since, self.least = 1, arrival, gap
        self._gap, self._stamp = gap, stamp

    def shows_jump(self, arrival: float) -> bool:
        """True if enough datagrams up to `arrival`, s, agree that the sender's clock jumped."""
        return self._agreed >= ENOUGH and arrival - self._since >= SPREAD_S


class SlidingMinimum:
    """Minimum over a window of s, in `buckets` parts that are dropped one at a time, so memory is bounded."""

    def __init__(self, window: float, *, buckets: int = 8) -> None:
        self._width = window / buckets
        self._least = [inf] * buckets
        self._bucket: int | None = None

    def add(self, now: float, value: float) -> None:
        """Add a value at a time (s), at least the last one."""
        index = self._turn_to(now)
        if value < self._least[index]:
            self._least[index] = value

    def at(self, now: float) -> float:
        """The least value at `now`, s; infinity for none."""
        self._turn_to(now)
        return min(self._least)

    def clear(self) -> None:
        """Forget everything."""
        self._least[:] = [inf] * len(self._least)
        self._bucket = None

    def _turn_to(self, now: float) -> int:
        count = len(self._least)
        bucket = int(now // self._width)
        if bucket == self._bucket:
            return bucket % count
        if self._bucket is None:
            self._bucket = bucket
        for entered in range(max(self._bucket + 1, bucket - count + 1), bucket + 1):
            self._least[entered % count] = inf
        self._bucket = max(self._bucket, bucket)
        return self._bucket % count


OFFSET_WINDOW_S = 2.0  # of arrivals; the earliest one gives the offset of a sender's clock
EARLY_S = 0.005  # a datagram that is earlier than all others by more counts only when others confirm it
STAMP_AHEAD_S = 0.100  # a datagram stamped further ahead is dropped until its clock is accepted
LATE_S = 0.250  # later datagrams are dropped: the robot must not follow a pose that old
REORDER_S = 0.100  # a datagram further behind the last delivered one is dropped
SHIFT_S = 0.030  # a smaller shift of the clock is jitter, no jump
COARSE_S = 0.002  # an equal stamp of a finer clock is the same frame
YOUNG_S = 10.0  # a clock that jumped back to less was restarted
NUDGE_S = 1e-6  # between samples with equal stamps, to keep their order
REMEMBERED = 64  # frames by which a repeated one is recognised
CLOCK_UNITS = {1e3: "milliseconds", 1e6: "microseconds", 1e9: "nanoseconds"}  # units of which so many are a second
RUN_S = 0.1  # [s] over which a sender's clock is measured before its unit is named


def unit_of(speed: float) -> str:
    """The unit of a clock of this speed, per s; "" for none of CLOCK_UNITS."""
    return next((unit for factor, unit in CLOCK_UNITS.items() if 0.5 * factor < speed < 2.0 * factor), "")


def not_seconds(unit: str) -> str:
    """The reason for which frames with a time in this unit are dropped."""
    return f"the sender's time looks like {unit}, and not like seconds"


class ClockMap:
    """Maps one sender's stamps to the local monotonic clock.

    resolution: s, of coarse stamps. significand: bits of the stamps' format (24 for float32 seconds). A frame with a
    number and no stamp counts as captured on arrival. jumps: number of clock jumps. dropped: by reason.
    """

    def __init__(self, *, resolution: float = 0.0, significand: int = 53) -> None:
        self.jumps = 0
        self.last_jump: ClockJump | None = None
        self.dropped = Dropped()
        self._resolution = resolution
        self._significand = significand
        self._least = SlidingMinimum(OFFSET_WINDOW_S)
        self.offset: float | None = None  # [s] local minus sender time, with the least delay in it
        self._newest = -inf
        self._latest = -inf
        self._now = -inf
        self._odd = OddRun()
        self._recent: OrderedDict[tuple[float | None, int | None], None] = OrderedDict()
        self._newest_number: int | None = None
        self._began: tuple[float, float] | None = None  # [s] arrival and stamp of the first frame

    def map(self, arrival: float, stamp: float | None, number: int | None) -> float | None:
        """The local capture time (s) of a frame, at most its arrival (but for microseconds); None: dropped.

        arrival: s, local. stamp, number: as sent. Frames in the sender's order get rising times, and a frame that was
        overtaken an earlier one.
        """
        if not isfinite(arrival):
            self.dropped.note("arrival is not a time")
            return None
        self._now = arrival = max(arrival, self._now)
        if stamp is not None and not isfinite(stamp):
            stamp = None
        key = (stamp, number)
        if key == (None, None):
            return self._deliver(arrival)
        known = key in self._recent
        if stamp is None or self._step(stamp) < COARSE_S:
            repeated = known or (stamp is not None and stamp == self._newest)
        else:  # several frames may share a step of the clock
            repeated = known and number is not None
        if repeated:
            self.dropped.note("repeated" if known else "the sender's time stands still")
            return None
        if stamp is not None:
            time = self._by_clock(arrival, stamp, step=self._step(stamp))
        else:
            assert number is not None
            newest, self._newest_number = self._newest_number, number
            if newest is not None and 0 < newest - number <= REMEMBERED:
                self._newest_number = newest
                self.dropped.note("out of order")
                return None
            time = self._deliver(arrival)
        if time is not None:
            self._recent[key] = None
            if len(self._recent) > REMEMBERED:
                self._recent.popitem(last=False)
        return time

    def _by_clock(self, arrival: float, stamp: float, *, step: float) -> float | None:
        gap = arrival - stamp
        self._began = self._began or (arrival, stamp)
        if self.offset is None:
            self._restart(arrival, gap)
        assert self.offset is not None
        excess = gap - self.offset
        if excess < -(EARLY_S + step) or excess > LATE_S or self._latest - stamp - self.offset > REORDER_S + step:
            return self._odd_one(arrival, stamp, step=step)
        self._odd.clear()
        self._least.add(arrival, gap)
        self.offset = self._least.at(arrival)
        return self._in_order(arrival, stamp, step)

    def _odd_one(self, arrival: float, stamp: float, *, step: float) -> float | None:
        """The time of a frame that does not fit: it shows a jump if others agree, else it is used if only a little
        early."""
        assert self.offset is not None
        excess = arrival - stamp - self.offset
        self._odd.note(arrival, stamp, step)
        if self._odd.shows_jump(arrival):
            shift = self._odd.least - self.offset
            if abs(shift) >= SHIFT_S:
                back = JumpKind.RESTARTED if stamp < YOUNG_S and stamp < self._newest else JumpKind.BACK
                self.jumps += 1
                self.last_jump = ClockJump(back if shift > 0.0 else JumpKind.FORWARD, arrival, shift)
            self._restart(arrival, self._odd.least)
            return self._in_order(arrival, stamp, step)
        if -(STAMP_AHEAD_S + step) <= excess < 0.0:
            return self._deliver(arrival)
        assert self._began is not None
        since = arrival - self._began[0]
        unit = unit_of((stamp - self._began[1]) / since) if since > RUN_S else ""
        usual = "stamped ahead" if excess < 0.0 else "late" if excess > LATE_S else "out of order"
        self.dropped.note(not_seconds(unit) if unit else usual)
        return None

    def _restart(self, arrival: float, gap: float) -> None:
        self._least.clear()
        self._least.add(arrival, gap)
        self.offset, self._newest = gap, -inf
        self._odd.clear()
        self._recent.clear()

    def _in_order(self, arrival: float, stamp: float, step: float) -> float:
        assert self.offset is not None
        time = min(arrival, stamp + self.offset + step)
        if stamp < self._newest:
            return min(time, self._latest - NUDGE_S)
        self._newest = stamp
        return self._deliver(time)

    def _deliver(self, time: float) -> float:
        self._latest = max(time, self._latest + NUDGE_S)
        return self._latest

    def _step(self, stamp: float) -> float:
        return max(self._resolution, ldexp(1.0, frexp(stamp)[1] - self._significand))
