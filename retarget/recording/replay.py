"""Replay: runs the recorded inputs through the present pipeline, and compares the goals."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import isfinite, isnan
from typing import ClassVar

import numpy as np

import retarget
from hardware.arrays import TickArray
from hardware.bus import ServoGoals, ServoStates
from hardware.clock import VirtualClock
from hardware.errors import BusError, counted
from hardware.guard_state import StopCause
from retarget.errors import InputError
from retarget.frames import SampleTimes, SensorSample
from retarget.human.samples import MAX_KEPT, Clip, Performance, PerformerInput
from retarget.model.robot import RobotBody
from retarget.recording.configs import Configs, as_recorded
from retarget.recording.cycles import Done, InputFlag, now_of
from retarget.recording.reading import Recording
from retarget.recording.session import Session, machine_name
from retarget.recording.topics import SERVO_FIELDS
from retarget.robot.walking.pattern import Request
from retarget.run.loop import RunObserver
from retarget.run.prepare import prepare_for
from retarget.run.run_result import RunResult
from retarget.run.supervisor import AT_RISK, OperatorInput
from retarget.run.table import imu_of
from retarget.run.tick import Failure, TickInput
from retarget.schema.performer import Performer
from retarget.types import FloatArray, IntArray, Notify, RunState


class RecordedSamples:
    """`retarget.human.samples.Samples` of a recording. A missing tick repeats the sample before it.

    rows (T,): cycle of each tick of following.
    """

    over: ClassVar[bool] = False
    paused: ClassVar[bool] = False
    hold_reason: ClassVar[str] = ""

    def __init__(self, recording: Recording) -> None:
        session, cycles = recording.session, recording.cycles
        self.ticks, self.dt, self.motion_dt = recording.last_tick + 1, session.dt, session.motion_dt
        self.kept = min(self.ticks, MAX_KEPT)
        self._recording, self._cycles, self._names = recording, cycles, session.sensors
        rows, sampled = np.zeros(self.ticks, dtype=np.intp), np.flatnonzero(cycles.sampled != Done.NOT)
        rows[cycles.tick[sampled]] = sampled  # the first tick is sampled twice, and the second time counts
        self.rows = np.maximum.accumulate(rows)

    def may_approach(self) -> bool:
        """Always true, because `RecordedInputs` holds the approach."""
        return True

    def poll(self) -> None:
        """Do nothing, because all samples are present."""

    def hold(self) -> None:
        """Do nothing, because the recording has the next samples."""

    def sample(self, tick: int) -> SensorSample | None:
        """The sensors at a tick; None: the robot held."""
        cycles, row = self._cycles, self.rows[tick]
        if cycles.sampled[row] != Done.WELL:
            return None
        position, orientation = cycles.sensor_position[row].copy(), cycles.sensor_orientation[row].copy()
        return SensorSample(self._names, position, orientation, cycles.sensor_valid[row].copy())

    def recorded(self) -> Clip:
        """The samples as a motion."""
        return self._recording.clip(self.rows[: self.kept], self.ticks, dt=self.dt, speed=self.motion_dt / self.dt)


class RecordedInputs:
    """`retarget.run.loop.Inputs` of the ticks of a recording, and the `hardware.bus.ServoBus` of the replay.

    Servos keep the recorded distance from their goals, so equal goals give equal servo positions, to the tick. A
    missing cycle repeats the one before it. The approach may differ in length, but following begins with the same
    cycle. The run ends after the last cycle. sent: the goals (n,), ticks, with the row of their cycle, -1 if it was not
    recorded.
    """

    late_ticks = 0

    def __init__(self, recording: Recording, samples: RecordedSamples) -> None:
        self._cycles = cycles = recording.cycles
        self._now, self._texts, self._samples = now_of(cycles), recording.texts, samples
        self.clock = VirtualClock(float(self._now[0]))
        self.sent: list[tuple[int, TickArray]] = []
        wrote = np.where(cycles.written != Done.NOT, np.arange(len(cycles)), -1)
        self._last_goal = np.append(-1, np.maximum.accumulate(wrote)[:-1])  # row of the last goal before each row
        following = cycles.index[1:][cycles.sampled[1:] != Done.NOT]
        self._last = int(cycles.index[-1])
        self._first = int(following[0]) if following.size else self._last + 1  # cycle in which following begins
        self._cycle, self._row = -1, 0  # recorded cycle that is replayed, and its row, or the last before it
        self._follows = False
        self._clock_offset = 0.0  # [s] by which the recorded clock is ahead, where cycles are skipped or repeated

    def open(self) -> None:
        """Do nothing."""

    def read(self) -> ServoStates:
        """The servo states of the next cycle, while the robot is armed."""
        self._go_on(follows=False)
        return self._servos()

    def write(self, goals: ServoGoals) -> None:
        """Keep a goal. Raises BusError where the bus failed."""
        self.sent.append((self._row if self._is_recorded else -1, goals.ticks.copy()))
        if self._is_recorded and self._cycles.written[self._row] == Done.FAILED:
            raise BusError(self._text("bus write"))

    def limit_drive(self, share: float) -> None:
        """Do nothing, because there is no drive."""

    def torque(self, on: bool) -> None:
        """Do nothing, because there is no torque."""

    def close(self) -> None:
        """Do nothing."""

    def restart(self) -> None:
        """Do nothing, because the recording has the times of ticks."""

    def gather(self, tick: int, run_state: RunState, *, approached: bool) -> TickInput:
        """The input of the next cycle, see `Inputs.gather`."""
        moves = run_state in AT_RISK
        self._go_on(follows=moves and approached)
        failed = self._cycles.read[self._row] == Done.FAILED
        failures = [Failure(StopCause.BUS, self._text("bus read"))] if failed else []
        if (self._cycle, StopCause.SOURCE.value) in self._texts:
            failures.append(Failure(StopCause.SOURCE, self._text(StopCause.SOURCE.value)))
        return TickInput(
            self.clock.now(),
            servos=None if failed else self._servos(),
            performer=self._performer(tick, approached=approached) if moves else PerformerInput(),
            operator=self._operator(),
            failures=tuple(failures),
        )

    def _go_on(self, *, follows: bool) -> None:
        """Go to the next cycle. follows: true if the robot follows from now on."""
        cycles, before = self._cycles, self._row
        self._cycle += 1
        if not self._follows and self._first <= self._last:
            self._cycle = self._first if follows else min(self._cycle, self._first - 1)
            self._follows = follows
        self._row = max(int(np.searchsorted(cycles.index, self._cycle, side="right")) - 1, 0)
        if self._cycle > 0 and cycles.index[self._row] - cycles.index[before] != 1:
            self._clock_offset += float(self._now[self._row] - self._now[before]) - self._samples.dt
        self.clock.sleep_until(float(self._now[self._row]) - self._clock_offset)

    @property
    def _is_recorded(self) -> bool:
        return int(self._cycles.index[self._row]) == self._cycle

    def _is_set(self, flag: InputFlag) -> bool:
        return bool(int(self._cycles.asked[self._row]) & flag)

    def _text(self, source: str) -> str:
        return self._texts.get((self._cycle, source), "as recorded")

    def _servos(self) -> ServoStates:
        cycles, row = self._cycles, self._row
        states = {name: getattr(cycles, name)[row].copy() for name in SERVO_FIELDS}
        moved = np.zeros_like(states["position"])  # beside where the servos were
        if self.sent and self._last_goal[row] >= 0:
            moved = self.sent[-1][1] - cycles.goal_ticks[self._last_goal[row]]
        time = float(cycles.bus_time[row]) - self._clock_offset
        retries, error_rate = int(cycles.retries[row]), float(cycles.error_rate[row])
        states["position"] += moved
        imu = None if moved.any() else imu_of(cycles, row)  # of another posture it says nothing
        if imu is not None:
            imu = replace(imu, time=imu.time - self._clock_offset)
        return ServoStates(**states, time=time, retries=retries, error_rate=error_rate, imu=imu)

    def _operator(self) -> OperatorInput:
        velocity = self._velocity()
        if not self._is_recorded:
            return OperatorInput(torque_off=self._cycle > self._last, velocity=velocity)
        stop = "stopped, as recorded" if self._is_set(InputFlag.STOP) else None
        fault = None
        if self._is_set(InputFlag.OUTSIDE):
            name, _, reason = self._text("outside").partition(": ")
            causes = [cause for cause in StopCause if cause.value == name]
            fault = causes[0] if causes else StopCause.REQUESTED, reason or "as recorded"
        return OperatorInput(stop, self._is_set(InputFlag.TORQUE_OFF), fault, velocity)

    def _velocity(self) -> Request | None:
        forward, left, _, _, _, turn = self._cycles.velocity_command[self._row].tolist()
        if isnan(forward):
            return None
        return Request(forward, left, turn) if isfinite(forward + left + turn) else Request()

    def _performer(self, tick: int, *, approached: bool) -> PerformerInput:
        samples = self._samples
        if self._is_set(InputFlag.OVER) or tick >= samples.ticks or self._cycle > self._last:
            return PerformerInput(over=True)
        paused, words = self._is_set(InputFlag.PAUSED), "as recorded"
        if not approached:
            return PerformerInput(may_go_on=self._is_set(InputFlag.APPROACH), hold_reason=words, paused=paused)
        cycles, row, sample = self._cycles, samples.rows[tick], samples.sample(tick)
        if sample is not None:
            stamps = (cycles.time_captured[row], cycles.time_arrived[row], cycles.time_shown[row])
            sample = replace(sample, times=SampleTimes(*(float(stamp) - self._clock_offset for stamp in stamps)))
        return PerformerInput(tick, sample, sample is not None, words, paused)


@dataclass(frozen=True)
class Difference:
    """Difference of a replay from its recording. compared: recorded goals (postures of a human alone). differ: those
    that are different now. first, time_s: cycle and time of the first. most, where: largest difference, in `unit`.
    absent: not sent now; extra: not recorded. machine: that of the recording, if another."""

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
        """True if all goals are the same, and none is extra."""
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


def _other_machine(recording: Recording) -> str:
    machine = recording.session.machine
    return "" if machine == machine_name() else machine


def goal_difference(recording: Recording, goals: Sequence[tuple[int, TickArray]], robot: RobotBody) -> Difference:
    """Compare goals (n,), ticks, each with the row of its cycle, -1 if it was not recorded. Goals after the end of a
    damaged recording are no difference."""
    cycles, first = recording.cycles, dict(reversed(goals))  # the first goal of each row
    wrote = np.flatnonzero(cycles.written != Done.NOT)
    sent = np.array([row for row in wrote.tolist() if row in first], dtype=np.intp)
    then, servos = cycles.goal_ticks[sent], robot.joint_map
    now = np.array([first[row] for row in sent.tolist()]).reshape(then.shape)
    off = np.abs(np.rad2deg(servos.to_radians(now) - servos.to_radians(then)), dtype=np.float64)
    return replace(
        _located(off, cycles.index[sent], servos.joints, now_of(cycles)[sent] - now_of(cycles)[0]),
        compared=len(wrote),
        ticks=int(np.abs(now - then).max(initial=0)),
        unit="degrees",
        absent=len(wrote) - len(sent),
        extra=len(goals) - len(sent) if recording.whole else 0,
        whole=recording.whole,
        machine=_other_machine(recording),
    )


def posture_difference(recording: Recording, q: FloatArray) -> Difference:
    """Compare postures (T, nq), m and rad, of a human alone, in single precision as recorded."""
    kept = recording.cycles.human_q
    recorded, names = kept[np.isfinite(kept).all(axis=1)], tuple(f"q[{column}]" for column in range(q.shape[1]))
    both = min(len(recorded), len(q))
    off = np.abs(q[:both].astype(np.float32).astype(np.float64) - recorded[:both])
    found = _located(off, np.arange(both), names, np.asarray(np.arange(both) * recording.session.dt, np.float64))
    absent, machine = len(recorded) - both, _other_machine(recording)
    return replace(found, compared=len(recorded), absent=absent, whole=recording.whole, machine=machine)


def _located(off: FloatArray, cycles: IntArray, names: tuple[str, ...], seconds: FloatArray) -> Difference:
    """The difference of numbers (T, n) with these names, in cycles (T,) at times (T,) s of the recording."""
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
    """A replayed run. difference: from the recording. changed: files and software that differ."""

    result: RunResult
    difference: Difference
    changed: tuple[str, ...]


def replay(
    recording: Recording,
    configs: Configs | None = None,
    *,
    observers: Sequence[RunObserver] = (),
    notify: Notify = lambda text: None,
) -> Replayed:
    """Run a recording again. configs: None for the recorded ones. notify: as in `prepare_for`.

    Raises RetargetError for a recording that cannot run any more; InputError for another robot or performer.
    """
    if configs is None:
        with as_recorded(recording) as then:
            return replay(recording, then, observers=observers, notify=notify)
    session, samples = recording.session, RecordedSamples(recording)
    inputs = RecordedInputs(recording, samples)

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
        clock=inputs.clock,
        make_bus=lambda robot, clock: inputs,
        end_plan=None if robot is None else session.end_plan(robot),
        notify=notify,
        robot=robot,
    ) as prepared:
        result = prepared.run(observers=observers, inputs=inputs)
    result = replace(result, notes=tuple(dict.fromkeys(result.notes)))  # those of then are mostly made again
    if robot is None:
        difference = posture_difference(recording, result.record.human_q)
    else:
        difference = goal_difference(recording, inputs.sent, robot)
    return Replayed(result, difference, (*environment_changes(session), *configs.notes))


def environment_changes(session: Session) -> tuple[str, ...]:
    """Changes of version and NumPy since the recording, in words."""
    found = (
        ("by retarget", session.version, retarget.__version__),
        ("with numpy", session.numpy, np.__version__),
    )
    return tuple(f"recorded {how} {was}, this is {now}" for how, was, now in found if was != now)


def refuse_other_robot(session: Session, robot: RobotBody) -> None:
    """Raise InputError if the robot has other servos than the recorded one."""
    allowed = f"the recorded profile of {session.robot}, which is attached to the recording"
    now, where = robot.joint_map.joints, robot.profile.name
    _refuse_others("the robot has other servos", now, session.joints, where=where, allowed=allowed)


def _refuse_others(what: str, now: tuple[str, ...], then: tuple[str, ...], *, where: str, allowed: str) -> None:
    if now != then:
        missing, added = [name for name in then if name not in now], [name for name in now if name not in then]
        parts = [f"{word} {', '.join(names)}" for word, names in (("without", missing), ("with", added)) if names]
        found = "; ".join(parts) or "another order of them"
        raise InputError(f"{what} than when it was recorded", where=where, found=found, allowed=allowed)
