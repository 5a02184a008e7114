"""What stands in for clock, servos and performer while a recording is run again: each says what it said then."""

import numpy as np

from hardware.arrays import TickArray
from hardware.bus import ServoGoals, ServoStates
from hardware.errors import BusError
from retarget.clip import Clip
from retarget.frames import SensorFrames, SensorSample
from retarget.recording.cursor import Cursor
from retarget.recording.cycles import Asked, Done
from retarget.recording.played import Played

__all__ = ["ReplayedBus", "ReplayedClock", "ReplayedSamples"]


class ReplayedClock:
    """A `Clock` that reads as it read in the recorded cycle, one reading after the other."""

    def __init__(self, cursor: Cursor) -> None:
        self._cursor, self._cycle, self._reading = cursor, -1, 0
        self._now = float(cursor.cycles.clock[0, 0])

    def now(self) -> float:
        """The time in s; never decreases."""
        cursor, row = self._cursor, self._cursor.row
        if cursor.cycle != self._cycle:
            self._cycle, self._reading = cursor.cycle, 0
        if self._reading < cursor.cycles.readings[row]:
            self._now = max(self._now, float(cursor.cycles.clock[row, self._reading]) - cursor.ahead)
            self._reading += 1
        return self._now

    def sleep_until(self, deadline: float) -> None:
        """The next tick is due."""
        self._cursor.before()


class ReplayedBus:
    """A `ServoBus` whose servos are as far from their goals as they were. sent: rows of the recording and goals (n,).

    Where the same goals are sent, they are where they were, to the tick.
    """

    def __init__(self, played: Played, cursor: Cursor) -> None:
        self._texts, self._cursor = played.recording.texts, cursor
        self.sent: list[tuple[int, TickArray]] = []
        cycles = cursor.cycles
        wrote = cycles.written != Done.NOT
        last = np.maximum.accumulate(np.where(wrote, np.arange(len(cycles)), -1))
        self._before = np.concatenate([[-1], last[:-1]])  # row of the last goal before each

    def open(self) -> None:
        """Nothing to open."""

    def read(self) -> ServoStates:
        """What the servos said. Raises BusError where the bus failed."""
        self._cursor.look()
        cycles, row = self._cursor.cycles, self._cursor.row
        if cycles.read[row] == Done.FAILED:
            raise BusError(self._text("bus read", row))
        position = cycles.position[row].copy()
        before = int(self._before[row])
        if self.sent and before >= 0:
            position += self.sent[-1][1] - cycles.goal[before]
        return ServoStates(
            time=float(cycles.bus_time[row]) - self._cursor.ahead,
            position=position,
            velocity=cycles.velocity[row].copy(),
            current=cycles.current[row].copy(),
            voltage=cycles.voltage[row].copy(),
            temperature=cycles.temperature[row].copy(),
            error=cycles.error[row].copy(),
            alert=cycles.alert[row].copy(),
            age=cycles.age[row].copy(),
            valid=cycles.valid[row].copy(),
            driven=cycles.driven[row].copy(),
            retries=int(cycles.retries[row]),
            rough=float(cycles.rough[row]),
        )

    def write(self, goals: ServoGoals) -> None:
        """Keep a goal. Raises BusError where the bus failed."""
        row = self._cursor.row
        recorded = self._cursor.recorded and not self._cursor.late
        self.sent.append((row if recorded else -1, goals.ticks.copy()))
        if recorded and self._cursor.cycles.written[row] == Done.FAILED:
            raise BusError(self._text("bus write", row))

    def torque(self, on: bool) -> None:
        """There is none."""

    def close(self) -> None:
        """Nothing to close."""

    def _text(self, who: str, row: int) -> str:
        return self._texts.get((int(self._cursor.cycles.index[row]), who), "as recorded")


class ReplayedSamples:
    """`Samples` that say what was followed then."""

    def __init__(self, played: Played, cursor: Cursor) -> None:
        session, cycles = played.recording.session, cursor.cycles
        self.ticks, self.dt, self.motion_dt = session.ticks, session.dt, session.motion_dt
        self.kept = min(session.ticks, played.last_tick + 1)
        self._names, self._source, self._cursor = session.sensors, session.source, cursor
        self._rows = np.full(self.kept, -1)
        sampled = np.flatnonzero(cycles.sampled != Done.NOT)
        self._rows[cycles.tick[sampled]] = sampled  # of the first tick, which is asked for twice, the second time
        self._rows = np.maximum.accumulate(self._rows)  # where a tick is missing, the one before it
        self._next = self._row = 0

    @property
    def over(self) -> bool:
        """Whether it ended here, or ends here."""
        return self._cursor.asked(Asked.OVER) or (self._next >= self.kept and self._cursor.cycle > 0)

    @property
    def settled(self) -> float:
        """As it was."""
        return float(self._cursor.cycles.settled[self._row])

    @property
    def hindrance(self) -> str:
        """As it was, without words."""
        return "as recorded"

    def may_approach(self) -> bool:
        """As it was; where this run is later than that one was, it goes on."""
        return self._cursor.late or self._cursor.asked(Asked.APPROACH)

    def listen(self) -> None:
        """Nothing comes in."""

    def sample(self, tick: int) -> SensorSample | None:
        """What was said at a tick."""
        cursor = self._cursor
        if cursor.cycle > 0:
            cursor.follow()
        if cursor.follows:
            self._next = max(self._next, tick + 1)
        self._row = max(int(self._rows[tick]), 0)
        return self._at(self._row)

    def recorded(self) -> Clip:
        """What was said at the ticks that were followed."""
        cycles, rows = self._cursor.cycles, np.maximum.accumulate(np.maximum(self._rows, 0))
        valid = cycles.sensor_valid[rows]
        frames = SensorFrames(
            time=np.arange(len(rows), dtype=np.float64) * self.dt,
            names=self._names,
            position=np.where(valid[..., None], cycles.sensor_position[rows], np.nan),
            orientation=np.where(valid[..., None], cycles.sensor_orientation[rows], np.nan),
            valid=valid,
            source=self._source,
            rate_hz=1.0 / self.dt,
        )
        return Clip(frames, len(rows), 1.0 / self.dt, self.motion_dt / self.dt, len(rows))

    def _at(self, row: int) -> SensorSample | None:
        cycles = self._cursor.cycles
        if cycles.sampled[row] != Done.WELL:
            return None
        weight = cycles.sensor_weight[row].copy() if cycles.weighted[row] else None
        position, orientation = cycles.sensor_position[row].copy(), cycles.sensor_orientation[row].copy()
        return SensorSample(self._names, position, orientation, cycles.sensor_valid[row].copy(), weight)
