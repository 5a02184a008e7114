"""The loop of a run. `Loop.tick` is the whole of a tick: read, decide the state, find a target, check it, write it."""

import gc
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field

import numpy as np

from hardware.clock import Clock, thread_cpu
from hardware.errors import BusError, GuardError, TorqueError
from hardware.guard import CheckedGoal, Guard, Torque, text_of
from hardware.guard_state import StopCause
from retarget.frames import SensorSample
from retarget.human.reconstruction import Reconstructor
from retarget.human.samples import Samples
from retarget.model.observers import robot_observers
from retarget.model.robot import RobotBody
from retarget.robot.follower import Follower
from retarget.run.controllers import RobotMotion, Target, rest_joints
from retarget.run.record import Phase, Record, TickRecorder
from retarget.run.rest_trajectory import EndPlan
from retarget.run.supervisor import (
    AT_RISK,
    LONGEST_BRAKE_S,
    LONGEST_STOP_S,
    End,
    Event,
    Situation,
    Supervisor,
)
from retarget.safety.gate import Gate
from retarget.types import FloatArray, Notify, RunState

INTERRUPTED = "interrupted by the user"
FORCED_STOP = "torque off before the robot stood, forced by the user"
LATE, MANY_LATE = 0.35, 0.01
"""A tick is late that begins so many periods after it is due; from this share of late ticks on, a note says so."""
TO_REST = (RunState.RETURN_TO_STANCE, RunState.GO_TO_REST)
"""States in which the robot brakes and waits while the bus is silent."""
STOOD_S = 1.0
"""Time, s, that a simulated robot stands at the end of a run, to be seen standing."""
STANDS = "the run ends standing, with torque: {}"
NEAR_REST = 0.2
"""A robot is at rest when no joint is farther than this from posture `rest`, rad."""


class ObserverCallback:
    """Passes every row of a record to `look`, until that raises. failure: the exception as text, else ""."""

    def __init__(self, look: Callable[[Record, int], object]) -> None:
        self._look = look
        self.failure = ""

    def __call__(self, record: Record, row: int) -> None:
        """Pass a row that was filled."""
        if not self.failure:
            try:
                self._look(record, row)
            except Exception as error:  # noqa: BLE001 - an observer must not stop a robot
                self.failure = f"{type(error).__name__}: {error}"


@dataclass(frozen=True)
class Watch:
    """The operator of a run, and those who look on.

    on_tick: receives the number of ticks done, once in `every` ticks. stop_asked: whether to stop, asked in every tick
    until the robot stops. torque_off_asked: whether torque is to go off at once, asked in every tick from then on. why:
    who asked for the stop. on_row: receives the record and the row that was just filled.
    """

    on_tick: Callable[[int], object] = lambda done: None
    stop_asked: Callable[[], bool] = lambda: False
    torque_off_asked: Callable[[], bool] = lambda: False
    why: Callable[[], str] = lambda: INTERRUPTED
    on_row: Callable[[Record, int], object] = lambda record, row: None
    every: int = 50


@dataclass(frozen=True, eq=False)
class Ending:
    """The end of a run. wall_s: of the ticks that followed. state: of the supervisor, None without a robot; reason: why
    it stopped early. late_ticks: ticks that began late. standing: why the robot stood at the end, "" where it did
    not."""

    record: Record
    wall_s: float
    state: RunState | None
    reason: str | None
    late_ticks: int = 0
    standing: str = ""

    @property
    def too_slow(self) -> tuple[str, ...]:
        """A note about a machine that misses ticks; the report counts them."""
        ticks = len(self.record)
        if self.late_ticks <= MANY_LATE * ticks:
            return ()
        return ("this machine is too slow or too busy: see ticks missed, and retarget doctor",)


