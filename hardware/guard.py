"""The guard alone switches torque on and writes to the bus. It checks servo states, and latches a stop.

It acts only when called. The state machine of a run (`retarget.run.supervisor`) reads the latched stop.
"""

from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field, replace
from enum import Enum
from math import isinf
from typing import Any

import numpy as np

from hardware.arrays import FloatArray, TickArray
from hardware.bus import ServoBus, ServoGoals, ServoStates
from hardware.errors import GuardError
from hardware.guard_state import BEARABLE, FAULTLESS, GuardLimits, Stop, StopCategory, StopCause
from hardware.joint_map import JointMap
from hardware.servo_health import ServoHealth


class _Seal:
    """Proof that a goal is made by one gate; only `retarget.safety.gate` imports it. last: the gate's newest goal, by
    identity. before: the goal before it."""

    last: "CheckedGoal | None" = None
    before: "CheckedGoal | None" = None


@dataclass(frozen=True, eq=False, slots=True)
class CheckedGoal:
    """The goal of one tick; arrays (n,) in servo order, rad, read-only.

    joints: sent goals. posture: the joints under load, without deflection compensation. displacement: change in this
    tick. stop (k, n): the postures after this goal, tick by tick to rest; empty if it rests. passed: the goal is the
    checked target, not part of a braking trajectory. compensated: state of the deflection compensation. Raises
    TypeError unless a gate makes it.
    """

    joints: FloatArray
    posture: FloatArray
    displacement: FloatArray
    stop: FloatArray
    passed: bool
    compensated: Any = field(repr=False)
    seal: _Seal = field(repr=False)

    def __post_init__(self) -> None:
        if type(self.seal) is not _Seal:
            raise TypeError("a CheckedGoal is made by a gate alone: call Gate.check, Gate.brake or Gate.begin")
        for values in (self.joints, self.posture, self.displacement, self.stop):
            values.setflags(write=False)


TORQUE_OFF = " (torque is off)"
CUT_POWER = " (torque could not be switched off: cut the power)"


SUSPENDED_S = 0.5
"""[s] Idle time within a tick that shows a suspended process. The slowest robot sleeps for 0.02 s."""
DID_NOT_RUN = "this process did not run for {:.1f} s: it was suspended, or blocked by a port or a disk"
FALL_DRIVE = 0.3
"""Share of the drive during a fall. In simulated falls of OP3 the peak joint load was an eighth below that at full
drive, as without torque."""
ARMING_READS = 5
"""Reads of a silent bus before arming fails."""


class Torque(Enum):
    """Torque of the servos, as far as the guard knows."""

    OFF = "off"
    ON = "on"
    UNCONFIRMED = "unconfirmed"
    """On from an earlier process, or not confirmed as off."""


def text_of(error: BaseException) -> str:
    """An exception as a reason. A LookupError is named, since its text is a bare key."""
    text, kind = str(error).rstrip("."), type(error).__name__
    return f"{kind}: {text}" if text and isinstance(error, LookupError) else text or kind


