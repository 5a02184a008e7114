"""The state machine of a run: a table of states and one of transitions, both executed here and shown by the docs."""

from collections.abc import Iterator
from dataclasses import dataclass
from enum import Enum
from math import inf

from hardware.clock import Clock
from hardware.guard import Guard, Torque
from hardware.guard_state import StopCategory, StopCause
from retarget.human.samples import PerformerInput
from retarget.robot.walking.gait import LONGEST_STOP_S as LONGEST_WALK_STOP_S
from retarget.robot.walking.pattern import Request
from retarget.types import RunState


@dataclass(frozen=True)
class StateRow:
    """One state. controls: source of the targets, in words. limit_s: longest stay, s."""

    controls: str
    torque: bool = False
    limit_s: float = inf


LONGEST_HOLD_S = 4.8
"""[s] Longest hold for a performer who cannot be followed: it ends 5 s after the last data."""
LONGEST_BRAKE_S = LONGEST_WALK_STOP_S + 0.2
"""[s] Longest stop: that of a walk, which ends after at most two steps."""
LONGEST_RETURN_S = 15.0
"""[s] Longest return to stance, after which the robot goes on from where it is."""
LONGEST_TO_REST_S = 24.0
"""[s] Longest move to rest, after which the robot stands, with torque."""
LONGEST_FALL_S = 1.5
"""[s] From detection to torque off: an inverted pendulum of 0.4 m that begins at 5 degrees lies within 0.8 s."""
LONGEST_STOP_S = 2.0 * LONGEST_BRAKE_S + LONGEST_RETURN_S + LONGEST_TO_REST_S
"""[s] Longest stop as a whole, after which every state has timed out."""
COMMANDED_S = 0.5
"""[s] Following that ends the count of an earlier hold, so that single targets between holds do not."""

STATES: dict[RunState, StateRow] = {
    RunState.IDLE: StateRow("nothing; waits for data"),
    RunState.COUNTDOWN: StateRow("nothing; the performer takes the pose"),
    RunState.CALIBRATING: StateRow("nothing; the performer stands still"),
    RunState.CHECKING_SIDES: StateRow("nothing; the performer raises the left arm"),
    RunState.ARMING: StateRow("nothing; the present posture is the goal"),
    RunState.APPROACH: StateRow("the approach", True),
    RunState.FOLLOW: StateRow("the performer, or recorded goals", True),
    RunState.HOLD: StateRow("the whole-body stop", True, LONGEST_HOLD_S),
    RunState.STOPPING: StateRow("the whole-body stop", True, LONGEST_BRAKE_S),
    RunState.RETURN_TO_STANCE: StateRow("the return to stance", True, LONGEST_RETURN_S),
    RunState.GO_TO_REST: StateRow("the keyframes of the profile", True, LONGEST_TO_REST_S),
    RunState.STANDING: StateRow("nothing; holds until the operator switches torque off", True),
    RunState.FALLING: StateRow("the whole-body stop, with little torque", True, LONGEST_FALL_S),
    RunState.OFF: StateRow("nothing"),
    RunState.FAULT: StateRow("nothing; a person looks at the reason"),
}


class Event(Enum):
    """The events that change a state. The first one of this list with a transition counts."""

    RELEASED = "the operator, who holds the robot, switches torque off"
    TORQUE_OFF = "torque off is requested, the bus is lost, or a tick fails and the robot cannot brake"
    FALLS = "the robot tips over, and cannot come back"
    FAULT = "a fault of the robot is latched"
    STOP = "a stop is requested or latched"
    FAILED = "the controller fails"
    OVER = "the performance is over"
    TIMEOUT = "the time limit of the state is over"
    NO_COMMAND = "there is no valid sample, no posture, or no answer from the bus"
    RESUME_APPROACH = "the performer can be followed, the approach is not over"
    RESUME = "the performer can be followed"
    ARRIVED = "the controller has arrived"
    STANDS_ON_SOLES = "the robot stands, and may go to rest by way of its stance"
    MAY_GO_TO_REST = "the robot stands on its straight approach, or has tried to return to stance: it may go to rest"
    ENDS_STANDING = "the robot stands in its stance, or on its way there, and is to stay so"
    STANDS = "the robot stands, and is not to go to rest"
    STANDS_WITH_FAULT = "the robot stands, with a fault"
    DATA = "every needed sensor is fresh"
    COUNTED = "the countdown is over"
    MEASURED = "the performer is measured, and sides are to be checked"
    READY = "the performer is known"
    ARMED = "torque is on"


