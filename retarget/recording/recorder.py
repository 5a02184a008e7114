"""`retarget run --record`: records a run in progress. The tick copies rows, and a thread writes them."""

import sys
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from hardware.clock import Clock, MonotonicClock, VirtualClock, wall_to_monotonic
from hardware.guard import CheckedGoal, Torque
from hardware.guard_state import Stop, StopCause
from retarget.human.reconstruction import Reconstructor
from retarget.model.human_dimensions import POINTS
from retarget.recording.cycles import STATES_OF_RUN, Done, InputFlag
from retarget.recording.mcap_writer import (
    MOST_EVENTS,
    OPTION,
    LogEvent,
    LogLevel,
    RecordingFile,
    Ring,
    WritingThread,
    check_target,
)
from retarget.recording.session import config_files, session_of
from retarget.recording.topics import SERVO_FIELDS, Topic, topics
from retarget.run.loop import RunObserver, Tick
from retarget.run.options import RunOptions
from retarget.run.prepare import Prepared
from retarget.run.record import Record, keep_imu
from retarget.run.run_result import truth_names
from retarget.run.table import STAGES, RunTable, Widths
from retarget.run.tick import Machine, TickInput
from retarget.schema.files import refuse_existing, remove
from retarget.types import FloatArray, Notify, RunState

COPIED = ("phase", "gated", "no_command", "cost", *STAGES, "human_q", "human_joints")
"""Fields that are copied from the record of the run."""
MODES = ("human_observer_modes", "observer_modes")
"""Fields whose widths may differ between record and recording."""
SWITCH_S = 1e-3
"""Longest time, s, that a due tick waits for the interpreter while the thread encodes; the default is 5 ms."""


