"""The loop of a run: gather the input of a tick, call `retarget.run.tick.perform`, keep the row."""

import gc
from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager, suppress
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np

from hardware.clock import Clock, thread_cpu
from hardware.errors import GuardError, TorqueError
from hardware.guard import CheckedGoal, Torque, text_of
from hardware.guard_state import StopCause
from retarget.human.reconstruction import Reconstructor
from retarget.human.samples import PerformerInput, Samples
from retarget.run.controllers import RobotMotion
from retarget.run.record import Phase, Record, TickRecorder
from retarget.run.supervisor import (
    AT_RISK,
    BRAKING_OR_STANDING,
    LONGEST_BRAKE_S,
    LONGEST_STOP_S,
    End,
    Event,
    OperatorInput,
)
from retarget.run.tick import Failure, Machine, TickDone, TickInput, TickOutput, TickState, caught, look_at, perform
from retarget.types import RunState

LATE, MANY_LATE = 0.35, 0.01
"""A tick is late after this share of a period; from MANY_LATE, a share of the ticks, on a note is written."""
STOOD_S = 1.0
"""[s] A simulated robot stands so long at the end of a run."""


class Operator:
    """The source of an operator's requests; this one has none."""

    def poll(self, state: RunState | None) -> OperatorInput:
        """The requests at the beginning of a tick, without waiting. state: before the tick; None for a human alone."""
        return self.requested()

    def requested(self) -> OperatorInput:
        """The requests so far; used if `poll` fails, so that a broken control does not hide the others."""
        return OperatorInput()


@dataclass(frozen=True, eq=False)
class Tick:
    """A completed tick. row: None if no goal was sent. output: None for a human alone. tried: the goal last given to
    the bus."""

    record: Record
    row: int | None
    given: TickInput
    output: TickOutput | None = None
    tried: CheckedGoal | None = None


class RunObserver:
    """Observes a run. An exception, kept as text in `failure`, ends its calls, and the robot goes on."""

    failure = ""

    def armed(self, given: TickInput, goal: CheckedGoal) -> None:
        """Called when the robot is armed. goal: its present posture."""

    def see(self, tick: Tick) -> None:
        """Called after each tick, in the thread of the ticks."""


class RowObserver(RunObserver):
    """Calls a function with the record and the row of each tick."""

    def __init__(self, look: Callable[[Record, int], object]) -> None:
        self._look = look

    def see(self, tick: Tick) -> None:
        """Call the function, if there is a row."""
        if tick.row is not None:
            self._look(tick.record, tick.row)


class Progress(RunObserver):
    """Calls a function with the number of followed ticks, once in `every` of them."""

    def __init__(self, show: Callable[[int], object], every: int = 50) -> None:
        self._show, self._every = show, every

    def see(self, tick: Tick) -> None:
        """Count a tick in which the robot moves with the performer."""
        done = 0
        if tick.output is None and tick.row is not None:
            done = tick.row + 1
        elif tick.output is not None and tick.output.run_state in AT_RISK:
            done = tick.output.state.tick
        if done > 0 and done % self._every == 1 % self._every:
            self._show(done)


@dataclass(frozen=True, eq=False)
class Ending:
    """The end of a run. wall_s: of the followed ticks. reason: of an early stop. standing: why the robot stands, or
    ""."""

    record: Record
    wall_s: float
    state: RunState | None
    reason: str | None
    late_ticks: int = 0
    standing: str = ""

    @property
    def too_slow(self) -> tuple[str, ...]:
        """A note about a machine that misses ticks."""
        ticks = len(self.record)
        if self.late_ticks <= MANY_LATE * ticks:
            return ()
        return ("this machine is too slow or too busy: see ticks missed, and retarget doctor",)


class Inputs(Protocol):
    """The inputs of the ticks. late_ticks: ticks that began late."""

    late_ticks: int

    def restart(self) -> None:
        """Begin the ticks one period from now."""
        ...

    def gather(self, tick: int, run_state: RunState, *, approached: bool) -> TickInput:
        """Wait until the next tick is due, and gather its input, with failures. tick: of the performance; approached:
        following can begin."""
        ...


