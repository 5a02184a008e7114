"""Replay: the recorded sensors, servos and clock through the pipeline of now, and how its goals differ."""

from dataclasses import dataclass, replace

import numpy as np

import retarget
from hardware.arrays import TickArray
from hardware.bus import ServoGoals, ServoStates
from hardware.errors import BusError, counted
from hardware.guard import Guard
from hardware.guard_state import StopCause
from retarget.errors import InputError
from retarget.frames import SensorSample
from retarget.human.samples import Clip, Performance
from retarget.model.robot import RobotBody
from retarget.recording.configs import Configs, as_recorded
from retarget.recording.cycles import Asked, Cursor, Done
from retarget.recording.reading import Played
from retarget.recording.session import Session, machine_name
from retarget.recording.topics import SERVO_FIELDS
from retarget.run.loop import Watch
from retarget.run.prepare import Prepared, prepare_for
from retarget.run.record import Record
from retarget.run.run_result import RunResult
from retarget.schema.performer import Performer
from retarget.types import FloatArray, IntArray, Notify

# What stands in for clock, servos and performer while a recording is run again: each gives what it gave then.


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
            self._now = max(self._now, float(cursor.cycles.clock[row, self._reading]) - cursor.clock_lead)
            self._reading += 1
        return self._now

    def sleep_until(self, deadline: float) -> None:
        """The next tick is due."""
        self._cursor.before()

    def idle(self) -> float:
        """Idle times are not recorded: a suspension is replayed as a pause."""
        return 0.0


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
        """Do nothing: there is nothing to open."""

    def read(self) -> ServoStates:
        """What the servos said. Raises BusError where the bus failed."""
        self._cursor.look()
        cycles, row = self._cursor.cycles, self._cursor.row
        if cycles.read[row] == Done.FAILED:
            raise BusError(self._text("bus read", row))
        before, position = int(self._before[row]), cycles.position[row].copy()
        if self.sent and before >= 0:
            position += self.sent[-1][1] - cycles.goal_ticks[before]
        said = {name: getattr(cycles, name)[row].copy() for name in SERVO_FIELDS}
        return ServoStates(
            **said | {"position": position},
            time=float(cycles.bus_time[row]) - self._cursor.clock_lead,
            retries=int(cycles.retries[row]),
            error_rate=float(cycles.error_rate[row]),
        )

    def write(self, goals: ServoGoals) -> None:
        """Keep a goal. Raises BusError where the bus failed."""
        row = self._cursor.row
        recorded = self._cursor.recorded and not self._cursor.late
        self.sent.append((row if recorded else -1, goals.ticks.copy()))
        if recorded and self._cursor.cycles.written[row] == Done.FAILED:
            raise BusError(self._text("bus write", row))

    def torque(self, on: bool) -> None:
        """Do nothing: there is no torque to switch."""

    def close(self) -> None:
        """Do nothing: there is nothing to close."""

    def _text(self, who: str, row: int) -> str:
        return self._texts.get((int(self._cursor.cycles.index[row]), who), "as recorded")


class ReplayedSamples:
    """`Samples` that say what was followed then."""

    def __init__(self, played: Played, cursor: Cursor) -> None:
        session, cycles = played.recording.session, cursor.cycles
        self.ticks, self.dt, self.motion_dt = session.ticks, session.dt, session.motion_dt
        self.kept = min(session.ticks, played.last_tick + 1)
        self._played, self._cursor = played, cursor
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
        """How much of its speed the robot might use at this tick of the recording, 0 to 1 (see `Samples.settled`)."""
        return float(self._cursor.cycles.settled[self._row])

    @property
    def hold_reason(self) -> str:
        """Return the reason to hold at this tick of the recording, without words."""
        return "as recorded"

    @property
    def paused(self) -> bool:
        """Whether the operator had paused at this tick of the recording."""
        return self._cursor.asked(Asked.PAUSED)

    def may_approach(self) -> bool:
        """Return whether the approach went on in the recording; where this run is later than that one was, it goes
        on."""
        return self._cursor.late or self._cursor.asked(Asked.APPROACH)

    def poll(self) -> None:
        """Do nothing: all samples are there from the start."""

    def hold(self) -> None:
        """What followed is in the recording."""

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
        rows = np.maximum.accumulate(np.maximum(self._rows, 0))
        return self._played.clip(rows, len(rows), dt=self.dt, speed=self.motion_dt / self.dt)

    def _at(self, row: int) -> SensorSample | None:
        cycles = self._cursor.cycles
        if cycles.sampled[row] != Done.WELL:
            return None
        weight = cycles.sensor_weight[row].copy() if cycles.weighted[row] else None
        position, orientation = cycles.sensor_position[row].copy(), cycles.sensor_orientation[row].copy()
        names, valid = self._played.recording.session.sensors, cycles.sensor_valid[row].copy()
        return SensorSample(names, position, orientation, valid, weight)


