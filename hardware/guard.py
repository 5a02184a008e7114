"""The guard: alone switches torque on, alone writes to the bus, and always knows how to stop."""

from collections.abc import Callable

import numpy as np

from hardware.arrays import BoolArray, FloatArray, TickArray
from hardware.bus import ServoAlert, ServoBus, ServoGoals, ServoStates
from hardware.clock import Clock
from hardware.errors import BusError, GuardError, describe
from hardware.goal_filter import GoalFilter
from hardware.guard_state import GuardLimits, GuardState, Stop, StopCause
from hardware.joint_map import JointMap

Think = Callable[[ServoStates], FloatArray | None]
"""From the servo states to a goal posture, rad (n,); None: no goal this tick, the robot brakes and stands."""


class Guard:
    """Owns the stop states of one robot. One call of `tick` per control period: read, think, act.

    Whatever fails in a tick stops the robot: a failure of the goal's source or of the filter brakes along the last
    verified trajectory; a failure of the bus, which can then no longer be trusted to brake, switches torque off. The
    first reason is latched.
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
        self._bus = bus
        self._map = joint_map
        self._filter = goal_filter
        self._clock = clock
        self._limits = limits or GuardLimits()
        self._state = GuardState.IDLE
        self._stop: Stop | None = None
        self._step = StopCause.BUS  # what is to blame if the running step of the tick fails
        self._states: ServoStates | None = None
        self._sent: TickArray | None = None

    @property
    def state(self) -> GuardState:
        """The present state."""
        return self._state

    @property
    def stop_reason(self) -> Stop | None:
        """The latched stop, or None."""
        return self._stop

    @property
    def states(self) -> ServoStates | None:
        """What the servos said last, or None before the first read."""
        return self._states

    @property
    def sent(self) -> TickArray | None:
        """Goal ticks written last, (n,), or None before the first write."""
        return self._sent

    @property
    def active(self) -> bool:
        """Whether the guard expects a tick: torque is on and the robot is held, moved or braked."""
        return self._state in (GuardState.ARMED, GuardState.MOVING, GuardState.STOPPING)

    def arm(self) -> FloatArray:
        """Set every goal to its present position, then switch torque on. Returns the present posture, rad (n,).

        Raises GuardError when not idle or when a servo is missing, alarmed or unreadable (all of them named), BusError
        when the bus fails; torque is then off.
        """
        self._require(GuardState.IDLE)
        try:
            states = self._bus.read()
            self._states = states
            self._refuse_unhealthy(states)
            self._filter.seed(self._map.to_radians(states.position))
            present = self._filter.position
            goals = self._map.to_ticks(present)
            if not np.array_equal(goals, states.position):
                raise GuardError(
                    describe(what="the filter moved the present posture", then="Seed the filter with what it is given")
                )
            self._write(goals)
            self._bus.torque(True)
        except Exception:
            self._torque_off()
            raise
        self._state = GuardState.ARMED
        return present

    def tick(self, think: Think) -> GuardState:
        """Run one control period: read the servos, let `think` find a goal, send what the filter makes of it.

        Never raises for what goes wrong in the tick: that becomes a stop. Raises GuardError when the guard is idle or
        stopped.
        """
        self._require(GuardState.ARMED, GuardState.MOVING, GuardState.STOPPING)
        self._attempt(self._read)
        if self._state in (GuardState.ARMED, GuardState.MOVING):
            self._attempt(lambda: self._move(think))
        if self._state is GuardState.STOPPING:
            self._attempt(self._brake)
        return self._state

    def stop(self, reason: str, cause: StopCause = StopCause.REQUESTED) -> None:
        """Stop the robot and latch `reason`; a stop that is already latched keeps its first reason."""
        if self._stop is None:
            self._stop = Stop(cause, reason, self._clock.now())
        self._state = GuardState.STOPPING if self.active else GuardState.STOPPED

    def come_to_rest(self, period: float) -> GuardState:
        """Tick every `period` s until the robot stands: ends `armed`, or `stopped` if a stop is latched."""
        deadline = self._clock.now()
        if self._state is GuardState.MOVING:
            self._state = GuardState.STOPPING
        for _ in range(self._limits.max_brake_ticks):
            if self._state is not GuardState.STOPPING:
                return self._state
            deadline += period
            self._clock.sleep_until(deadline)
            self.tick(_no_goal)
        if self._state is GuardState.STOPPING:
            self._cut(StopCause.FILTER, f"still moving after {self._limits.max_brake_ticks} ticks of braking")
        return self._state

    def release(self) -> None:
        """Switch torque off; a latched stop stays latched. A bus that does not take it latches, and is raised."""
        try:
            self._bus.torque(False)
        except Exception as error:
            self._cut(StopCause.BUS, str(error) or type(error).__name__)
            raise
        self._state = GuardState.IDLE if self._stop is None else GuardState.STOPPED

    def acknowledge(self) -> None:
        """A person has seen why the robot stopped: torque off, back to idle. Raises GuardError unless stopped."""
        self._require(GuardState.STOPPED)
        self._bus.torque(False)
        self._stop = None
        self._state = GuardState.IDLE

    def _attempt(self, step: Callable[[], None]) -> None:
        """The tick's one boundary: whatever goes wrong in `step` stops the robot."""
        try:
            step()
        except Exception as error:  # noqa: BLE001 - nothing that fails in a tick may leave the robot moving
            reason = str(error) or type(error).__name__
            if self._step is StopCause.BUS or self._state is GuardState.STOPPING:
                self._cut(self._step, reason)
            else:
                self.stop(reason, self._step)

    def _read(self) -> None:
        self._step = StopCause.BUS
        self._states = states = self._bus.read()
        if states.alert.any():
            self.stop(self._name(states.alert != 0, "reports", states), StopCause.SERVO_ALERT)
        elif (states.age > self._limits.max_age).any():
            lost = states.age > self._limits.max_age
            self.stop(
                self._name(lost, f"has not answered for more than {self._limits.max_age} s:", states),
                StopCause.SERVO_LOST,
            )

    def _move(self, think: Think) -> None:
        assert self._states is not None, "a tick reads before it thinks"
        self._step = StopCause.SOURCE
        goal = think(self._states)
        if self._state is GuardState.STOPPING:  # `think` asked for a stop
            return
        self._step = StopCause.FILTER
        posture = self._filter.brake() if goal is None else self._filter.admit(goal)
        ticks = self._map.to_ticks(posture)
        self._write(ticks)
        if goal is not None:
            self._state = GuardState.MOVING

    def _brake(self) -> None:
        self._step = StopCause.FILTER
        if self._filter.at_rest:
            self._state = GuardState.ARMED if self._stop is None else GuardState.STOPPED
            return
        self._write(self._map.to_ticks(self._filter.brake()))

    def _write(self, ticks: TickArray) -> None:
        self._step = StopCause.BUS
        self._bus.write(ServoGoals(ticks))
        self._sent = ticks

    def _cut(self, cause: StopCause, reason: str) -> None:
        """Torque off at once and latched, because braking is no longer possible; then nothing is written any more."""
        outcome = "torque is off" if self._torque_off() else "torque could not be switched off: cut the power"
        if self._stop is not None and self._stop.reason != reason:
            reason = f"{self._stop.reason}, then: {reason}"
        self._stop = Stop(cause if self._stop is None else self._stop.cause, f"{reason} ({outcome})", self._clock.now())
        self._state = GuardState.STOPPED

    def _torque_off(self) -> bool:
        try:
            self._bus.torque(False)
        except Exception:  # noqa: BLE001 - whatever it is, the bus is beyond help; the caller says so
            return False
        return True

    def _require(self, *allowed: GuardState) -> None:
        if self._state not in allowed:
            names = ", ".join(state.value for state in allowed)
            then = f"It stopped because: {self._stop.reason}" if self._stop else ""
            raise GuardError(
                describe(
                    what="not possible in this state", where="guard", found=self._state.value, allowed=names, then=then
                )
            )

    def _refuse_unhealthy(self, states: ServoStates) -> None:
        missing = ~states.valid
        if missing.all():
            raise BusError(
                describe(what="no servo answers", where="arming", then="Check power, wiring and the bus of the profile")
            )
        problems = [self._name(missing, "does not answer:", states)] if missing.any() else []
        problems += [self._name(states.alert != 0, "reports", states)] if states.alert.any() else []
        if problems:
            raise GuardError(
                describe(
                    what="not every servo is well", where="arming", found="; ".join(problems), then="Torque stays off"
                )
            )

    def _name(self, which: BoolArray, complaint: str, states: ServoStates) -> str:
        """One text that names every servo of the mask, for example: servo reports l_el (id 6) OVERLOAD."""
        named = []
        for index in np.flatnonzero(which):
            servo = self._map.servos[index]
            bits = int(states.alert[index])
            named.append(f"{servo.joint} (id {servo.id})" + (f" {_alert_text(bits)}" if bits else ""))
        return f"servo {complaint} " + ", ".join(named)


def _alert_text(bits: int) -> str:
    """Names of the alert bits; bits that the maker leaves undefined as a number."""
    known = [alert.name or "" for alert in ServoAlert if bits & alert]
    rest = bits & ~sum(ServoAlert)
    return "+".join([*known, *([f"0x{rest:02x}"] if rest else [])])


def _no_goal(_: ServoStates) -> None:
    """Ask for nothing: the robot brakes and stands."""