@dataclass(frozen=True)
class Transition:
    """A change to another state. category: of the stop, if it is one."""

    to: RunState
    category: StopCategory | None = None


_S, _E, _C = RunState, Event, StopCategory
_TORQUE_OFF = Transition(_S.FAULT, _C.TORQUE_OFF)
_STOP = Transition(_S.STOPPING, _C.BRAKE_AND_TORQUE_OFF)
_HOLD = Transition(_S.HOLD, _C.HOLD)
_FALL = Transition(_S.FALLING, _C.BRAKE_AND_TORQUE_OFF)

TRANSITIONS: dict[tuple[RunState, Event], Transition] = {
    # Without torque: a performer is waited for, measured and checked; a recording is ready at once.
    (_S.IDLE, _E.DATA): Transition(_S.COUNTDOWN),
    (_S.IDLE, _E.READY): Transition(_S.ARMING),
    (_S.COUNTDOWN, _E.COUNTED): Transition(_S.CALIBRATING),
    (_S.CALIBRATING, _E.MEASURED): Transition(_S.CHECKING_SIDES),
    (_S.CALIBRATING, _E.READY): Transition(_S.ARMING),
    (_S.CHECKING_SIDES, _E.READY): Transition(_S.ARMING),
    (_S.ARMING, _E.ARMED): Transition(_S.APPROACH),
    # The robot moves with the performer.
    **{
        (state, event): transition
        for state in (_S.APPROACH, _S.FOLLOW, _S.HOLD)
        for event, transition in (
            (_E.TORQUE_OFF, _TORQUE_OFF),
            (_E.FALLS, _FALL),
            (_E.FAULT, _STOP),
            (_E.STOP, _STOP),
            (_E.FAILED, _STOP),
            (_E.OVER, _STOP),
        )
    },
    (_S.APPROACH, _E.NO_COMMAND): _HOLD,
    (_S.APPROACH, _E.ARRIVED): Transition(_S.FOLLOW),
    (_S.FOLLOW, _E.NO_COMMAND): _HOLD,
    (_S.FOLLOW, _E.ARRIVED): _STOP,
    (_S.HOLD, _E.TIMEOUT): _STOP,
    (_S.HOLD, _E.RESUME_APPROACH): Transition(_S.APPROACH),
    (_S.HOLD, _E.RESUME): Transition(_S.FOLLOW),
    # The robot stops, and goes to rest where it may.
    (_S.STOPPING, _E.TORQUE_OFF): _TORQUE_OFF,
    (_S.STOPPING, _E.FALLS): _FALL,
    (_S.STOPPING, _E.TIMEOUT): _TORQUE_OFF,
    (_S.STOPPING, _E.STANDS_ON_SOLES): Transition(_S.RETURN_TO_STANCE),
    (_S.STOPPING, _E.MAY_GO_TO_REST): Transition(_S.GO_TO_REST),
    (_S.STOPPING, _E.ENDS_STANDING): Transition(_S.STANDING),
    (_S.STOPPING, _E.STANDS): Transition(_S.OFF),
    (_S.STOPPING, _E.STANDS_WITH_FAULT): Transition(_S.FAULT),
    (_S.RETURN_TO_STANCE, _E.TORQUE_OFF): _TORQUE_OFF,
    (_S.RETURN_TO_STANCE, _E.FALLS): _FALL,
    (_S.RETURN_TO_STANCE, _E.FAULT): _STOP,
    (_S.RETURN_TO_STANCE, _E.FAILED): _STOP,
    (_S.RETURN_TO_STANCE, _E.TIMEOUT): _STOP,
    (_S.RETURN_TO_STANCE, _E.ARRIVED): Transition(_S.GO_TO_REST),
    (_S.RETURN_TO_STANCE, _E.ENDS_STANDING): Transition(_S.STANDING),
    (_S.GO_TO_REST, _E.TORQUE_OFF): _TORQUE_OFF,
    (_S.GO_TO_REST, _E.FALLS): _FALL,
    (_S.GO_TO_REST, _E.FAULT): _STOP,
    (_S.GO_TO_REST, _E.FAILED): Transition(_S.STANDING),
    (_S.GO_TO_REST, _E.TIMEOUT): Transition(_S.STANDING),
    (_S.GO_TO_REST, _E.ARRIVED): Transition(_S.OFF),
    # A robot that cannot go to rest keeps its torque until the operator, a servo or the bus says otherwise.
    (_S.STANDING, _E.RELEASED): Transition(_S.OFF),
    (_S.STANDING, _E.TORQUE_OFF): _TORQUE_OFF,
    (_S.STANDING, _E.FAULT): Transition(_S.FAULT, _C.BRAKE_AND_TORQUE_OFF),
    # A robot that falls gives way, and lets go once it lies. One that stands at the end is held by a person by then.
    (_S.FALLING, _E.TORQUE_OFF): _TORQUE_OFF,
    (_S.FALLING, _E.TIMEOUT): _TORQUE_OFF,
    (_S.OFF, _E.TORQUE_OFF): _TORQUE_OFF,
}
"""All transitions. Other events change nothing."""