@dataclass(frozen=True, eq=False)
class Machine:
    """A robot that can run. waits: a robot that stands at the end waits for the operator to switch its torque off.
    notify: receives warnings about servos, a sentence each. goals (T, n): rad, recorded ones that are sent instead of
    following."""

    robot: RobotBody
    follower: Follower
    gate: Gate
    guard: Guard
    supervisor: Supervisor
    clock: Clock
    dt: float
    end_plan: EndPlan = field(default_factory=EndPlan)
    waits: bool = True
    notify: Notify = lambda text: None
    goals: FloatArray | None = None

    def not_at_rest(self, standing: str) -> tuple[str, ...]:
        """A note about a robot on its soles whose run did not end at rest, though nothing was wrong with it. standing:
        why it stood at the end, "" where it did not."""
        states, robot, state = self.guard.states, self.robot, self.supervisor.state
        if standing:
            until = ", until the operator switched torque off" if state is RunState.OFF else ""
            return (f"it ended standing, with torque{until}: {standing}",)
        if states is None or state is not RunState.OFF or self.end_plan.end is End.BRAKED or not robot.stands:
            return ()
        off = np.abs(robot.joint_map.to_radians(states.position) - rest_joints(robot))
        off[self.guard.health.lost] = 0.0
        worst = int(off.argmax())
        if off[worst] <= NEAR_REST:
            return ()
        return (f"not at rest: torque went off with {robot.joint_map.joints[worst]} {off[worst]:.2f} rad from it",)

    @property
    def refused(self) -> str:
        """What was in the way of the goal that the gate checked last, in words; "" where it passed."""
        clearance = self.gate.clearance
        way = "" if clearance is None else clearance.in_the_way(robot_observers(self.robot).names)
        return f"the gate refused goals that bring {way} too near to each other" if way else ""

    def tell(self, text: str) -> None:
        """Pass a sentence to the operator; a lost terminal must not keep the robot from a stop."""
        with suppress(Exception):
            self.notify(text)


