"""Taps between a run and its clock, bus and samples while it is recorded: all values pass through, and are copied."""

from collections import deque
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from hardware.bus import ServoBus, ServoGoals, ServoStates
from hardware.clock import Clock
from hardware.guard_state import Stop
from retarget.frames import SensorSample
from retarget.human.samples import Clip, Samples
from retarget.recording.cycles import Asked, Boundary, Done
from retarget.recording.mcap_writer import MOST_EVENTS, Event, Level, Ring
from retarget.recording.topics import SERVO_FIELDS
from retarget.run.loop import Machine
from retarget.run.record import Record
from retarget.run.table import READINGS, STAGES
from retarget.types import FloatArray, RunState

# What the taps write into: the cycle that runs, its events, and the state of the run.

STATES_OF_RUN = {state: place for place, state in enumerate(RunState)}
"""Numbers of the states of a run."""


class Note:
    """Notes what happens in one run. ring: None before the run and after it: nothing is noted. now: s, read last.

    truth: gives the numbers (t,) of `truth_names` of a simulated body; None: not known.
    """

    def __init__(self, truth: Callable[[], FloatArray | None] = lambda: None) -> None:
        self._truth = truth
        self.ring: Ring | None = None
        self.events: deque[Event] = deque(maxlen=MOST_EVENTS)
        self.now = 0.0
        self.rows = 0
        """Rows that the pipeline kept."""
        self._boundary = Boundary(self._turn)
        self._machine: Machine | None = None
        self._stop: Stop | None = None
        self._state: RunState | None = None
        self._dt = 0.0
        self._names: tuple[str, ...] = ()  # of landmarks
        self._landmarks: list[int] = []  # which of them are asked
        self._servos: NDArray[np.int64] = np.zeros(0, dtype=np.int64)
        self._rest: NDArray[np.intp] = np.zeros(0, dtype=np.intp)

    def begin(self, ring: Ring, *, now: float, dt: float, machine: Machine | None) -> None:
        """Note everything from now on."""
        self.now, self._dt, self._machine = now, dt, machine
        if machine is not None:
            robot = machine.robot
            self._servos, self._names = robot.servo_columns, tuple(robot.profile.landmarks)
            self._rest = np.setdiff1d(np.arange(robot.body.nq), robot.servo_columns)
        ring.rows.time[ring.at] = now
        self.ring = ring

    def end(self) -> None:
        """The run has ended: finish the last cycle."""
        if self.ring is not None:
            self._turn()
            self.ring = None

    def before(self) -> None:
        """The run waits for the next tick, or asks whether to stop."""
        if self.ring is not None:
            self._boundary.before()

    def look(self) -> None:
        """The servos are read: a tick has begun."""
        if self.ring is not None:
            self._boundary.look()
            self.ring.rows.time[self.ring.at] = self.now

    def ask(self, asked: Asked) -> None:
        """Something was asked for, and answered with yes."""
        if self.ring is not None:
            self.ring.rows.asked[self.ring.at] |= int(asked)

    def stopped_outside(self, before: Stop | None) -> None:
        """The watch was asked whether to stop. before: the guard's stop before that; another one is the watch's."""
        stop = None if self._machine is None else self._machine.guard.stop
        if stop is not None and stop is not before:
            self.ask(Asked.OUTSIDE)
            self.say("outside", f"{stop.cause.value}: {stop.reason}", Level.ERROR)

    def failed(self, what: str, error: Exception) -> None:
        """The bus failed to read, write or switch torque."""
        ring = self.ring
        if ring is not None:
            done = {"read": ring.rows.read, "write": ring.rows.written}.get(what)
            if done is not None:
                done[ring.at] = Done.FAILED
        self.say(f"bus {what}", str(error), Level.ERROR)

    def say(self, who: str, text: str, level: Level = Level.INFO) -> None:
        """Log an event of this cycle."""
        if self.ring is not None:
            self.events.append(Event(self.now, self.ring.index, level, who, text))

    def kept(self, record: Record, row: int) -> None:
        """The pipeline has a row of this tick."""
        ring = self.ring
        if ring is None:
            return
        self.rows += 1
        rows, at, robot = ring.rows, ring.at, record.robot
        rows.kept[at], rows.phase[at] = True, record.phase[row]
        rows.human_q[at], rows.human_joints[at] = record.human_q[row], record.human_joints[row]
        own, modes = rows.human_observer_modes[at], record.human_observer_modes[row]
        own[: modes.size] = modes[: own.size]
        rows.cost[at] = record.cost[row]
        for name in STAGES:
            getattr(rows, name)[at] = getattr(record, name)[row]
        if robot is None:
            rows.time[at] = self.now = self.now + self._dt
            self._boundary.look()
            return
        q = robot.q[row]
        rows.q_servos[at], rows.q_rest[at] = q[self._servos], q[self._rest]
        if not self._landmarks:
            rows.landmarks_asked[:] = np.nan
            self._landmarks = [self._names.index(name) for name in robot.landmark_names]
        rows.landmarks_asked[at, self._landmarks] = robot.landmarks_asked[row]
        own, modes = rows.observer_modes[at], robot.observer_modes[row]
        own[: modes.size] = modes[: own.size]
        rows.gated[at], rows.no_command[at] = robot.gated[row], robot.no_command[row]
        if rows.truth.shape[1]:
            truth = self._truth()
            rows.truth[at] = np.nan if truth is None else truth

    def _turn(self) -> None:
        """A cycle is finished: note where the guard is, and go to the next."""
        ring, machine = self.ring, self._machine
        assert ring is not None, "nothing turns before it begins"
        if machine is not None:
            state, stop = machine.supervisor.state, machine.guard.stop
            ring.rows.state[ring.at] = STATES_OF_RUN[state]
            if stop is not self._stop and stop is not None:
                self._stop = stop
                self.say("guard", f"{stop.cause.value}: {stop.reason}", Level.ERROR)
            if state is not self._state:
                self._state = state
                self.say("run", state.value)
        ring.turn()