class Guard:
    """The servos of one robot: read, write, torque, and the latched stop.

    Only a `CheckedGoal` is written, once, in order, with torque on. A stop keeps its first reason and one later fault.
    """

    def __init__(self, *, bus: ServoBus, joint_map: JointMap, limits: GuardLimits | None = None) -> None:
        self._bus, self._map = bus, joint_map
        self.limits = limits or GuardLimits()
        self.health = ServoHealth(joint_map, self.limits)
        self.torque = Torque.OFF
        self.stop: Stop | None = None
        self.states: ServoStates | None = None
        self.goal: CheckedGoal | None = None
        """The goal written last."""
        self.sent: TickArray | None = None
        """Its ticks, (n,)."""
        self._checked_at: float | None = None  # [s] of the present tick
        self._idle = 0.0  # [s] idle time then
        self._drive_reduced = False

    @property
    def is_silent(self) -> bool:
        """True if no servo of a bus has answered in this cycle."""
        return self.states is not None and self.health.buses.quietest(self.states)[0] > 0.0

    @property
    def may_go_to_rest(self) -> bool:
        """True unless a fault concerns the servos that carry the robot."""
        return self.stop is None or self.stop.is_bearable

    def present(self) -> FloatArray:
        """The present posture, rad (n,), before arming.

        Raises GuardError when torque is on, or with all servos that are not well; BusError when the bus fails.
        """
        if self.torque is not Torque.OFF or self.stop is not None:
            raise self._impossible("arming")
        with self._arming():
            for _ in range(ARMING_READS):
                self.states = states = self._bus.read()
                if not self.is_silent and (states.imu is None or states.imu.valid):
                    break
            self.torque = Torque.UNCONFIRMED  # a servo that answers may have it from before
            self.health.refuse_unhealthy(states)
            return self._map.to_radians(states.position)

    def arm(self, goal: CheckedGoal) -> None:
        """Write the present posture as the goal, then switch torque on. goal: the gate's, for the posture of `present`.

        Raises GuardError, or BusError when the bus fails. A failure while torque may be on is latched.
        """
        states = self.states
        if states is None or self.torque is not Torque.UNCONFIRMED:
            raise self._impossible("arming")
        with self._arming():
            if self.stop is not None:
                raise self._impossible("arming")
            self._refuse_copy(goal)
            if not np.array_equal(self._map.to_ticks(goal.joints), states.position):
                raise GuardError("the gate moved the present posture", then="Begin the gate where the robot is")
            self._send(goal)
            self._checked_at = None
            self.torque = Torque.ON  # before the command: any interrupt from here on switches it off
            self._bus.torque(True)

    def read(self) -> ServoStates:
        """Read the servos. Raises BusError."""
        return self._bus.read()

    def check(self, states: ServoStates, now: float, idle: float) -> None:
        """Check the states of a tick at `now`, s; idle: see `Clock.idle`, s.

        Faults are latched, and torque goes off if the robot cannot brake. A long pause is latched too, since the servos
        have stopped.
        """
        self._refuse_pause(now, idle)
        self._checked_at, self._idle = now, idle
        self.states = states
        goal = self.goal
        deflected = None if goal is None or goal.posture.tobytes() == goal.joints.tobytes() else goal.posture
        fault = self.health.check(states, None if self._drive_reduced else self.sent, deflected)
        if fault is not None and fault.category is StopCategory.TORQUE_OFF:
            self.switch_off(fault.cause, fault.reason)
        elif fault is not None and fault.category is StopCategory.BRAKE_AND_TORQUE_OFF:
            self.latch(fault.cause, fault.reason)

    def write(self, goal: CheckedGoal) -> None:
        """Send the gate's next goal. Raises GuardError for any other, BusError when the bus fails."""
        last = self.goal
        if type(goal) is not CheckedGoal or last is None or goal.seal is not last.seal or goal.seal.before is not last:
            raise GuardError("only the next goal of the gate is written", where="guard", found=type(goal).__name__)
        self._refuse_copy(goal)
        if self.torque is not Torque.ON:
            raise self._impossible("writing")
        self._send(goal)

    @staticmethod
    def _refuse_copy(goal: CheckedGoal) -> None:
        if goal.seal.last is not goal:
            raise GuardError("only the goal that the gate made last is written", where="guard", found="another goal")

    def reduce_drive(self) -> None:
        """Limit the drive to FALL_DRIVE, so that a falling robot is compliant. Following errors are no longer judged.
        If the bus fails, torque goes off."""
        try:
            self._bus.limit_drive(FALL_DRIVE)
            self._drive_reduced = True
        except Exception as error:  # noqa: BLE001 - a robot that falls is not left with its full drive
            self.switch_off(StopCause.BUS, text_of(error))

    def latch(self, cause: StopCause, reason: str) -> None:
        """Latch a stop. The first reason stays; bearable causes are added up to the first fault."""
        stop = self.stop
        if stop is None:
            self.stop = Stop(cause, reason)
            return
        known = cause in FAULTLESS or (cause in (stop.cause, stop.then) and cause is not StopCause.LIMB_LOST)
        if not known and reason not in stop.reason and (stop.then is None or stop.then in BEARABLE):
            self.stop = replace(stop, reason=f"{stop.reason}, then: {reason}", then=cause)

    def switch_off(self, cause: StopCause, reason: str) -> None:
        """Latch a stop of category 0, then switch torque off. The latch is first, so that an interrupt of the command
        leaves the reason and the advice to cut the power."""
        then = None
        if self.stop is not None:
            first, then = self.stop.reason.removesuffix(TORQUE_OFF).removesuffix(CUT_POWER), self.stop.then
            if reason in first:
                reason = first
            else:
                reason, then = f"{first}, then: {reason}", cause
            cause = self.stop.cause
        self.stop = Stop(cause, reason + CUT_POWER, powered=True, then=then)
        with suppress(Exception):  # then it stays latched as powered
            self._torque_off()

    def release(self) -> None:
        """Switch torque off. A failure or an interrupt is latched and raised, and torque is switched off again."""
        try:
            self._torque_off()
        except BaseException as error:
            if self.stop is None or not self.stop.powered:
                self.switch_off(StopCause.BUS, text_of(error))
            raise

    def _refuse_pause(self, now: float, idle: float) -> None:
        """Latch a tick that comes too late. With simulated servos a suspension is only a warning."""
        if self._checked_at is None:
            return
        pause, idle, most = now - self._checked_at, idle - self._idle, self.limits.max_pause
        if isinf(most):
            if idle > SUSPENDED_S:
                self.health.warnings.add(f"warning: {DID_NOT_RUN.format(idle)}; real servos would stop")
        elif idle > max(SUSPENDED_S, most):
            self.latch(StopCause.STALE_GOAL, DID_NOT_RUN.format(idle))
        elif pause > most:
            self.latch(StopCause.STALE_GOAL, f"no tick for {pause:.3g} s, allowed {most:g} s")

    @contextmanager
    def _arming(self) -> Iterator[None]:
        try:
            yield
        except BaseException as error:
            if self.torque is not Torque.ON:
                with suppress(Exception):
                    self._torque_off()
            if self.torque is Torque.UNCONFIRMED and not (self.states is not None and self.states.valid.any()):
                self.torque = Torque.OFF  # no servo answers: there is nothing to switch
            if self.torque is not Torque.OFF:
                self.switch_off(StopCause.BUS, text_of(error))
            raise

    def ticks_of(self, goal: CheckedGoal) -> TickArray:
        """The ticks (n,) of a goal. A lost servo keeps its last goal."""
        ticks = self._map.to_ticks(goal.joints)
        if self.sent is not None and self.health.lost.any():
            ticks = np.where(self.health.lost, self.sent, ticks)
        return ticks

    def _send(self, goal: CheckedGoal) -> None:
        ticks = self.ticks_of(goal)
        self._bus.write(ServoGoals(ticks))
        self.goal, self.sent = goal, ticks

    def _torque_off(self) -> None:
        self.torque = Torque.UNCONFIRMED
        self._bus.torque(False)
        self.torque = Torque.OFF
        stop = self.stop
        if stop is not None and stop.powered:
            reason = stop.reason.removesuffix(CUT_POWER).replace(" Cut the power by hand", "")
            self.stop = replace(stop, reason=reason + TORQUE_OFF, powered=False)

    def _impossible(self, what: str) -> GuardError:
        then = f"It stopped because: {self.stop.reason}" if self.stop else ""
        found = f"torque {self.torque.value}" + (", stopped" if self.stop else "")
        return GuardError(f"{what} is not possible now", where="guard", found=found, then=then)