BUS_SILENT = "the bus is silent"
"""The hold reason of a cycle in which no servo of a bus answered."""
AT_RISK = (RunState.APPROACH, RunState.FOLLOW, RunState.HOLD)
"""States in which the robot moves with the performer."""
BRAKING_OR_STANDING = (RunState.HOLD, RunState.STOPPING, RunState.STANDING)
"""States in which the robot stops or stands."""


class End(Enum):
    """The end of a run, in words for the operator."""

    AT_REST = "it brakes and goes to rest"
    STANDING = "it brakes, returns to its stance and stands there, with torque"
    """Until the operator switches torque off."""
    BRAKED = "it brakes"
    """Without torque, for robots that do not fall."""


@dataclass(frozen=True)
class OperatorInput:
    """The requests of the operator. stop: the reason. torque_off: counts once the robot stands. fault: cause and reason
    of a stop in any state. velocity: of a stick; None without one."""

    stop: str | None = None
    torque_off: bool = False
    fault: tuple[StopCause, str] | None = None
    velocity: Request | None = None


@dataclass(frozen=True, slots=True)
class Situation:
    """The situation of the robot. hold_reason, falls: in words, or "". straight: on the straight part of the
    approach."""

    hold_reason: str = ""
    falls: str = ""
    approached: bool = False
    arrived: bool = False
    stands: bool = False
    straight: bool = False
    end: End = End.BRAKED


FORCED_STOP = "torque off before the robot stood, forced by the user"