class LiveInputs:
    """Gathers inputs from the operator, the performer and the servos, in this order."""

    def __init__(self, machine: Machine, samples: Samples, operator: Operator) -> None:
        self._machine, self._samples, self._operator = machine, samples, operator
        self._due, self.late_ticks = machine.clock.now(), 0

    def restart(self) -> None:
        """Begin the ticks one period from now."""
        self._due = self._machine.clock.now()

    def gather(self, tick: int, run_state: RunState, *, approached: bool) -> TickInput:
        """Wait until the next tick is due, and gather its input."""
        self._wait()
        clock, samples, failures = self._machine.clock, self._samples, list[Failure]()
        operator, servos, performer = OperatorInput(), None, PerformerInput()
        with caught(failures, StopCause.SOURCE):
            operator = self._operator.requested()
            operator = self._operator.poll(run_state)
        with caught(failures, StopCause.SOURCE):
            samples.poll()
        with caught(failures, StopCause.BUS):
            servos = self._machine.guard.read()
        now, idle = clock.now(), clock.idle()
        if run_state in AT_RISK:
            with caught(failures, StopCause.SOURCE):
                over = samples.over or tick >= samples.ticks
                performer = PerformerInput(over=True) if over else look_at(samples, tick, approached=approached)
        return TickInput(now, idle, servos, performer, operator, tuple(failures))

    def _wait(self) -> None:
        """Wait until the next tick is due. Delays are counted and skipped, not made up for."""
        clock, dt = self._machine.clock, self._machine.dt
        due, now = self._due + dt, clock.now()
        self.late_ticks += now - due > LATE * dt
        self._due = max(due, now)
        clock.sleep_until(self._due)


def _times_of(given: TickInput, costs: tuple[float, float] | None) -> dict[str, float]:
    """Times of the stages of a tick, s. Stages take their thread CPU, so they are known on virtual time, too."""
    sample, times = given.performer.sample, {"time_used": given.now}
    if given.servos is not None:
        times["time_read"] = given.servos.time
    if sample is not None:
        at = sample.times
        times |= {"time_captured": at.captured, "time_arrived": at.arrived, "time_shown": at.shown}
    if costs is not None:
        times["time_human"] = given.now + costs[0]
        times["time_robot"] = times["time_human"] + costs[1]
    return times