class Loop:
    """One run of one robot; call `run` once. `tick` is the whole of a tick."""

    def __init__(self, machine: Machine, samples: Samples, reconstructor: Reconstructor, watch: Watch) -> None:
        """Raises RetargetError where the posture to approach is not known."""
        self._machine, self._samples, self._watch = machine, samples, watch
        first = samples.sample(0)
        assert first is not None, "the first sample is valid"
        self._motion = motion = RobotMotion(
            machine.robot,
            reconstructor,
            machine.follower,
            machine.gate,
            first=first,
            pace=samples,
            goals=machine.goals,
            keyframes=machine.end_plan.keyframes,
        )
        stopping = LONGEST_BRAKE_S if machine.end_plan.end is End.BRAKED else LONGEST_STOP_S
        self._recorder = TickRecorder(
            samples,
            motion.follow.human,
            len(first.names),
            watch.on_row,
            robot=machine.robot,
            posture=motion.approach.first,
            stopping=stopping,
        )
        self._sample: SensorSample | None = first
        self._tick = 0  # of the performance
        self._due, self._late_ticks = machine.clock.now(), 0
        self._refused = ""  # why goals on the way to rest were refused
        self._standing = ""  # why the robot stands at the end
        self._part = StopCause.SOURCE  # what runs now: the cause of a stop if it fails

    def run(self) -> Ending:
        """Run from arming to torque off.

        Raises GuardError or BusError where the robot cannot be armed, TorqueError where torque could not be switched
        off after an interrupt.
        """
        try:
            self._arm()
            with _without_garbage_collection():
                while not self._over:
                    self.tick()
            if self._machine.supervisor.over:
                self._release()
        except BaseException as error:
            self._give_up(error)
            raise
        stop, state = self._machine.guard.stop, self._machine.supervisor.state
        with suppress(Exception):  # who looks on must not lose the run
            self._watch.on_tick(self._samples.ticks)
        reason = None if stop is None else stop.reason
        return Ending(*self._recorder.finish(), state, reason, self._late_ticks, self._standing)

    @property
    def _over(self) -> bool:
        """True if the run is over: torque may go off, or a simulated robot has stood for a moment."""
        supervisor, clock = self._machine.supervisor, self._machine.clock
        stands = supervisor.state is RunState.STANDING and not self._machine.waits
        return supervisor.over or (stands and clock.now() - supervisor.since >= STOOD_S)

    def tick(self) -> None:
        """One tick. An exception anywhere in it becomes a transition, and the robot brakes, or torque goes off."""
        self._wait()
        guard, supervisor = self._machine.guard, self._machine.supervisor
        written = guard.goal
        for attempt in (self._run_tick, self._brake):
            try:
                attempt()
                return
            except Exception as error:  # noqa: BLE001 - nothing that fails in a tick may leave the robot moving
                self._fail(error, may_brake=attempt == self._run_tick or guard.goal is not written)
                self._tell_standing()
            if supervisor.over or guard.goal is not written:  # a second goal in a tick would double its step
                return

    def _run_tick(self) -> None:
        machine, motion = self._machine, self._motion
        with self._looking():
            self._recorder.begin()
        asked = self._ask_operator()
        with self._looking():
            self._samples.poll()
        self._read()
        state = self._change_state(asked)
        if machine.supervisor.over:
            return
        wanted = self._target(state)
        self._part = StopCause.FILTER
        goal, target = motion.check(state, wanted)
        if state is RunState.GO_TO_REST and target is not None and not goal.passed:
            self._tell_refused()
        self._write(goal, target)
        self._keep(state, goal, target, gated=wanted is not None and not (goal.passed and target is wanted))
        with self._looking():
            if state in AT_RISK and self._tick > 0 and self._tick % self._watch.every == 1 % self._watch.every:
                self._watch.on_tick(self._tick)

    def _target(self, state: RunState) -> Target | None:
        """What the controller of a state asks for; None: brake, or stand."""
        machine, motion = self._machine, self._motion
        if state in TO_REST and machine.guard.is_silent:  # goals that no servo hears would come as one step
            return motion.brake(state)
        if state is RunState.RETURN_TO_STANCE or state in AT_RISK:
            machine.follower.set_contact_state(None if machine.guard.states is None else machine.guard.states.soles)
        return motion.target(state, self._sample, speed_override=machine.guard.health.warnings.speed_override)

    def _tell_refused(self) -> None:
        """Say once that the robot holds on its way to rest, and why."""
        before, self._refused = self._refused, self._machine.refused or "the gate refuses the goal"
        if not before:
            self._machine.tell(f"on its way to rest the robot holds, and tries again: {self._refused}")

    def _tell_standing(self) -> None:
        """Notify the operator once that the run ends with a robot that stands, and why."""
        machine = self._machine
        if machine.supervisor.state is not RunState.STANDING or self._standing:
            return
        stop = machine.guard.stop
        failed = "" if stop is None else stop.reason
        why = machine.end_plan.why or f"it did not get to rest: {self._refused or failed}"
        self._standing = why
        machine.tell(STANDS.format(why))

    @contextmanager
    def _looking(self) -> Iterator[None]:
        """Who only looks at a run, or asks for its stop, may fail in every tick: that stops the robot, and does not
        hinder the stop."""
        try:
            yield
        except Exception as error:  # noqa: BLE001 - whatever it is
            self._machine.guard.latch(StopCause.SOURCE, text_of(error))

    def _brake(self) -> None:
        """Go on braking in a tick that has failed."""
        machine, last = self._machine, self._machine.guard.goal
        assert last is not None, "the robot was armed"
        self._part = StopCause.FILTER
        goal = machine.gate.brake(last)
        self._write(goal, None)
        self._keep(machine.supervisor.state, goal, None, gated=False)

    def _fail(self, error: Exception, *, may_brake: bool) -> None:
        """A tick has failed. Without the bus no robot brakes; only a BusError is a failure of the bus."""
        machine, cause = self._machine, self._part
        if not isinstance(error, BusError):
            cause = StopCause.FILTER if cause is StopCause.BUS else cause
        may_brake = may_brake and cause is not StopCause.BUS
        supervisor, now, before = machine.supervisor, machine.clock.now(), machine.supervisor.state
        supervisor.fail(now, text_of(error), cause, machine.guard, may_brake=may_brake)
        if supervisor.state is before:  # a stop that goes on failing has its limits, too
            supervisor.step(now, self._situation(), machine.guard)

    # The steps of a tick.

    def _wait(self) -> None:
        """Wait until the next tick is due. What is late is skipped and counted: it is not made up for."""
        clock, dt = self._machine.clock, self._machine.dt
        due, now = self._due + dt, clock.now()
        self._late_ticks += now - due > LATE * dt
        self._due = max(due, now)
        clock.sleep_until(self._due)

    def _ask_operator(self) -> Situation:
        """What is the case at the beginning of a tick, with what the operator asks for."""
        watch, situation = self._watch, self._situation()
        with self._looking():
            if self._machine.supervisor.state in AT_RISK:
                situation.stop = watch.why() if watch.stop_asked() else None
            elif self._machine.supervisor.state is RunState.STANDING:
                situation.released = watch.torque_off_asked()
            else:
                situation.torque_off = FORCED_STOP if watch.torque_off_asked() else None
        return situation

    def _situation(self) -> Situation:
        """What the robot has done so far."""
        motion = self._motion
        return Situation(
            approached=motion.approach.arrived,
            arrived=motion.has_arrived(self._machine.supervisor.state),
            stands=motion.stands,
            straight=motion.on_approach,
            end=self._machine.end_plan.end,
        )

    def _read(self) -> None:
        """Read the servos, and pass on what they report."""
        machine = self._machine
        self._part = StopCause.BUS
        states = machine.guard.read()
        self._part = StopCause.SOURCE
        if machine.gate.clearance is not None:
            position = machine.robot.joint_map.to_radians(states.position)
            machine.gate.clearance.measure(position, self._motion.commanded.joints)
        with self._looking():
            for text in machine.guard.health.warnings.take_news():
                machine.tell(text)

    def _change_state(self, situation: Situation) -> RunState:
        """Let the supervisor choose the state of this tick."""
        machine = self._machine
        if machine.supervisor.state in AT_RISK:
            with self._looking():
                self._look_at_performer(situation)
        state = machine.supervisor.step(machine.clock.now(), situation, machine.guard)
        self._tell_standing()
        return state

    def _look_at_performer(self, situation: Situation) -> None:
        """Take the sample of this tick, and see whether the performer can be followed."""
        samples, motion, machine = self._samples, self._motion, self._machine
        if samples.over or self._tick >= samples.ticks:
            situation.over = True
            return
        if motion.approach.arrived and self._tick == samples.kept:
            self._recorder.close()
        sample, situation.hold_reason = motion.look_at(
            samples, self._tick, machine.supervisor.state, bus_is_silent=machine.guard.is_silent
        )
        if motion.approach.arrived:
            self._sample = sample
            self._tick += 1
        situation.paused = samples.paused
        situation.followable = not situation.hold_reason

    def _write(self, goal: CheckedGoal, target: Target | None) -> None:
        """Write a goal, and take over where the robot was commanded to."""
        self._part = StopCause.BUS
        self._machine.guard.write(goal)
        self._part = StopCause.SOURCE
        self._motion.sent(goal, target)

    def _keep(self, state: RunState, goal: CheckedGoal, target: Target | None, *, gated: bool) -> None:
        """Fill the row of this tick, and show it to who looks on. gated: the gate refused what was asked."""
        guard, motion, recorder = self._machine.guard, self._motion, self._recorder
        with self._looking():
            follow = motion.follow
            followed = follow.posture if state is RunState.FOLLOW else None
            recorder.keep_human(follow.human, self._sample, error=followed is not None)
            asked = target is not None
            recorder.keep_robot(guard, motion.commanded.q, goal, asked=asked, gated=gated, followed=followed)
            if followed is not None:
                recorder.keep_costs(*follow.costs)
            approaches = state in AT_RISK and not motion.approach.arrived
            phase = Phase.FOLLOW if state in AT_RISK else Phase.BRAKE  # a hold belongs to what it holds up
            phase = Phase.APPROACH if approaches or state is RunState.APPROACH else phase
            recorder.keep(phase, approaches=approaches)

    # The beginning and the end of a run.

    def _arm(self) -> None:
        """Set every goal to its present position, then switch torque on."""
        machine, now = self._machine, self._machine.clock.now
        if not machine.supervisor.take(Event.READY, now()):
            raise GuardError("a run begins once", where="run", found=machine.supervisor.state.value)
        present = machine.guard.present()
        self._recorder.started(present)
        machine.guard.arm(self._motion.begin(present))
        machine.supervisor.take(Event.ARMED, now())
        self._due = now()

    def _give_up(self, error: BaseException) -> None:
        """Stop and switch torque off after an interrupt or an error outside of a tick. Raises TorqueError from it where
        torque could not be switched off."""
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
        """Switch torque off. A failure is latched, and is the reason of the stop."""
        machine = self._machine
        try:
            machine.guard.release()
        except Exception:  # noqa: BLE001 - the guard has latched it
            machine.supervisor.take(Event.TORQUE_OFF, machine.clock.now())


