"""The guard: it alone switches torque on and writes to the bus. It checks what servos report, and latches a stop.

The guard is passive: it reads, writes and switches when it is called, and calls no other part. What a robot does next
is decided by the state machine of the run (`retarget.run.supervisor`), which reads the latch.
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
    """One gate's proof that a goal is its own: only `retarget.safety.gate` imports it (tests/test_house.py).

    last: the goal that the gate made last; a copy of it is another one. before: the goal from which it was made.
    """

    last: "CheckedGoal | None" = None
    before: "CheckedGoal | None" = None


@dataclass(frozen=True, eq=False, slots=True)
class CheckedGoal:
    """A goal of one tick.

    joints (n,): rad, servo order, what is sent. posture (n,): rad, in which these goals hold the joints under their
    load; the same without deflection compensation. displacement (n,): rad, of joints in this tick, which is left to
    brake. passed: the goal is the target that was checked, not the next posture of the braking trajectory. compensated:
    what the deflection compensation needs for the next goal. The arrays are read-only. Raises TypeError when anything
    but a gate makes one.
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
"""Idle time within a tick, s, from which on the process was suspended: a tick of the slowest robot sleeps for 0.02 s,
and a machine that is merely busy takes the processor away for less."""
DID_NOT_RUN = "this process did not run for {:.1f} s: it was suspended, or blocked by a port or a disk"
YIELDING = 0.3
"""Share of the drive of a robot that falls. In 12 simulated falls of OP3 its joints bore an eighth less at their peaks
than with all of it, and as much as without torque."""
ARMING_READS = 5
"""Cycles in which a bus that is silent when the robot is armed is read again."""


class Torque(Enum):
    """Whether the servos of a robot are driven, as far as the guard knows."""

    OFF = "off"
    """Off, or not switched by this guard; nothing is written."""
    ON = "on"
    UNCONFIRMED = "unconfirmed"
    """Not known: servos may have it from an earlier process, or not every one has confirmed that it is off."""


def text_of(error: BaseException) -> str:
    """An exception as the reason of a stop. Of a key that is not there, the text alone would be a riddle."""
    text, kind = str(error).rstrip("."), type(error).__name__
    return f"{kind}: {text}" if text and isinstance(error, LookupError) else text or kind


