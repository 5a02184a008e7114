"""The guard: alone switches torque on, alone writes to the bus, and always knows how to stop; its stop latch."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from hardware.arrays import FloatArray, TickArray
from hardware.bus import ServoBus, ServoGoals, ServoStates
from hardware.clock import Clock, TickTiming
from hardware.errors import GuardError, describe
from hardware.guard_state import GoalFilter, GuardLimits, GuardState, Stop, StopCause
from hardware.joint_map import JointMap
from hardware.servo_health import ServoHealth

__all__ = [
    "COMMANDED_S",
    "CUT_POWER",
    "FOLLOWING",
    "GOING_TO_REST",
    "TORQUE_OFF",
    "FindGoal",
    "Guard",
    "Halt",
    "NoCommand",
    "StopLatch",
]


# The stop of a guard: its first reason stays, what comes after it is added, and how long the way to its end may be.

TORQUE_OFF = " (torque is off)"
CUT_POWER = " (torque could not be switched off: cut the power)"
GOING_TO_REST = (StopCause.REQUESTED, StopCause.STALE_GOAL, StopCause.SOURCE)
"""Stops that are no fault of the robot: it may go where it is parked."""


class StopLatch:
    """`stop`: the latched one, or None. `braking` counts the ticks of its end."""

    def __init__(self, limits: GuardLimits) -> None:
        self.stop: Stop | None = None
        self._limits = limits
        self.begin()

    def begin(self) -> None:
        """The way to a stand begins, be it without a stop."""
        self._braked = self._rest_ticks = 0
        self._stood = False

    def latch(self, cause: StopCause, reason: str, time: float) -> None:
        """Keep the first reason."""
        if self.stop is None:
            self.stop = Stop(cause, reason, time)

    def add(self, cause: StopCause, reason: str) -> None:
        """Something more went wrong on the way to a stop: once."""
        stop = self.stop
        if stop is not None and stop.then is None and cause is not stop.cause:
            self.stop = replace(stop, reason=f"{stop.reason}, then: {reason}", then=cause)

    def latch_torque_off(self, cause: StopCause, reason: str, time: float, *, powered: bool) -> None:
        """Torque was switched off; powered: not everybody confirmed that."""
        then = None
        if self.stop is not None:
            first, then = self.stop.reason.removesuffix(TORQUE_OFF).removesuffix(CUT_POWER), self.stop.then
            if reason in first:
                reason = first
            else:
                reason, then = f"{first}, then: {reason}", cause
            cause = self.stop.cause
        if not powered:  # it did not confirm at first
            reason = reason.replace(" Cut the power by hand", "")
        self.stop = Stop(cause, reason + (CUT_POWER if powered else TORQUE_OFF), time, powered, then)

    @property
    def may_go_to_rest(self) -> bool:
        """Whether a stopping robot may go where it is parked: nothing is wrong with it, and it does not take for
        ever."""
        well = self.stop is None or (self.stop.cause in GOING_TO_REST and self.stop.then is None)
        return well and self._rest_ticks < self._limits.max_rest_ticks

    def spend(self, *, stood: bool) -> int | None:
        """One more tick on the way; stood: the robot stands. Ticks of braking so far when there may be no more."""
        self._stood |= stood
        if self._stood and self.may_go_to_rest:
            self._rest_ticks += 1  # at the end of these it stands where it is
        elif self._braked == self._limits.max_brake_ticks:
            return self._braked
        else:
            self._braked += 1
        return None


# For how long nobody has led the robot.

COMMANDED_S = 0.5
"""So long it must have been led without a break, s, before earlier holds count no more: one goal between two of them,
again and again, leads nowhere."""


class NoCommand:
    """Counts the time in which nobody knew a goal, from one tick to the next."""

    def __init__(self) -> None:
        self._since: float | None = None  # [s] since when, but for what was shorter than COMMANDED_S
        self._commanded_since: float | None = None  # [s] since when there has been a goal in every tick

    def commanded(self, now: float) -> None:
        """A tick at `now`, s, had a goal."""
        if self._commanded_since is None:
            self._commanded_since = now
        if now - self._commanded_since >= COMMANDED_S:
            self._since = None

    def lasted(self, now: float, *, on_purpose: bool) -> float:
        """A tick at `now`, s, has none: for how long, s. on_purpose: somebody holds the robot; that is not counted."""
        self._commanded_since = None
        if on_purpose or self._since is None:
            self._since = now
        return now - self._since


FindGoal = Callable[[ServoStates], FloatArray | None]
"""From the servo states to a goal posture, rad (n,); None: nobody knows one, the robot brakes and holds."""

Halt = Callable[[], FloatArray | None]
"""The next goal, rad (n,), on a way to a stop; None: none is known, and the filter brakes joint by joint. Once the
robot stands: the next one on the way to where it is parked; None: it is there, or stays where it is."""

FOLLOWING = (GuardState.ARMED, GuardState.MOVING, GuardState.HOLDING)
"""States in which goals are asked for."""


def _text(error: BaseException) -> str:
    return str(error).rstrip(".") or type(error).__name__


def _no_way() -> None:
    """No way to a stop but the filter's own."""