# How a run that was replayed differs from what was recorded: in how many goals, from which tick, by how much.


@dataclass(frozen=True)
class Difference:
    """compared: goals (of a human alone: postures) that were recorded. differ: of those, other ones now. first: cycle
    of the first, and time_s since the recording began; None: none. most: by how much at most, in `unit`, and where.
    absent: recorded and not sent now; extra: sent now and not recorded. whole: the recording holds all of its run.
    machine: on which it was recorded, if that is another one than this."""

    compared: int
    differ: int = 0
    first: int | None = None
    time_s: float | None = None
    most: float = 0.0
    ticks: int = 0
    where: str = ""
    unit: str = "m or rad"
    absent: int = 0
    extra: int = 0
    whole: bool = True
    machine: str = ""

    @property
    def none(self) -> bool:
        """Whether all goals are there and the same, and none is extra."""
        return not (self.differ or self.absent or self.extra)

    def lines(self) -> list[str]:
        """The difference in words, line by line."""
        what = "goals" if self.unit == "degrees" else "postures"
        if self.none:
            held = "" if self.whole else " that it holds"
            same = f"are as recorded{self._where}, to the bit"
            if what == "goals":
                each = f"one at arming, and one in each of {counted(self.compared - 1, 'tick')}"
                return [f"all {self.compared} goals{held} {same}: {each}"]
            return [f"all {self.compared} postures{held} {same}"]
        found = []
        if self.differ:
            at = f"from cycle {self.first}, {self.time_s:.3f} s after the recording began"
            ticks = f" ({self.ticks} ticks)" if what == "goals" else ""
            found.append(f"{self.differ} of {self.compared} {what} differ from those recorded{self._where}, {at}")
            found.append(f"by {self.most:.3g} {self.unit}{ticks} at most, {self.where}")
        if self.absent:
            found.append(f"{self.absent} {what} were recorded and are not sent now")
        if self.extra:
            found.append(f"{self.extra} {what} are sent now and were not recorded")
        return found

    @property
    def _where(self) -> str:
        return f" on {self.machine}" if self.machine else ""


def _other_machine(played: Played) -> str:
    """The machine of a recording, if it is another one than this."""
    machine = played.recording.session.machine
    return "" if machine == machine_name() else machine


def goal_difference(played: Played, bus: ReplayedBus, robot: RobotBody) -> Difference:
    """Compare goals, in ticks. Goals after the end of a recording that breaks off are no difference."""
    cycles = played.cycles
    wrote = np.flatnonzero(cycles.written != Done.NOT)
    now = np.full((len(cycles), cycles.goal_ticks.shape[1]), np.iinfo(np.int64).min)
    extra = 0
    for row, goal in bus.sent:
        if row < 0 or cycles.written[row] == Done.NOT or now[row, 0] != np.iinfo(np.int64).min:
            extra += 1
        else:
            now[row] = goal
    sent = wrote[now[wrote, 0] != np.iinfo(np.int64).min]
    servos = robot.joint_map
    off = np.abs(
        np.rad2deg(servos.to_radians(now[sent]) - servos.to_radians(cycles.goal_ticks[sent])), dtype=np.float64
    )
    return replace(
        _located(off, cycles.index[sent], servos.joints, cycles.clock[sent, 0] - cycles.clock[0, 0]),
        compared=len(wrote),
        ticks=int(np.abs(now[sent] - cycles.goal_ticks[sent]).max(initial=0)),
        unit="degrees",
        absent=len(wrote) - len(sent),
        extra=extra if played.whole else 0,
        whole=played.whole,
        machine=_other_machine(played),
    )


def posture_difference(played: Played, q: FloatArray) -> Difference:
    """Compare postures (T, nq), m and rad, of a human alone with the recorded ones, which are in single precision."""
    kept = played.cycles.human_q
    recorded, names = kept[np.isfinite(kept).all(axis=1)], tuple(f"q[{column}]" for column in range(q.shape[1]))
    both = min(len(recorded), len(q))
    off = np.abs(q[:both].astype(np.float32).astype(np.float64) - recorded[:both])
    found = _located(off, np.arange(both), names, np.asarray(np.arange(both) * played.recording.session.dt, np.float64))
    absent, machine = len(recorded) - both, _other_machine(played)
    return replace(found, compared=len(recorded), absent=absent, whole=played.whole, machine=machine)