class TappedClock:
    """A `Clock` whose readings are noted."""

    def __init__(self, inner: Clock, note: Note) -> None:
        self.inner, self._note = inner, note

    def now(self) -> float:
        """The time in s."""
        now = self.inner.now()
        ring = self._note.ring
        if ring is not None:
            rows, at = ring.rows, ring.at
            self._note.now = now
            reading = rows.readings[at]
            if reading < READINGS:
                rows.clock[at, reading] = now
                rows.readings[at] = reading + 1
        return now

    def sleep_until(self, deadline: float) -> None:
        """Return at `deadline`, s."""
        self._note.before()
        self.inner.sleep_until(deadline)

    def idle(self) -> float:
        """The idle time in s."""
        return self.inner.idle()


class TappedBus:
    """A `ServoBus` whose servo states and goals are noted."""

    def __init__(self, inner: ServoBus, note: Note) -> None:
        self._inner, self._note = inner, note

    def open(self) -> None:
        """Open the ports."""
        self._inner.open()

    def read(self) -> ServoStates:
        """Read one cycle."""
        note = self._note
        note.look()
        try:
            states = self._inner.read()
        except Exception as error:
            note.failed("read", error)
            raise
        ring = note.ring
        if ring is not None:
            rows, at = ring.rows, ring.at
            rows.read[at] = Done.WELL
            rows.bus_time[at], rows.retries[at], rows.error_rate[at] = states.time, states.retries, states.error_rate
            for name in SERVO_FIELDS:
                getattr(rows, name)[at] = getattr(states, name)
        return states

    def write(self, goals: ServoGoals) -> None:
        """Send goal positions."""
        ring = self._note.ring
        if ring is not None:
            ring.rows.goal_ticks[ring.at] = goals.ticks
            ring.rows.written[ring.at] = Done.WELL
        try:
            self._inner.write(goals)
        except Exception as error:
            self._note.failed("write", error)
            raise

    def torque(self, on: bool) -> None:
        """Switch the torque of all servos."""
        try:
            self._inner.torque(on)
        except Exception as error:
            self._note.failed("torque", error)
            raise
        self._note.say("bus", f"torque {'on' if on else 'off'}")

    def close(self) -> None:
        """Close the ports."""
        self._inner.close()


class TappedSamples:
    """`Samples` whose followed samples are noted."""

    def __init__(self, inner: Samples, note: Note) -> None:
        self._inner, self._note = inner, note
        self.ticks, self.kept, self.dt, self.motion_dt = inner.ticks, inner.kept, inner.dt, inner.motion_dt

    @property
    def over(self) -> bool:
        """Whether the performance has ended before its last tick."""
        over = self._inner.over
        if over:
            self._note.ask(Asked.OVER)
        return over

    @property
    def settled(self) -> float:
        """How much of its speed the robot may use beyond that of its slow approach, 0 to 1."""
        settled, ring = self._inner.settled, self._note.ring
        if ring is not None:
            ring.rows.settled[ring.at] = settled
        return settled

    @property
    def hold_reason(self) -> str:
        """Why the performer is not followed."""
        return self._inner.hold_reason

    @property
    def paused(self) -> bool:
        """Whether the operator pauses the robot."""
        paused = self._inner.paused
        if paused:
            self._note.ask(Asked.PAUSED)
        return paused

    def may_approach(self) -> bool:
        """Whether the robot is to go on with its approach."""
        may = self._inner.may_approach()
        if may:
            self._note.ask(Asked.APPROACH)
        return may

    def poll(self) -> None:
        """Take in what has arrived."""
        self._inner.poll()

    def hold(self) -> None:
        """The robot holds."""
        self._inner.hold()

    def sample(self, tick: int) -> SensorSample | None:
        """The sensor sample of a tick."""
        sample, ring = self._inner.sample(tick), self._note.ring
        if ring is None:
            return sample
        rows, at = ring.rows, ring.at
        rows.tick[at], rows.settled[at] = tick, 1.0
        if sample is None:
            rows.sampled[at], rows.sensor_valid[at], rows.weighted[at] = Done.FAILED, False, False
            return None
        rows.sampled[at] = Done.WELL
        rows.sensor_position[at], rows.sensor_orientation[at] = sample.position, sample.orientation
        rows.sensor_valid[at] = sample.valid
        rows.weighted[at] = sample.weight is not None
        if sample.weight is not None:
            rows.sensor_weight[at] = sample.weight
        return sample

    def recorded(self) -> Clip:
        """The samples of the ticks that were followed."""
        return self._inner.recorded()