class CycleObserver(RunObserver):
    """Fills a row of a ring in each cycle of a run: the arming of a robot, and each tick.

    ring: None outside the run. rows: number of copied record rows.
    """

    def __init__(self, truth: Callable[[], FloatArray | None], warn: Callable[[], object]) -> None:
        """truth: returns the numbers (t,) of `truth_names` of a simulated body, or None. warn: called in every tick."""
        self._truth, self._warn = truth, warn
        self.ring: Ring | None = None
        self.events: deque[LogEvent] = deque(maxlen=MOST_EVENTS)
        self.rows = 0
        self._now = 0.0  # [s] of the present cycle
        self._machine: Machine | None = None
        self._logged: tuple[Stop | None, Torque, RunState] = (None, Torque.OFF, RunState.IDLE)

    def begin(self, ring: Ring, machine: Machine | None, *, now: float) -> None:
        """Record every cycle from now on. machine: None for a human alone."""
        ring.rows.landmarks_asked[:] = np.nan
        self.ring, self._machine, self._now = ring, machine, now

    def end(self) -> None:
        """End the recording of cycles."""
        if self._machine is not None:
            self._log_changes(self._machine)
        self.ring = None

    def log(self, source: str, text: str, level: LogLevel = LogLevel.INFO) -> None:
        """Log an event of this cycle."""
        if self.ring is not None:
            self.events.append(LogEvent(self._now, self.ring.index, level, source, text))

    def armed(self, given: TickInput, goal: CheckedGoal) -> None:
        """Fill the row of the arming."""
        self._fill(given, goal)

    def see(self, tick: Tick) -> None:
        """Fill the row of a tick."""
        self._warn()
        self._fill(tick.given, tick.tried, tick)

    def _fill(self, given: TickInput, goal: CheckedGoal | None, tick: Tick | None = None) -> None:
        ring, machine = self.ring, self._machine
        if ring is None:
            return
        rows, at, operator, performer, servos = ring.rows, ring.at, given.operator, given.performer, given.servos
        # The input.
        self._now = rows.time[at] = given.now
        rows.clock[at, :2], rows.readings[at] = given.now, 2
        flags = {
            InputFlag.STOP: operator.stop is not None,
            InputFlag.TORQUE_OFF: operator.torque_off,
            InputFlag.OVER: performer.over,
            InputFlag.PAUSED: performer.paused,
            InputFlag.APPROACH: performer.may_go_on and performer.tick is None,
            InputFlag.OUTSIDE: operator.fault is not None,
        }
        rows.asked[at] = sum(flag for flag, is_so in flags.items() if is_so)
        if (stick := operator.velocity) is not None:
            rows.velocity_command[at] = stick.forward, stick.left, 0.0, 0.0, 0.0, stick.turn
        if servos is not None:
            rows.read[at] = Done.WELL
            rows.bus_time[at], rows.retries[at], rows.error_rate[at] = servos.time, servos.retries, servos.error_rate
            for name in SERVO_FIELDS:
                getattr(rows, name)[at] = getattr(servos, name)
            keep_imu(rows, at, servos.imu)
        if performer.tick is not None:
            rows.tick[at], sample = performer.tick, performer.sample
            rows.sampled[at] = Done.FAILED if sample is None else Done.WELL
            if sample is not None:
                rows.sensor_position[at], rows.sensor_orientation[at] = sample.position, sample.orientation
                rows.sensor_valid[at] = sample.valid
        for failure in given.failures:
            source = failure.cause.value
            if servos is None and failure.cause is not StopCause.SOURCE:
                source, rows.read[at] = "bus read", Done.FAILED
            elif failure.cause is StopCause.BUS:
                source = "bus write"
            self.log(source, failure.reason, LogLevel.ERROR)
        if operator.fault is not None:
            cause, reason = operator.fault
            self.log("outside", f"{cause.value}: {reason}", LogLevel.ERROR)
        # The goal that was given to the bus, the row of the record, and where the run is.
        if goal is not None and machine is not None:
            rows.goal_ticks[at] = machine.guard.ticks_of(goal)
            rows.written[at] = Done.WELL if goal is machine.guard.goal else Done.FAILED
        if tick is not None and tick.row is not None:
            self._keep_row(rows, at, tick.record, tick.row)
        if machine is not None:
            rows.state[at] = STATES_OF_RUN[machine.supervisor.state]
            self._log_changes(machine)
        ring.turn()

    def _log_changes(self, machine: Machine) -> None:
        stop, torque, state = machine.guard.stop, machine.guard.torque, machine.supervisor.state
        if stop is not None and stop is not self._logged[0]:
            self.log("guard", f"{stop.cause.value}: {stop.reason}", LogLevel.ERROR)
        if torque is not self._logged[1]:
            self.log("bus", f"torque {torque.value}")
        if state is not self._logged[2]:
            held = f": {machine.supervisor.hold_reason}" if state is RunState.HOLD else ""
            self.log("run", state.value + held)
        self._logged = (stop, torque, state)

    def _keep_row(self, rows: RunTable, at: int, record: Record, row: int) -> None:
        self.rows += 1
        rows.kept[at] = True
        for name in COPIED:
            getattr(rows, name)[at] = getattr(record, name)[row]
        for name in MODES:
            own, modes = getattr(rows, name)[at], getattr(record, name)[row]
            own[: modes.size] = modes[: own.size]
        if self._machine is None or record.robot is None:
            return
        rows.unexplained[at] = record.unexplained[row]
        robot, body = record.robot, self._machine.robot
        q, names = robot.q[row], tuple(body.profile.landmarks)
        rows.q_servos[at], rows.q_rest[at] = q[body.servo_columns], np.delete(q, body.servo_columns)
        rows.landmarks_asked[at, [names.index(name) for name in robot.landmark_names]] = robot.landmarks_asked[row]
        if rows.truth.shape[1]:
            truth = self._truth()
            rows.truth[at] = np.nan if truth is None else truth