class Loop:
    """One run of one robot; call `run` once."""

    def __init__(
        self,
        machine: Machine,
        samples: Samples,
        reconstructor: Reconstructor,
        operator: Operator,
        observers: Sequence[RunObserver] = (),
        inputs: Inputs | None = None,
    ) -> None:
        """inputs: None: from the samples, the operator and the bus. Raises RetargetError if the posture to approach is
        not finite."""
        self._machine, self._samples, self._observers = machine, samples, observers
        self._inputs = LiveInputs(machine, samples, operator) if inputs is None else inputs
        first = samples.sample(0)
        assert first is not None, "the first sample is valid"
        self._motion = motion = RobotMotion(
            machine.robot,
            reconstructor,
            machine.follower,
            machine.gate,
            first=first,
            dt=samples.dt,
            motion_dt=samples.motion_dt,
            goals=machine.goals,
            keyframes=machine.end_plan.keyframes,
        )
        stopping = LONGEST_BRAKE_S if machine.end_plan.end is End.BRAKED else LONGEST_STOP_S
        self._recorder = TickRecorder(
            samples,
            motion.follow.human,
            len(first.names),
            robot=machine.robot,
            posture=motion.approach.first,
            stopping=stopping,
        )
        self._first, self._now = first, machine.clock.now()
        self._state: TickState  # once it is armed

    def run(self, quiet: Callable[[], AbstractContextManager[None]] | None = None) -> Ending:
        """Run from arming to torque off. quiet: context of the ticks; None: without garbage collection, for programs
        without other threads.

        Raises GuardError or BusError if the robot cannot be armed, TorqueError if torque stayed on after an interrupt.
        """
        try:
            self._arm()
            with (quiet or _without_garbage_collection)():
                while not self._over:
                    self.tick()
            if self._machine.supervisor.over:
                self._release()
        except BaseException as error:
            self._give_up(error)
            raise
        stop, state = self._machine.guard.stop, self._machine.supervisor.state
        reason = None if stop is None else stop.reason
        return Ending(*self._recorder.finish(), state, reason, self._inputs.late_ticks, self._state.standing)

    @property
    def _over(self) -> bool:
        """True if torque may go off, or a simulated robot has stood for STOOD_S."""
        supervisor = self._machine.supervisor
        stands = supervisor.state is RunState.STANDING and not self._machine.waits
        return supervisor.over or (stands and self._now - supervisor.since >= STOOD_S)

    def tick(self) -> None:
        """One tick. An exception becomes an input, and the robot brakes, or torque goes off."""
        machine, motion, failures = self._machine, self._motion, list[Failure]()
        with caught(failures, StopCause.SOURCE):
            self._recorder.begin()
        given = self._inputs.gather(self._state.tick, machine.supervisor.state, approached=motion.approach.arrived)
        if failures:
            given = replace(given, failures=(*failures, *given.failures))
        self._now = given.now
        done = perform(machine, motion, self._state, given)
        self._state = done.output.state
        self._keep(done)

    def _keep(self, done: TickDone) -> None:
        """Fill the row, and call the observers. A failure of the row stops the robot in the next tick."""
        machine, failures, given, output = self._machine, list[Failure](), done.given, done.output
        for text in output.news:
            with caught([], StopCause.SOURCE):  # a lost terminal must not keep the robot from a stop
                machine.notify(text)
        with caught(failures, StopCause.SOURCE):
            if given.performer.tick == self._samples.kept:
                self._recorder.close()
            if output.goal is None:
                seen = Tick(self._recorder.record, None, given, output, done.tried)
                show(self._observers, lambda observer: observer.see(seen))
            else:
                self._keep_row(done)
        if output.lost:
            with caught(failures, StopCause.SOURCE):
                self._samples.hold()
        for failure in failures:
            machine.guard.latch(failure.cause, failure.reason)

    def _keep_row(self, done: TickDone) -> None:
        given, output = done.given, done.output
        motion, recorder, state = self._motion, self._recorder, output.run_state
        assert output.goal is not None
        recorder.keep_human(motion.follow.human, output.state.sample, error=output.followed is not None)
        recorder.keep_robot(
            self._machine.guard,
            output.state.commanded.q,
            output.goal,
            commanded=output.target is not None or (state in BRAKING_OR_STANDING and not given.failed),
            gated=output.gated,
            followed=output.followed,
            unexplained=None if self._machine.contact is None else self._machine.contact.unexplained,
        )
        costs = None if output.followed is None else motion.follow.costs
        recorder.keep_times(done.times | _times_of(given, costs))
        if costs is not None:
            recorder.keep_costs(*costs)
        approaches = state in AT_RISK and not motion.approach.arrived
        phase = Phase.FOLLOW if state in AT_RISK else Phase.BRAKE  # a hold belongs to what it holds up
        phase = Phase.APPROACH if approaches or state is RunState.APPROACH else phase

        def kept(record: Record, row: int) -> None:
            seen = Tick(record, row, given, output, done.tried)
            show(self._observers, lambda observer: observer.see(seen))

        recorder.keep(phase, kept, approaches=approaches)

    def _arm(self) -> None:
        """Set every goal to its present position, then switch torque on."""
        machine, now = self._machine, self._machine.clock.now
        if not machine.supervisor.take(Event.READY, now()):
            raise GuardError("a run begins once", where="run", found=machine.supervisor.state.value)
        present = machine.guard.present()
        self._look_for_imu()
        self._recorder.started(present)
        commanded = self._motion.begin(present)
        machine.guard.arm(commanded.goal)
        self._state = TickState(commanded, sample=self._first)
        performer = PerformerInput(tick=0, sample=self._first)
        given = TickInput(now(), servos=machine.guard.states, performer=performer)
        show(self._observers, lambda observer: observer.armed(given, commanded.goal))
        machine.supervisor.take(Event.ARMED, now())
        self._inputs.restart()

    def _look_for_imu(self) -> None:
        """Raise GuardError if the IMU of a robot on its soles measures nothing."""
        machine, states = self._machine, self._machine.guard.states
        if machine.tip_watch is None or states is None:
            return
        if states.imu is None:
            machine.notify("warning: this bus reads no IMU: a fall is not seen")
        elif not states.imu.valid:
            then = "Check it with `retarget doctor --tilt`, or take `imu` out of the profile"
            raise GuardError("the IMU measures nothing valid, so a fall would not be seen", where="arming", then=then)

    def _give_up(self, error: BaseException) -> None:
        """Stop and switch torque off after an error outside of a tick. Raises TorqueError if torque stays on."""
        machine = self._machine
        try:
            if machine.supervisor.torque:
                machine.guard.latch(StopCause.REQUESTED, text_of(error))
            while machine.supervisor.torque and not self._over:
                self.tick()
        finally:  # a second interrupt does not wait for the robot to stand
            if machine.guard.torque is not Torque.OFF:
                with suppress(BaseException):  # a third one must not keep back that the power is to be cut
                    machine.guard.release()
            stop = machine.guard.stop
            if stop is not None and stop.powered:
                raise TorqueError(stop.reason) from error

    def _release(self) -> None:
        """Switch torque off. A failure is latched as the reason of the stop."""
        machine = self._machine
        try:
            machine.guard.release()
        except Exception:  # noqa: BLE001 - the guard has latched it
            machine.supervisor.take(Event.TORQUE_OFF, machine.clock.now())