class Guard:
    """The servos of one robot: read, write, torque, and the latched stop.

    Nothing is written but a `CheckedGoal`, each once and in order, and nothing while torque is off. The first reason of
    a stop stays; one later fault is added to it. Where a servo does not confirm that its torque is off, the robot is
    not safe, and the stop's reason says so.
    """

    def __init__(self, *, bus: ServoBus, joint_map: JointMap, limits: GuardLimits | None = None) -> None:
        self._bus, self._map = bus, joint_map
        self.limits = limits or GuardLimits()
        self.health = ServoHealth(joint_map, self.limits)
        self.torque = Torque.OFF
        self.stop: Stop | None = None
        """The latched stop."""
        self.states: ServoStates | None = None
        """The servo states read last."""
        self.goal: CheckedGoal | None = None
        """The goal written last."""
        self.sent: TickArray | None = None
        """Its ticks, (n,)."""
        self._checked_at: float | None = None  # [s] of the present tick
        self._idle = 0.0  # [s] idle time then
        self._yields = False

    @property
    def is_silent(self) -> bool:
        """Whether no servo of a bus has answered in the present cycle."""
        return self.states is not None and self.health.buses.quietest(self.states)[0] > 0.0

    @property
    def may_go_to_rest(self) -> bool:
        """True if the robot may go to rest: nothing is wrong with what carries it."""
        return self.stop is None or self.stop.is_bearable

    def present(self) -> FloatArray:
        """The present posture of servos that can be armed, rad (n,).

        Raises GuardError when torque is on or a servo is missing, alarmed or unreadable (all of them named), BusError
        when the bus fails.
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
        """Write the present posture as the goal, then switch torque on, after `present`. goal: of the gate, for the
        present posture.

        Raises GuardError for another goal, BusError when the bus fails; a failure while torque may be on is latched.
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
        """Read the servos, before `check`. Raises BusError when the bus fails."""
        return self._bus.read()

    def check(self, states: ServoStates, now: float, idle: float) -> None:
        """Check the states of a tick at `now`, s; idle: idle time by then, s (see `Clock.idle`).

        What is wrong with a servo is latched; where the robot cannot brake, torque goes off. A pause between two ticks
        is latched, too: the servos stand by then, and the goals have moved on."""
        self._refuse_pause(now, idle)
        self._checked_at, self._idle = now, idle
        self.states = states
        goal = self.goal
        deflected = None if goal is None or goal.posture.tobytes() == goal.joints.tobytes() else goal.posture
        fault = self.health.check(states, None if self._yields else self.sent, deflected)
        if fault is not None and fault.category is StopCategory.TORQUE_OFF:
            self.switch_off(fault.cause, fault.reason)
        elif fault is not None and fault.category is StopCategory.BRAKE_AND_TORQUE_OFF:
            self.latch(fault.cause, fault.reason)

    def write(self, goal: CheckedGoal) -> None:
        """Send a goal to the servos. Raises GuardError for anything but the gate's next goal, BusError when the bus
        fails."""
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

    def give_way(self) -> None:
        """Allow the servos no more than YIELDING of their drive: a robot that falls gives way where it meets the floor.
        They no longer keep up with their goals then, and that is not judged. Raises nothing: where the bus fails,
        torque goes off."""
        try:
            self._bus.limit_drive(YIELDING)
            self._yields = True
        except Exception as error:  # noqa: BLE001 - a robot that falls is not left with its full drive
            self.switch_off(StopCause.BUS, text_of(error))

    def latch(self, cause: StopCause, reason: str) -> None:
        """Latch a stop. The first reason stays; the first fault of the robot after it is added, and so are those
        before it with which the robot still goes to rest."""
        stop = self.stop
        if stop is None:
            self.stop = Stop(cause, reason)
            return
        known = cause in FAULTLESS or (cause in (stop.cause, stop.then) and cause is not StopCause.LIMB_LOST)
        if not known and reason not in stop.reason and (stop.then is None or stop.then in BEARABLE):
            self.stop = replace(stop, reason=f"{stop.reason}, then: {reason}", then=cause)

    def switch_off(self, cause: StopCause, reason: str) -> None:
        """Switch torque off at once and latch it (stop category 0): there is no way or no time to brake. The stop is
        latched before the command, so that an interrupt of it leaves the reason, and that the power is to be cut."""
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
        """Switch torque off; a latched stop stays latched. A failure of the bus, or an interrupt, is latched if none
        was before, torque is switched off once more, and it is raised."""
        try:
            self._torque_off()
        except BaseException as error:
            if self.stop is None or not self.stop.powered:
                self.switch_off(StopCause.BUS, text_of(error))
            raise

    def _refuse_pause(self, now: float, idle: float) -> None:
        """Latch a tick at `now`, s, that comes too long after the one before. Servos that wait for a slow host
        (simulated ones) need no stop: there a suspension is a warning."""
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
        """After a failure torque is off; a servo that answers may have had it from before."""
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
        """The ticks (n,) that are sent for a goal. A lost servo gets the goal that it had: one that is back would
        jump."""
        ticks = self._map.to_ticks(goal.joints)
        if self.sent is not None and self.health.lost.any():
            ticks = np.where(self.health.lost, self.sent, ticks)
        return ticks

    def _send(self, goal: CheckedGoal) -> None:
        ticks = self.ticks_of(goal)
        self._bus.write(ServoGoals(ticks))
        self.goal, self.sent = goal, ticks

    def _torque_off(self) -> None:
        """Switch torque off. What a latched stop said about torque that may be on is no longer so."""
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
