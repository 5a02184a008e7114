"""A tick of a run as a function of its input and state.

`step` lets the supervisor choose the state, finds a target and checks it. It reads no clock, bus or stream. `perform`
calls it, brakes after an exception, and writes the goal through the guard. The loop, `retarget.Pipeline` and replay
gather a `TickInput` and call `perform`.
"""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from hardware.bus import ServoStates
from hardware.clock import Clock, thread_cpu
from hardware.errors import BusError
from hardware.guard import CheckedGoal, Guard, text_of
from hardware.guard_state import StopCause
from retarget.frames import SensorSample
from retarget.human.samples import PerformerInput, Performing
from retarget.model.observers import robot_observers
from retarget.model.robot import RobotBody
from retarget.robot.follower import Follower
from retarget.run.controllers import Commanded, GoalsInstead, RobotMotion, Target, rest_joints
from retarget.run.rest_trajectory import EndPlan
from retarget.run.run_result import RefusedPair
from retarget.run.supervisor import AT_RISK, BUS_SILENT, End, OperatorInput, Situation, Supervisor
from retarget.safety.contact import ContactDetector
from retarget.safety.gate import Gate
from retarget.safety.tipping import TipWatch
from retarget.types import Notify, RobotPosture, RunState

TO_REST = (RunState.RETURN_TO_STANCE, RunState.GO_TO_REST)
"""States in which the robot brakes and waits while the bus is silent."""
HOLDS_BEFORE_REST = "while it goes to rest the robot holds, and tries again: {}"
NOT_FOLLOWABLE = "the performer could not be followed ({})"  # a hold reason
NEAR_REST = 0.2  # [rad] largest distance of a joint from posture `rest`


@dataclass(frozen=True)
class Failure:
    """An exception in a tick. cause: of the stop."""

    cause: StopCause
    reason: str


@contextmanager
def caught(failures: list[Failure], cause: StopCause) -> Iterator[None]:
    """Append exceptions to `failures`. Only a BusError is a failure of the bus: after any other the robot can still
    brake."""
    try:
        yield
    except Exception as error:  # noqa: BLE001 - nothing that fails in a tick may leave the robot moving
        if cause is StopCause.BUS and not isinstance(error, BusError):
            cause = StopCause.FILTER
        failures.append(Failure(cause, text_of(error)))


@dataclass(frozen=True, eq=False)
class TickInput:
    """The input of a tick. now: s, run clock; idle: s, see `Clock.idle`. servos: None if not read."""

    now: float
    idle: float = 0.0
    servos: ServoStates | None = None
    performer: PerformerInput = field(default_factory=PerformerInput)
    operator: OperatorInput = field(default_factory=OperatorInput)
    failures: tuple[Failure, ...] = ()

    @property
    def failed(self) -> bool:
        """True if the tick is to brake. A failing stop source or observer only requests a stop."""
        return any(failure.cause is not StopCause.SOURCE for failure in self.failures)


@dataclass(frozen=True, eq=False)
class TickState:
    """The state between ticks. tick: the next of the performance. sample: that of the last tick, None in a
    hold; at first the one to approach. refused: why goals to rest were refused; standing: why the robot stands at the
    end."""

    commanded: Commanded
    tick: int = 0
    sample: SensorSample | None = None
    refused: str = ""
    standing: str = ""


@dataclass(frozen=True, eq=False)
class TickOutput:
    """The result of a tick. goal: to be written, None once torque is off. gated: the gate changed the goal. followed:
    the robot's posture for the performer. lost: no posture was found. news: messages."""

    state: TickState
    run_state: RunState
    goal: CheckedGoal | None = None
    target: Target | None = None
    gated: bool = False
    followed: RobotPosture | None = None
    lost: bool = False
    news: tuple[str, ...] = ()