def show(observers: Sequence[RunObserver], look: Callable[[RunObserver], object]) -> None:
    """Call the observers that have not failed."""
    for observer in observers:
        if not observer.failure:
            failures = list[Failure]()
            with caught(failures, StopCause.SOURCE):
                look(observer)
            observer.failure = "".join(failure.reason for failure in failures)


def run_human(
    samples: Samples,
    reconstructor: Reconstructor,
    operator: Operator,
    clock: Clock,
    observers: Sequence[RunObserver] = (),
) -> Ending:
    """Run the human stage alone, a tick per period of the clock."""
    first, due = samples.sample(0), clock.now()
    assert first is not None, "the first sample is valid"
    human = reconstructor.start(first)
    recorder = TickRecorder(samples, human, len(first.names))
    for tick in range(samples.ticks):
        due = max(due + samples.dt, clock.now())
        clock.sleep_until(due)
        if tick == samples.kept:
            recorder.close()
        if stop := operator.poll(None).stop:
            return Ending(*recorder.finish(), None, stop)
        if samples.over:
            break
        recorder.begin()
        samples.poll()
        begun, sample = thread_cpu(), samples.sample(tick)
        if sample is not None and tick > 0:  # the reconstructor was started with the first sample
            human = reconstructor.step(sample, samples.motion_dt)
        recorder.keep_human(human, sample, error=True)
        recorder.keep_costs(np.nan if sample is None else thread_cpu() - begun, np.nan)
        performer = PerformerInput(tick=tick, sample=sample, may_go_on=sample is not None)
        given = TickInput(clock.now(), performer=performer)

        def done(record: Record, row: int, given: TickInput = given) -> None:
            show(observers, lambda observer: observer.see(Tick(record, row, given)))

        recorder.keep(Phase.FOLLOW, done)
    return Ending(*recorder.finish(), None, None)


@contextmanager
def _without_garbage_collection() -> Iterator[None]:
    """Disable garbage collection; the ticks make no cycles."""
    was_on = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if was_on:
            gc.enable()