class Supervisor:
    """Changes the state of a run. since: s, beginning of the state."""

    def __init__(self) -> None:
        self.state, self.since = RunState.IDLE, 0.0
        self.hold_reason = ""
        """The present or last hold reason."""
        self._news: list[str] = []
        self._entered: dict[RunState, float] = {}  # [s] when each state began first
        self._held_since = self._held_until = -inf  # [s] of holds that count as one

    @property
    def torque(self) -> bool:
        """True if torque is on in this state."""
        return STATES[self.state].torque

    @property
    def over(self) -> bool:
        """True if the run has ended."""
        return self.state in (RunState.OFF, RunState.FAULT)

    def take(self, event: Event, now: float) -> bool:
        """Take the transition for an event at `now`, s. Return True if there is one."""
        transition = TRANSITIONS.get((self.state, event))
        if transition is None:
            return False
        if self.state is RunState.HOLD:
            self._held_until = now
        self.state, self.since = transition.to, now
        self._entered.setdefault(transition.to, now)
        if transition.to is RunState.HOLD and now - self._held_until >= COMMANDED_S:
            self._held_since = now
        return True

    def enter(self, state: RunState, clock: Clock) -> None:
        """Go on to a state without torque. Raises ValueError without a transition to it."""
        events = [event for (before, event), row in TRANSITIONS.items() if before is self.state and row.to is state]
        if not events or STATES[state].torque:
            raise ValueError(f"no transition from {self.state.value} to {state.value}")
        self.take(events[0], clock.now())

    def step(
        self, now: float, operator: OperatorInput, performer: PerformerInput, situation: Situation, guard: Guard
    ) -> RunState:
        """The state of the tick at `now`, s. Reasons of stops are latched in the guard."""
        if self.state is RunState.HOLD and situation.hold_reason:
            self.hold_reason = situation.hold_reason
            self._held_since = now if performer.paused else self._held_since
        for event in self._events(now, operator, performer, situation, guard):
            if (self.state, event) in TRANSITIONS:
                self._latch(event, now, operator, situation, guard)
                self.take(event, now)
                break
        return self.state

    def fail(self, now: float, error: str, cause: StopCause, guard: Guard, *, may_brake: bool) -> None:
        """A tick has failed. Torque goes off now unless the robot can still brake."""
        if not may_brake:
            guard.switch_off(cause, error)
            self.take(Event.TORQUE_OFF, now)
        elif self.state is RunState.RETURN_TO_STANCE:
            self.take(Event.FAILED, now)
            self._give_up_return(error)
        else:
            guard.latch(cause, error)
            self.take(Event.FAILED, now)

    def take_news(self) -> tuple[str, ...]:
        """Failures on the way to rest since the last call."""
        news, self._news = tuple(self._news), []
        return news

    def _give_up_return(self, why: str) -> None:
        self._news.append(f"return to stance: {why}; the robot goes on from where it is")

    def _events(
        self, now: float, operator: OperatorInput, performer: PerformerInput, situation: Situation, guard: Guard
    ) -> Iterator[Event]:
        """The present events, in the order of `Event`."""
        if operator.torque_off:
            yield Event.RELEASED
        if self._is_forced(operator) or guard.torque is not Torque.ON:
            yield Event.TORQUE_OFF
        if situation.falls:
            yield Event.FALLS
        if not guard.may_go_to_rest:
            yield Event.FAULT
        if operator.stop is not None or guard.stop is not None:
            yield Event.STOP
        if performer.over:
            yield Event.OVER
        began = self._held_since if self.state is RunState.HOLD else self.since
        stopping = now - self._entered.get(RunState.STOPPING, inf)
        too_long = stopping > LONGEST_STOP_S and self.state is not RunState.FALLING
        if now - began > STATES[self.state].limit_s or too_long:
            yield Event.TIMEOUT
        if situation.hold_reason:
            yield Event.NO_COMMAND
        else:
            yield Event.RESUME if situation.approached else Event.RESUME_APPROACH
        if situation.arrived:
            stays = situation.end is End.STANDING and self.state is RunState.RETURN_TO_STANCE
            yield Event.ENDS_STANDING if stays else Event.ARRIVED
        if situation.stands:
            yield self._stands(situation, guard)

    def _is_forced(self, operator: OperatorInput) -> bool:
        """True if torque is to go off at once. A robot that moves with the performer brakes first."""
        return operator.torque_off and self.state not in AT_RISK

    def _stands(self, situation: Situation, guard: Guard) -> Event:
        if not guard.may_go_to_rest:
            return Event.STANDS_WITH_FAULT
        if situation.end is End.BRAKED:
            return Event.STANDS
        if not situation.straight and RunState.RETURN_TO_STANCE not in self._entered:
            return Event.STANDS_ON_SOLES
        return Event.MAY_GO_TO_REST if situation.end is End.AT_REST else Event.ENDS_STANDING

    def _latch(self, event: Event, now: float, operator: OperatorInput, situation: Situation, guard: Guard) -> None:
        """Latch the reason of a transition that stops the robot."""
        answered = f"the bus answered in only {guard.health.buses.answered:.0%} of the cycles"
        why = answered if self.hold_reason == BUS_SILENT else self.hold_reason
        held = f"{why} for {now - self._held_since:.3g} s, allowed {LONGEST_HOLD_S:g} s"
        if event is Event.TORQUE_OFF:
            if self._is_forced(operator):
                guard.switch_off(StopCause.REQUESTED, FORCED_STOP)
        elif event is Event.FALLS:
            guard.latch(StopCause.FALLEN, situation.falls)
            guard.reduce_drive()
        elif event is Event.TIMEOUT and self.state is RunState.FALLING:
            guard.switch_off(StopCause.FALLEN, situation.falls)
        elif event is Event.STOP and operator.stop is not None:
            guard.latch(StopCause.REQUESTED, operator.stop)
        elif event is Event.NO_COMMAND:
            self.hold_reason = situation.hold_reason
        elif event is Event.TIMEOUT and self.state is RunState.HOLD:
            guard.latch(StopCause.STALE_GOAL, held)
        elif event is Event.TIMEOUT and self.state is RunState.STOPPING:
            guard.switch_off(StopCause.FILTER, f"still moving after {LONGEST_BRAKE_S:g} s of braking")
        elif event is Event.TIMEOUT and self.state is RunState.GO_TO_REST:
            guard.latch(StopCause.FILTER, f"not at rest after {now - self.since:.3g} s")
        elif event is Event.TIMEOUT and self.state is RunState.RETURN_TO_STANCE:
            self._give_up_return(f"not over after {LONGEST_RETURN_S:g} s")
