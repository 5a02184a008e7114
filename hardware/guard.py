"""The guard: it alone switches torque on and writes to the bus, and it can always stop. Also its stop latch."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from hardware.arrays import FloatArray, TickArray
from hardware.bus import ServoBus, ServoGoals, ServoStates
from hardware.clock import Clock, TickTiming
from hardware.errors import GuardError, describe
from hardware.guard_state import GoalFilter, GuardLimits, GuardState, Stop, StopCause
from hardware.joint_map import JointMap
from hardware.servo_health import ServoHealth, StopCategory

# The latched stop: the first reason stays, one later fault is added, and the ticks until the end are bounded.

TORQUE_OFF = " (torque is off)"
CUT_POWER = " (torque could not be switched off: cut the power)"
GOING_TO_REST = (StopCause.REQUESTED, StopCause.STALE_GOAL, StopCause.SOURCE)
"""Stops that are no fault of the robot: it may go to rest."""


class StopLatch:
    """Keeps the latched stop (`stop`, or None), and counts the ticks until the robot stands or is at rest."""

    def __init__(self, limits: GuardLimits) -> None:
        self.stop: Stop | None = None
        self._limits = limits
        self.begin()

    def begin(self) -> None:
        """Begin to count: the robot starts to brake, with or without a latched stop."""
        self._braked = self._rest_ticks = 0
        self._stood = False

    def latch(self, cause: StopCause, reason: str, time: float) -> None:
        """Latch a stop, unless there is one: the first reason stays."""
        if self.stop is None:
            self.stop = Stop(cause, reason, time)

    def add(self, cause: StopCause, reason: str) -> None:
        """Add a further fault during the stop to its reason; only the first one is added."""
        stop = self.stop
        if stop is not None and stop.then is None and cause is not stop.cause:
            self.stop = replace(stop, reason=f"{stop.reason}, then: {reason}", then=cause)

    def latch_torque_off(self, cause: StopCause, reason: str, time: float, *, powered: bool) -> None:
        """Latch that torque was switched off. powered: not every servo confirmed that."""
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
        """Whether a stopping robot may go to rest: it has no fault, and fewer than max_rest_ticks have passed."""
        well = self.stop is None or (self.stop.cause in GOING_TO_REST and self.stop.then is None)
        return well and self._rest_ticks < self._limits.max_rest_ticks

    def spend(self, *, stood: bool) -> int | None:
        """Count a tick; stood: the robot stands. Return the ticks of braking where they are used up, else None."""
        self._stood |= stood
        if self._stood and self.may_go_to_rest:
            self._rest_ticks += 1  # after max_rest_ticks it stays where it stands
        elif self._braked == self._limits.max_brake_ticks:
            return self._braked
        else:
            self._braked += 1
        return None


# How long the robot has had no goal.

COMMANDED_S = 0.5
"""Time, s, for which there must be a goal in every tick before earlier holds no longer count: single goals between
holds do not restart the count."""


class NoCommand:
    """Counts the time without a goal, from one tick to the next."""

    def __init__(self) -> None:
        self._since: float | None = None  # [s] start of the count, which goals for less than COMMANDED_S do not end
        self._commanded_since: float | None = None  # [s] since when there has been a goal in every tick

    def commanded(self, now: float) -> None:
        """Note a tick at `now`, s, that had a goal."""
        if self._commanded_since is None:
            self._commanded_since = now
        if now - self._commanded_since >= COMMANDED_S:
            self._since = None

    def lasted(self, now: float, *, on_purpose: bool) -> float:
        """Note a tick at `now`, s, without a goal. Return for how long there was none, s. on_purpose: the operator
        pauses the robot, which is not counted."""
        self._commanded_since = None
        if on_purpose or self._since is None:
            self._since = now
        return now - self._since


FindGoal = Callable[[ServoStates], FloatArray | None]
"""From the servo states to a goal posture, rad (n,); None: there is no goal, the robot brakes and holds."""

Halt = Callable[[], FloatArray | None]
"""The next goal, rad (n,), of a braking trajectory; None: there is none, and the filter brakes joint by joint. Once the
robot stands: the next goal of a rest trajectory; None: the robot is at rest, or stays where it is."""

ARMING_READS = 5
"""Cycles in which a bus that is silent when the robot is armed is read again."""
FOLLOWING = (GuardState.ARMED, GuardState.MOVING, GuardState.HOLDING)
"""States in which each tick asks for a goal."""


def _text(error: BaseException) -> str:
    return str(error).rstrip(".") or type(error).__name__


def _no_braking_trajectory() -> None:
    """No braking trajectory of the caller: the filter has its own."""


class Guard:
    """Owns the stop states of one robot. One call of `tick` per control period: read, find a goal, write.

    Every failure in a tick stops the robot. If the source of goals or the filter fails, the robot brakes. If the bus
    fails, it cannot be relied on to brake, and torque goes off. The first reason is latched. The robot brakes along
    the caller's braking trajectory where there is one and the filter passes it, else along the filter's own.
    Where a servo does not confirm that its torque is off, the robot is not safe, and the stop's reason says so.
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
        self._step = StopCause.BUS  # cause of the stop if the running step of the tick fails
        self._states: ServoStates | None = None
        self._sent: TickArray | None = None
        self._posture = b""  # what was written last, as the bytes of its angles
        self._pending: FloatArray | None = None  # [rad] what the filter returned, until the bus has it
        self.paused = False
        """Whether the operator pauses the robot: a hold is then not bounded in time."""
        self.hold_reason = "no goal"
        """Why there is no goal, in words: the reason of the stop where a hold takes too long."""
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
        """The servo states read last, or None before the first read."""
        return self._states

    @property
    def sent(self) -> TickArray | None:
        """Goal ticks written last, (n,), a new array with every write; None before the first."""
        return self._sent

    @property
    def active(self) -> bool:
        """Whether the guard expects a tick: torque is on, and the robot holds, moves or brakes."""
        return self._state in (*FOLLOWING, GuardState.STOPPING)

    @property
    def may_go_to_rest(self) -> bool:
        """Whether a stopping robot may go to rest."""
        return self._latch.may_go_to_rest

    def arm(self) -> FloatArray:
        """Set every goal to its present position, then switch torque on. Returns the present posture, rad (n,).

        Raises GuardError when not idle or when a servo is missing, alarmed or unreadable (all of them named), BusError
        when the bus fails. A failure while torque may be on is latched.
        """
        self._require(GuardState.IDLE)
        try:
            states = self._bus.read()
            for _ in range(ARMING_READS - 1):
                if self.health.silent_for(states) == 0.0:
                    break
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
            self._state = GuardState.ARMED  # before torque is on: any interrupt from here on switches it off
            self._bus.torque(True)
        except BaseException as error:
            answered = self._states is not None and self._states.valid.any()
            # A servo may have torque from before: one that does not confirm that it is off is not safe.
            if self._state is GuardState.ARMED or (not self._torque_off() and answered):
                self.force_torque_off(_text(error), StopCause.BUS)
            raise
        return present

    def tick(self, find_goal: FindGoal, halt: Halt = _no_braking_trajectory) -> GuardState:
        """Run one control period: read the servos, let `find_goal` find a goal, send what the filter makes of it.

        While the robot holds or stops, `halt` gives the goal. A robot that stands has stopped when `halt` gives none,
        or gives one that does not move it although it may not go to rest. Goals follow one another in time: after a
        pause between ticks that is longer than max_age, the robot stops.
        Never raises for a failure in the tick: that becomes a stop. Raises GuardError when idle or stopped.
        """
        self._require(*FOLLOWING, GuardState.STOPPING)
        begun = self._clock.now()
        self._refuse_pause(begun)
        self._attempt(self._read)
        if self._state in FOLLOWING:
            self._attempt(lambda: self._move(find_goal, halt, begun))
        if self._state is GuardState.STOPPING:
            stood = self._filter.at_rest
            self._attempt(lambda: self._ask_braking_trajectory(halt))
            self._attempt(lambda: self._brake(stood=stood))
        return self._state

    def stop(self, reason: str, cause: StopCause = StopCause.REQUESTED) -> None:
        """Stop the robot and latch `reason`; a stop that is already latched keeps its first reason."""
        self._latch.latch(cause, reason, self._clock.now())
        if self._state is not GuardState.STOPPING:
            self._begin_stopping(GuardState.STOPPING if self.active else GuardState.STOPPED)

    def force_torque_off(self, reason: str, cause: StopCause = StopCause.REQUESTED) -> None:
        """Switch torque off at once and latch it (stop category 0): there is no way or no time to brake. Nothing is
        written any more."""
        powered = not self._torque_off()
        self._latch.latch_torque_off(cause, reason, self._clock.now(), powered=powered)
        self._state = GuardState.STOPPED

    def rest(self) -> None:
        """Brake without a stop, tick by tick, until the robot stands and the state is `armed` again."""
        if self._state in (GuardState.MOVING, GuardState.HOLDING):
            self._begin_stopping(GuardState.STOPPING)

    def release(self) -> None:
        """Switch torque off; a latched stop stays latched. A failure of the bus is latched and raised."""
        try:
            self._bus.torque(False)
        except Exception as error:
            self.force_torque_off(_text(error), StopCause.BUS)
            raise
        self._state = GuardState.IDLE if self._latch.stop is None else GuardState.STOPPED

    def acknowledge(self) -> None:
        """Acknowledge the stop, by the operator: torque off, back to idle. Raises GuardError unless stopped."""
        self._require(GuardState.STOPPED)
        self._bus.torque(False)
        self._latch.stop = None
        self._state = GuardState.IDLE

    def _begin_stopping(self, state: GuardState) -> None:
        self._state = state
        self._latch.begin()

    def _attempt(self, step: Callable[[], None]) -> None:
        """Run one step of the tick; any exception stops the robot. The only such boundary."""
        try:
            step()
        except Exception as error:  # noqa: BLE001 - nothing that fails in a tick may leave the robot moving
            reason = _text(error)
            if self._step is StopCause.BUS or (self._step is StopCause.FILTER and self._state is GuardState.STOPPING):
                self.force_torque_off(reason, self._step)
            else:
                self.stop(reason, self._step)

    def _refuse_pause(self, begun: float) -> None:
        """Stop if the pause since the last tick is longer than max_age: the servos stand by now, the goals move on."""
        pause = self._timing.begin(begun)
        if pause > self.limits.max_age:
            self.stop(f"no tick for {pause:.3g} s, allowed {self.limits.max_age:g} s", StopCause.STALE_GOAL)

    def _read(self) -> None:
        self._step = StopCause.BUS
        self._states = states = self._bus.read()
        deflected = None if (held := self._filter.position).tobytes() == self._posture else held
        fault = self.health.check(states, self._sent, deflected)
        if fault is None or fault.category is StopCategory.HOLD:
            return
        if fault.category is StopCategory.TORQUE_OFF:
            self.force_torque_off(fault.reason, fault.cause)
            return
        if self._state is GuardState.STOPPING:
            self._latch.add(fault.cause, fault.reason)
        self.stop(fault.reason, fault.cause)

    def _move(self, find_goal: FindGoal, halt: Halt, begun: float) -> None:
        assert self._states is not None, "a tick reads before it finds a goal"
        if self.health.silent_for(self._states) > 0.0:
            self.hold_reason = "the bus is silent"
            self._hold(halt, begun)
            return
        self._step = StopCause.SOURCE
        goal = find_goal(self._states)
        if self._state is GuardState.STOPPING:  # `find_goal` asked for a stop
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
        """Brake and stand, torque on, while there is no goal; for max_hold at most."""
        lasted = self._no_command.lasted(now, on_purpose=self.paused)
        if lasted > self.limits.max_hold:
            reason = f"{self.hold_reason} for {lasted:.3g} s, allowed {self.limits.max_hold:g} s"
            self.stop(reason, StopCause.STALE_GOAL)
            return
        if self._state is not GuardState.ARMED:  # one that has not moved yet waits
            self._state = GuardState.HOLDING
        if not self._filter.at_rest:
            self._ask_braking_trajectory(halt)
        self._step = StopCause.FILTER
        if self._pending is None:
            self._pending = self._filter.brake()
        self._send(self._pending)

    def _ask_braking_trajectory(self, halt: Halt) -> None:
        """Take the next goal of the caller's braking trajectory, if there is one; else the filter brakes."""
        self._step = StopCause.SOURCE
        goal = None if self._pending is not None else halt()
        if goal is not None:
            self._pending = self._filter.admit(goal)

    def _brake(self, *, stood: bool) -> None:
        """Send the next posture of the stop. stood: the robot stood before `halt` was asked; without a goal from it
        then, the stop is complete."""
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
        """Send the pending posture, rad (n,). Until the bus has it, the filter is not asked again. Otherwise a posture
        that an interrupt kept from being sent would be skipped, and the next step would be twice as long."""
        self._write(self._map.to_ticks(posture))
        self._posture, self._pending = posture.tobytes(), None

    def _write(self, ticks: TickArray) -> None:
        self._step = StopCause.BUS
        self._bus.write(ServoGoals(ticks))
        self._sent = ticks

    def _torque_off(self) -> bool:
        try:
            self._bus.torque(False)
        except Exception:  # noqa: BLE001 - the bus cannot be used any more; the caller reports it
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