def run_human(samples: Samples, reconstructor: Reconstructor, watch: Watch) -> Ending:
    """Run samples through the first stage alone, where there is no robot."""
    first = samples.sample(0)
    assert first is not None, "the first sample is valid"
    human = reconstructor.start(first)
    recorder = TickRecorder(samples, human, len(first.names), watch.on_row)
    for tick in range(samples.ticks):
        if tick == samples.kept:
            recorder.close()
        if watch.stop_asked():
            return Ending(*recorder.finish(), None, watch.why())
        if samples.over:
            break
        recorder.begin()
        samples.poll()
        begun, sample = thread_cpu(), samples.sample(tick)
        if sample is not None and tick > 0:  # the reconstructor was started with the first sample
            human = reconstructor.step(sample, samples.motion_dt)
        recorder.keep_human(human, sample, error=True)
        recorder.keep_costs(np.nan if sample is None else thread_cpu() - begun, np.nan)
        recorder.keep(Phase.FOLLOW)
        if tick % watch.every == 0:
            watch.on_tick(tick + 1)
    watch.on_tick(samples.ticks)
    return Ending(*recorder.finish(), None, None)


@contextmanager
def _without_garbage_collection() -> Iterator[None]:
    """Keep the garbage collector out of the ticks: nothing in them makes cycles."""
    was_on = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if was_on:
            gc.enable()