class Recorder:
    """Records one run. path: None for no recording.

    clock: of the run; a virtual clock lets the run wait for the disk. notify: receives failures of the recording.
    observer: to be given to the run.
    """

    def __init__(
        self,
        path: Path | None,
        options: RunOptions,
        *,
        clock: Clock,
        notify: Notify,
        overwrite: bool = False,
        truth: Callable[[], FloatArray | None] = lambda: None,
    ) -> None:
        """overwrite: an existing file is removed when the recording begins. truth: numbers of a simulated body.

        Raises UsageError for an unusable or occupied place, or without the library.
        """
        if path is not None:
            check_target(path)
            if not overwrite:
                refuse_existing(path, option=OPTION)
        self._overwrite = overwrite
        self._path, self._options, self._notify = path, options, notify
        self._clock = clock
        self._thread: WritingThread | None = None
        self._warned = ""
        self.observer = CycleObserver(truth, self._warn_of_failure)

    @property
    def failure(self) -> str:
        """Reason why the recording is not whole, or ""."""
        if self._thread is None:
            return ""
        lost = self._ring.lost
        missing = f"the disk was too slow: {lost} ticks are missing" if lost else ""
        return self._thread.failure or self.observer.failure or missing

    @property
    def cpu_s(self) -> float:
        """CPU time of the writing thread, s."""
        return 0.0 if self._thread is None else self._thread.cpu_s

    def recorded_notify(self, notify: Notify) -> Notify:
        """A `notify` that also records each message."""

        def record_and_notify(text: str) -> None:
            self.observer.log("run", text)
            notify(text)

        return record_and_notify

    def code(self, code: int) -> int:
        """The exit code of a run that ended with `code`: 1 at least if the recording is not whole."""
        return max(code, 1) if self.failure else code

    @contextmanager
    def recording(self, prepared: Prepared, *, source: str) -> Iterator[Prepared]:
        """Record the cycles that `observer` sees in the context. Raises UsageError if the file cannot be made."""
        if self._path is None:
            yield prepared
            return
        started = self._clock.now()
        begun_ns = round(MonotonicClock().now() * 1e9) - wall_to_monotonic()
        session = session_of(prepared, self._options, source=source, begun_ns=begun_ns)
        robot = None if prepared.machine is None else prepared.machine.robot
        if self._overwrite:
            remove(self._path, option=OPTION)
        file = RecordingFile(self._path, session, config_files(self._options, robot))
        shape, messages = _layout(prepared, simulated=self._options.has_physics)
        file.announce(messages)
        ring = Ring(shape, patient=isinstance(self._clock, VirtualClock))
        observer = self.observer
        thread = WritingThread(
            file, ring, observer.events, messages, lambda time: begun_ns + round((time - started) * 1e9)
        )
        observer.begin(ring, prepared.machine, now=started)
        self._thread, self._ring = thread, ring
        thread.start()
        switching = sys.getswitchinterval()
        sys.setswitchinterval(SWITCH_S)
        try:
            yield prepared
        finally:
            sys.setswitchinterval(switching)
            observer.end()
            thread.close()
            if not observer.rows:
                file.discard()  # it was refused, or stopped, before it made a tick
            elif self.failure != self._warned:
                self._warned = ""
                self._warn_of_failure()

    def _warn_of_failure(self) -> None:
        """Report a failure once during the run, and a new one after it."""
        if self._warned:
            return
        self._warned = self.failure
        if self._warned:
            self._notify(f"warning: the recording is not whole, the robot goes on: {self._path}: {self._warned}")


def _layout(prepared: Prepared, *, simulated: bool) -> tuple[Widths, list[Topic]]:
    robot, observers = None if prepared.machine is None else prepared.machine.robot, prepared.observers
    own = prepared.reconstructor.observers if isinstance(prepared.reconstructor, Reconstructor) else None
    names: dict[str, tuple[str, ...]] = {"sensors": tuple(prepared.performer.sensors), "joints": POINTS}
    names["human_observers"] = () if own is None else own.names
    widths = {"human": prepared.human.body.nq}
    if robot is not None:
        names |= {"servos": robot.joint_map.joints, "landmarks": tuple(robot.profile.landmarks)}
        names["observers"] = () if observers is None else observers.names
        names["truth"] = truth_names(robot.body) if simulated else ()
        widths["rest"] = robot.body.nq - len(robot.joint_map)
    widths |= {word: len(known) for word, known in names.items()}
    return widths, topics(widths, names, dt=prepared.samples.dt, robot=robot)