@dataclass(frozen=True, eq=False)
class Machine:
    """A robot that can run. waits: at the end it stands until the operator switches torque off. goals: replace
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
    goals: GoalsInstead | None = None
    contact: ContactDetector | None = None
    tip_watch: TipWatch | None = None

    def not_at_rest(self) -> tuple[str, ...]:
        """A note about a robot on its soles without torque elsewhere than at rest, though it had no fault."""
        states, robot, state = self.guard.states, self.robot, self.supervisor.state
        if states is None or state is not RunState.OFF or self.end_plan.end is End.BRAKED or not robot.stands:
            return ()
        off = np.abs(robot.joint_map.to_radians(states.position) - rest_joints(robot))
        off[self.guard.health.lost] = 0.0
        worst = int(off.argmax())
        if off[worst] <= NEAR_REST:
            return ()
        return (f"not at rest: torque went off with {robot.joint_map.joints[worst]} {off[worst]:.2f} rad from it",)

    @property
    def refused_pair(self) -> RefusedPair | None:
        """The pair with most refusals."""
        clearance = self.gate.clearance
        if clearance is None or not clearance.refusals:
            return None
        (pair, ticks), *_ = clearance.refusals.most_common(1)
        links = [self.robot.body.body_names[link] for link in robot_observers(self.robot).links]
        return RefusedPair(*clearance.names_of(pair, links), ticks, pair[1] is None)

    @property
    def refused(self) -> str:
        """The refusal of the last goal in words, or ""."""
        clearance = self.gate.clearance
        pair = "" if clearance is None else clearance.limiting_pair(robot_observers(self.robot).names)
        return f"the gate refused goals that bring {pair} too near to each other" if pair else ""


def look_at(performer: Performing, tick: int, *, approached: bool) -> PerformerInput:
    """The performer at a tick of the performance. approached: following can begin."""
    sample = performer.sample(tick) if approached else None
    may_go_on = sample is not None if approached else performer.may_approach()
    return PerformerInput(
        tick=tick if approached else None,
        sample=sample,
        may_go_on=may_go_on,
        hold_reason="" if may_go_on else performer.hold_reason,
        paused=performer.paused,
    )


def step(machine: Machine, motion: RobotMotion, state: TickState, given: TickInput) -> TickOutput:
    """The goal of a tick, and the state after it."""
    guard, supervisor = machine.guard, machine.supervisor
    _look_at_servos(machine, motion, state, given)
    hold_reason, lost = _hold_reason(machine, motion, state, given)
    situation = _situation(machine, motion, state, hold_reason)
    run_state = supervisor.step(given.now, given.operator, given.performer, situation, guard)
    state, news = _standing(machine, state), tuple[str, ...]()
    if supervisor.over:
        return TickOutput(replace(state, **_sampled(given)), run_state, lost=lost)
    desired = _target(machine, motion, state, given)
    goal, target = motion.check(state.commanded, desired)
    if run_state is RunState.GO_TO_REST and target is not None and not goal.passed:
        refused = machine.refused or "the gate refuses the goal"
        news = () if state.refused else (HOLDS_BEFORE_REST.format(refused),)
        state = replace(state, refused=refused)
    state = replace(state, commanded=motion.next(state.commanded, goal, target), **_sampled(given))
    motion.reseed_follower(state.commanded, desired)
    return TickOutput(
        state,
        run_state,
        goal,
        target,
        gated=desired is not None and not (goal.passed and target is desired),
        followed=motion.follow.posture if run_state is RunState.FOLLOW else None,
        lost=lost,
        news=news,
    )


def brake(machine: Machine, motion: RobotMotion, state: TickState, given: TickInput) -> TickOutput:
    """The tick after a failure: the robot brakes, or torque goes off. Without the bus no robot brakes."""
    supervisor, guard = machine.supervisor, machine.guard
    if given.operator.fault is not None:
        guard.latch(*given.operator.fault)
    for failure in given.failures:
        if failure.cause is StopCause.SOURCE:
            guard.latch(failure.cause, failure.reason)
            continue
        before, may_brake = supervisor.state, failure.cause is not StopCause.BUS
        supervisor.fail(given.now, failure.reason, failure.cause, guard, may_brake=may_brake)
        if supervisor.state is before:  # a stop that goes on failing has its limits and its operator, too
            situation = _situation(machine, motion, state, "")
            supervisor.step(given.now, given.operator, PerformerInput(), situation, guard)
    state = _standing(machine, replace(state, **_sampled(given)))
    if supervisor.over:
        return TickOutput(state, supervisor.state)
    assert guard.goal is not None, "the robot is armed"
    goal = machine.gate.brake(guard.goal)  # from what the servos have, whatever has failed
    state = replace(state, commanded=motion.next(state.commanded, goal, None))
    with caught([], StopCause.FILTER):  # a follower that fails does not keep the robot from braking
        motion.reseed_follower(state.commanded, None)
    return TickOutput(state, supervisor.state, goal)


@dataclass(frozen=True, eq=False)
class TickDone:
    """A completed tick. given: with all failures. tried: the goal last given to the bus. times: of its stages, s."""

    given: TickInput
    output: TickOutput
    tried: CheckedGoal | None
    times: dict[str, float]


def perform(machine: Machine, motion: RobotMotion, state: TickState, given: TickInput) -> TickDone:
    """A whole tick: `step`, else `brake`, then the goal is written. Raises nothing; if braking fails, torque is off."""
    guard, supervisor, tried, times = machine.guard, machine.supervisor, None, dict[str, float]()
    if guard.goal is not None and guard.goal is not state.commanded.goal:  # an interrupt came between write and state
        state = replace(state, commanded=motion.next(state.commanded, guard.goal, None))
    for attempt in (brake,) if given.failed else (step, brake):
        failures, output, begun = list[Failure](), None, thread_cpu()
        with caught(failures, StopCause.FILTER):
            output = attempt(machine, motion, state, given)
        if output is not None and output.goal is not None:
            tried, times["time_gate"] = output.goal, given.now + thread_cpu() - begun
            with caught(failures, StopCause.BUS):
                guard.write(output.goal)
            times["time_written"] = max(machine.clock.now(), times["time_gate"])
        if not failures:
            break
        given = replace(given, failures=(*given.failures, *failures))
    else:  # the robot cannot brake either
        cannot, output = failures[0], None
        supervisor.fail(given.now, cannot.reason, cannot.cause, guard, may_brake=False)
    output = output or TickOutput(state, supervisor.state)
    pressing = () if machine.contact is None else machine.contact.take_news()
    news = (*guard.health.warnings.take_news(), *supervisor.take_news(), *pressing, *output.news)
    return TickDone(given, replace(output, news=news) if news else output, tried, times)


def _look_at_servos(machine: Machine, motion: RobotMotion, state: TickState, given: TickInput) -> None:
    """Latch failures of the input and faults of the robot."""
    guard, clearance = machine.guard, machine.gate.clearance
    for failure in given.failures:
        guard.latch(failure.cause, failure.reason)
    if given.operator.fault is not None:
        guard.latch(*given.operator.fault)
    assert given.servos is not None, "servos that could not be read are a failure"
    guard.check(given.servos, given.now, given.idle)
    joints, watch = machine.robot.joint_map.to_radians(given.servos.position), machine.tip_watch
    if clearance is not None:
        clearance.measure(joints, state.commanded.joints)
    machine.gate.measure(joints, given.servos.imu)
    if watch is not None and given.servos.imu is not None and not motion.on_approach:
        watch.look(given.servos.imu, joints)
    if machine.contact is not None:
        moves = machine.supervisor.state in AT_RISK
        machine.contact.look(given.servos, joints, state.commanded.standing, moves=moves)


def _sampled(given: TickInput) -> dict[str, Any]:
    """The change of the state by the sample of this tick."""
    tick = given.performer.tick
    return {} if tick is None else {"sample": given.performer.sample, "tick": tick + 1}


def _hold_reason(machine: Machine, motion: RobotMotion, state: TickState, given: TickInput) -> tuple[str, bool]:
    """Why the robot cannot move with the performer, or ""; and True if no posture was found."""
    run_state, performer = machine.supervisor.state, given.performer
    if run_state not in AT_RISK or performer.over:
        return "", False
    if not performer.may_go_on:
        return NOT_FOLLOWABLE.format(performer.hold_reason), False
    if machine.guard.is_silent:
        return BUS_SILENT, False
    if machine.tip_watch is not None and machine.tip_watch.hold_reason:
        return machine.tip_watch.hold_reason, False
    if machine.contact is not None and machine.contact.pressed is not None:
        return machine.contact.pressed.text, False
    if refused := motion.refused(state.commanded):
        return f"the gate refuses {refused}", False
    if run_state is RunState.FOLLOW and motion.follow.lost:
        return "no posture found", True
    return "", False


def _situation(machine: Machine, motion: RobotMotion, state: TickState, hold_reason: str) -> Situation:
    watch = machine.tip_watch
    return Situation(
        hold_reason=hold_reason,
        falls="" if watch is None else watch.fall,
        approached=motion.approach.arrived,
        arrived=motion.has_arrived(machine.supervisor.state, state.commanded),
        stands=motion.stands(state.commanded),
        straight=motion.on_approach,
        end=machine.end_plan.end,
    )


def _target(machine: Machine, motion: RobotMotion, state: TickState, given: TickInput) -> Target | None:
    """The target of the present controller; None: brake, or stand."""
    guard, run_state, legs = machine.guard, machine.supervisor.state, machine.follower.legs
    if legs is not None:
        legs.velocity = given.operator.velocity
    if run_state in TO_REST and guard.is_silent:  # goals that no servo receives would arrive as one step
        return motion.brake(run_state, state.commanded)
    pressed = None if machine.contact is None or run_state is not RunState.HOLD else machine.contact.pressed
    motion.set_press(pressed)
    override = guard.health.warnings.speed_override
    return motion.target(run_state, state.commanded, given.performer, speed_override=override)


def _standing(machine: Machine, state: TickState) -> TickState:
    """The state with the reason why the robot stands at the end."""
    if machine.supervisor.state is not RunState.STANDING or state.standing:
        return state
    stop = machine.guard.stop
    failed = "" if stop is None else stop.reason
    why = machine.end_plan.why or f"it did not get to rest: {state.refused or failed}"
    return replace(state, standing=why)