class Guard:
    """Owns the stop states of one robot. One call of `tick` per control period: read, think, act.

    Whatever fails in a tick stops the robot: a failure of the goal's source or of the filter brakes; a failure of the
    bus, which can then no longer be trusted to brake, switches torque off. The first reason is latched. To brake is to
    follow the caller's way to a stop where it knows one and the filter lets it pass, else the filter's own.
    What may have torque is never called safe: where a servo does not confirm that its torque is off, a person is told.
    """

    def __init__(
        self,
        *,
        bus: ServoBus,
        joint_map: JointMap,
        goal_filter: GoalFilter,
        clock: Clock,
        limits: GuardLimits | None = None,
    ) -> None:
        self._bus, self._map, self._filter, self._clock = bus, joint_map, goal_filter, clock
        self.limits = limits or GuardLimits()
        self.health = ServoHealth(joint_map, self.limits)
        self._state, self._latch = GuardState.IDLE, StopLatch(self.limits)
        self._step = StopCause.BUS  # what is to blame if the running step of the tick fails
        self._states: ServoStates | None = None
        self._sent: TickArray | None = None
        self._posture = b""  # what was written last, as the bytes of its angles
        self._pending: FloatArray | None = None  # [rad] what the filter returned, until the bus has it
        self.paused = False
        """Whether somebody holds the robot on purpose: that may last."""
        self.hold_reason = "no goal"
        """What there is while nobody knows a goal, for the reason of a stop where that lasts too long."""
        self._timing, self._no_command = TickTiming(self.limits.period), NoCommand()

    @property
    def state(self) -> GuardState:
        """The present state."""
        return self._state

    @property
    def stop_reason(self) -> Stop | None:
        """The latched stop, or None."""
        return self._latch.stop

    @property
    def states(self) -> ServoStates | None:
        """What the servos said last, or None before the first read."""
        return self._states

    @property
    def sent(self) -> TickArray | None:
        """Goal ticks written last, (n,), a new array with every write; None before the first."""
        return self._sent

    @property
    def active(self) -> bool:
        """Whether the guard expects a tick: torque is on and the robot is held, moved or braked."""
        return self._state in (*FOLLOWING, GuardState.STOPPING)

    @property
    def may_go_to_rest(self) -> bool:
        """Whether a stopping robot may go where it is parked."""
        return self._latch.may_go_to_rest

    def arm(self) -> FloatArray:
        """Set every goal to its present position, then switch torque on. Returns the present posture, rad (n,).

        Raises GuardError when not idle or when a servo is missing, alarmed or unreadable (all of them named), BusError
        when the bus fails. What fails from the moment on when torque may be on is latched.
        """
        self._require(GuardState.IDLE)
        try:
            states = self._bus.read()
            self._states = states
            self.health.refuse_unhealthy(states)
            self._filter.seed(self._map.to_radians(states.position))
            present = self._filter.position
            goals = self._map.to_ticks(present)
            if not np.array_equal(goals, states.position):
                raise GuardError(
                    describe(what="the filter moved the present posture", then="Seed the filter with what it is given")
                )
            self._write(goals)
            self._pending, self._no_command = None, NoCommand()
            self._timing.restart()
            self._state = GuardState.ARMED  # before torque is on: whatever interrupts from here on switches it off
            self._bus.torque(True)
        except BaseException as error:
            answered = self._states is not None and self._states.valid.any()
            # Somebody may have torque from before: what does not confirm that it is off is not called safe.
            if self._state is GuardState.ARMED or (not self._torque_off() and answered):
                self.force_torque_off(_text(error), StopCause.BUS)
            raise
        return present

    def tick(self, think: FindGoal, halt: Halt = _no_way) -> GuardState:
        """Run one control period: read the servos, let `think` find a goal, send what the filter makes of it.

        While holding or stopping it is `halt` that finds the goal; a robot that stands has stopped when it finds none,
        or leads nowhere though it may not go home. Goals follow one another in time: after a pause between ticks that
        is longer than a goal may take, the robot stops.
        Never raises for what goes wrong in the tick: that becomes a stop. Raises GuardError when idle or stopped.
        """
        self._require(*FOLLOWING, GuardState.STOPPING)
        begun = self._clock.now()
        self._refuse_pause(begun)
        self._attempt(self._read)
        if self._state in FOLLOWING:
            self._attempt(lambda: self._move(think, halt, begun))
        if self._state is GuardState.STOPPING:
            stood = self._filter.at_rest
            self._attempt(lambda: self._ask_way(halt))
            self._attempt(lambda: self._brake(stood=stood))
        return self._state

    def stop(self, reason: str, cause: StopCause = StopCause.REQUESTED) -> None:
        """Stop the robot and latch `reason`; a stop that is already latched keeps its first reason."""
        self._latch.latch(cause, reason, self._clock.now())
        if self._state is not GuardState.STOPPING:
            self._begin_stopping(GuardState.STOPPING if self.active else GuardState.STOPPED)

    def force_torque_off(self, reason: str, cause: StopCause = StopCause.REQUESTED) -> None:
        """Torque off at once and latched, because there is no way or no time to brake; nothing is written any more."""
        powered = not self._torque_off()
        self._latch.latch_torque_off(cause, reason, self._clock.now(), powered=powered)
        self._state = GuardState.STOPPED

    def rest(self) -> None:
        """Come to rest without a stop: brake, tick by tick, until the state is `armed` again."""
        if self._state in (GuardState.MOVING, GuardState.HOLDING):
            self._begin_stopping(GuardState.STOPPING)

    def release(self) -> None:
        """Switch torque off; a latched stop stays latched. A bus that does not take it latches, and is raised."""
        try:
            self._bus.torque(False)
        except Exception as error:
            self.force_torque_off(_text(error), StopCause.BUS)
            raise
        self._state = GuardState.IDLE if self._latch.stop is None else GuardState.STOPPED

    def acknowledge(self) -> None:
        """A person has seen why the robot stopped: torque off, back to idle. Raises GuardError unless stopped."""
        self._require(GuardState.STOPPED)
        self._bus.torque(False)
        self._latch.stop = None
        self._state = GuardState.IDLE

    def _begin_stopping(self, state: GuardState) -> None:
        self._state = state
        self._latch.begin()

    def _attempt(self, step: Callable[[], None]) -> None:
        """The tick's one boundary: whatever goes wrong in `step` stops the robot."""
        try:
            step()
        except Exception as error:  # noqa: BLE001 - nothing that fails in a tick may leave the robot moving
            reason = _text(error)
            if self._step is StopCause.BUS or (self._step is StopCause.FILTER and self._state is GuardState.STOPPING):
                self.force_torque_off(reason, self._step)
            else:
                self.stop(reason, self._step)

    def _refuse_pause(self, begun: float) -> None:
        """Stop where nobody called for longer than a goal may take: the servos stand by now, the goals do not."""
        pause = self._timing.begin(begun)
        if pause > self.limits.max_age:
            self.stop(f"no tick for {pause:.3g} s, allowed {self.limits.max_age:g} s", StopCause.STALE_GOAL)

    def _read(self) -> None:
        self._step = StopCause.BUS
        self._states = states = self._bus.read()
        aside = None if (held := self._filter.position).tobytes() == self._posture else held
        if (complaint := self.health.complaint(states, self._sent, aside)) is not None:
            cause, reason = complaint
            if self._state is GuardState.STOPPING:
                self._latch.add(cause, reason)
            self.stop(reason, cause)

    def _move(self, think: FindGoal, halt: Halt, begun: float) -> None:
        assert self._states is not None, "a tick reads before it thinks"
        self._step = StopCause.SOURCE
        goal = think(self._states)
        if self._state is GuardState.STOPPING:  # `think` asked for a stop
            return
        age = self._clock.now() - begun
        if age > self.limits.max_age:
            self.stop(f"the goal took {age:.3g} s, allowed {self.limits.max_age:g} s", StopCause.STALE_GOAL)
            return
        if goal is None:
            self._hold(halt, begun)
            return
        self._step = StopCause.FILTER
        self._no_command.commanded(begun)
        if self._pending is None:
            self._pending = self._filter.admit(goal)
        self._send(self._pending)
        self._state = GuardState.MOVING

    def _hold(self, halt: Halt, now: float) -> None:
        """Brake and stand, torque on, while nobody knows a goal; not for ever."""
        lasted = self._no_command.lasted(now, on_purpose=self.paused)
        if lasted > self.limits.max_hold:
            told = f"{self.hold_reason} for {lasted:.3g} s, allowed {self.limits.max_hold:g} s"
            self.stop(told, StopCause.STALE_GOAL)
            return
        if self._state is not GuardState.ARMED:  # one that has not moved yet waits
            self._state = GuardState.HOLDING
        if not self._filter.at_rest:
            self._ask_way(halt)
        self._step = StopCause.FILTER
        if self._pending is None:
            self._pending = self._filter.brake()
        self._send(self._pending)

    def _ask_way(self, halt: Halt) -> None:
        """Let the caller say how to brake; where that fails, the filter knows."""
        self._step = StopCause.SOURCE
        goal = None if self._pending is not None else halt()
        if goal is not None:
            self._pending = self._filter.admit(goal)

    def _brake(self, *, stood: bool) -> None:
        """Send the next posture of the way. stood: before anybody was asked; if nobody leads on then, that was it."""
        self._step = StopCause.FILTER
        if stood and (self._pending is None or (self._filter.at_rest and not self.may_go_to_rest)):
            self._state = GuardState.ARMED if self._latch.stop is None else GuardState.STOPPED
            return
        spent = self._latch.spend(stood=stood)
        if spent is not None:
            self.force_torque_off(f"still moving after {spent} ticks of braking", StopCause.FILTER)
            return
        if self._pending is None:
            self._pending = self._filter.brake()
        self._send(self._pending)

    def _send(self, posture: FloatArray) -> None:
        """Send what is pending, rad (n,). Until the bus has it the filter is asked for nothing more: what an interrupt
        kept from being sent would else be sent together with the next, a step twice as long."""
        self._write(self._map.to_ticks(posture))
        self._posture, self._pending = posture.tobytes(), None

    def _write(self, ticks: TickArray) -> None:
        self._step = StopCause.BUS
        self._bus.write(ServoGoals(ticks))
        self._sent = ticks

    def _torque_off(self) -> bool:
        try:
            self._bus.torque(False)
        except Exception:  # noqa: BLE001 - whatever it is, the bus is beyond help; the caller says so
            return False
        return True

    def _require(self, *allowed: GuardState) -> None:
        if self._state not in allowed:
            names = ", ".join(state.value for state in allowed)
            then = f"It stopped because: {self._latch.stop.reason}" if self._latch.stop else ""
            raise GuardError(
                describe(
                    what="not possible in this state", where="guard", found=self._state.value, allowed=names, then=then
                )
            )