def _located(off: FloatArray, cycles: IntArray, names: tuple[str, ...], seconds: FloatArray) -> Difference:
    """Where numbers (T, n) of these names are off, in cycles (T,) that began at seconds (T,) of the recording."""
    wrong = np.flatnonzero((off > 0.0).any(axis=1))
    if not wrong.size:
        return Difference(compared=len(off))
    first, (row, column) = wrong[0], np.unravel_index(int(off.argmax()), off.shape)
    return Difference(
        compared=len(off),
        differ=len(wrong),
        first=int(cycles[first]),
        time_s=float(seconds[first]),
        most=float(off.max()),
        where=f"of {names[column]} in cycle {int(cycles[row])}",
    )


@dataclass(frozen=True, eq=False)
class Replayed:
    """result: of the run as it is now. difference: from what was recorded. changed: files and software that differ."""

    result: RunResult
    difference: Difference
    changed: tuple[str, ...]


def replay(
    played: Played, configs: Configs | None = None, *, watch: Watch | None = None, notify: Notify = lambda text: None
) -> Replayed:
    """Run it again. configs: None: those of then. watch: only its `on_tick` is called. notify: as of `prepare_for`.

    Raises RetargetError for what cannot be run any more; InputError where robot or performer are others now.
    """
    if configs is None:
        with as_recorded(played.recording) as then:
            return replay(played, then, watch=watch, notify=notify)
    session, has_robot = played.recording.session, bool(played.recording.session.joints)
    cursor = Cursor(played.cycles, has_robot=has_robot, dt=session.dt)
    samples, bus, clock = ReplayedSamples(played, cursor), ReplayedBus(played, cursor), ReplayedClock(cursor)

    def perform(performer: Performer, robot: RobotBody | None) -> Performance:
        now, allowed = tuple(performer.sensors), ", ".join(session.sensors)
        _refuse_others("the performer has other sensors", now, session.sensors, where=performer.name, allowed=allowed)
        if robot is not None:
            refuse_other_robot(session, robot)
        return Performance(samples, session.size, session.notes, session.intake_times)

    robot = configs.robot
    with prepare_for(
        perform,
        configs.options,
        clock=clock,
        make_bus=lambda robot, clock: bus,
        end_plan=None if robot is None else session.end_plan(robot),
        notify=notify,
        robot=robot,
    ) as prepared:
        result = prepared.run(_watch(played, cursor, prepared, watch or Watch()))
    result = replace(result, notes=tuple(dict.fromkeys(result.notes)))  # those of then are mostly made again
    if robot is None:
        difference = posture_difference(played, result.record.human_q)
    else:
        difference = goal_difference(played, bus, robot)
    return Replayed(result, difference, (*what_computes(session), *configs.notes))


def what_computes(session: Session) -> tuple[str, ...]:
    """What differs from when it was recorded: version and numpy; a sentence each."""
    found = (
        ("by retarget", session.version, retarget.__version__),
        ("with numpy", session.numpy, np.__version__),
    )
    return tuple(f"recorded {how} {was}, this is {now}" for how, was, now in found if was != now)


def refuse_other_robot(session: Session, robot: RobotBody) -> None:
    """Raise InputError where the robot has other servos than it had."""
    allowed = f"the profile of then, of {session.robot}, which is attached to the recording"
    now, where = robot.joint_map.joints, robot.profile.name
    _refuse_others("the robot has other servos", now, session.joints, where=where, allowed=allowed)


def _refuse_others(what: str, now: tuple[str, ...], then: tuple[str, ...], *, where: str, allowed: str) -> None:
    if now != then:
        missing, added = [name for name in then if name not in now], [name for name in now if name not in then]
        parts = [f"{word} {', '.join(names)}" for word, names in (("without", missing), ("with", added)) if names]
        found = "; ".join(parts) or "another order of them"
        raise InputError(f"{what} than when it was recorded", where=where, found=found, allowed=allowed)


def _watch(played: Played, cursor: Cursor, prepared: Prepared, watch: Watch) -> Watch:
    """A watch that asks for what was asked for then."""
    guard = None if prepared.machine is None else prepared.machine.guard
    texts = played.recording.texts

    def stop_asked() -> bool:
        cursor.before()
        if guard is not None and cursor.asked(Asked.OUTSIDE):
            _stop(guard, texts.get((cursor.cycle, "outside"), ""))
        return cursor.asked(Asked.STOP)

    def torque_off_asked() -> bool:
        cursor.before()
        return cursor.asked(Asked.TORQUE_OFF) or cursor.over  # a run that was killed, or stands for ever, ends there

    def on_row(record: Record, row: int) -> None:
        if guard is None:
            cursor.look()

    return Watch(watch.on_tick, stop_asked, torque_off_asked, lambda: "stopped, as recorded", on_row, watch.every)


def _stop(guard: Guard, text: str) -> None:
    """Stop the guard as the recorded watch did. text: cause and reason."""
    name, _, reason = text.partition(": ")
    cause = next((cause for cause in StopCause if cause.value == name), StopCause.REQUESTED)
    guard.latch(cause, reason or "as recorded")
