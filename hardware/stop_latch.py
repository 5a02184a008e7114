"""The stop of a guard: its first reason stays, what comes after it is added, and how long the way to its end may be."""

from dataclasses import replace

from hardware.guard_state import GuardLimits, Stop, StopCause

TORQUE_OFF = " (torque is off)"
CUT_POWER = " (torque could not be switched off: cut the power)"
GOING_HOME = (StopCause.REQUESTED, StopCause.STALE_GOAL, StopCause.SOURCE)
"""Stops that are no fault of the robot: it may go where it is parked."""


class StopLatch:
    """`stop`: the latched one, or None. `braking` counts the ticks of its end."""

    def __init__(self, limits: GuardLimits) -> None:
        self.stop: Stop | None = None
        self._limits = limits
        self.begin()

    def begin(self) -> None:
        """The way to a stand begins, be it without a stop."""
        self._braked = self._homed = 0
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

    def cut(self, cause: StopCause, reason: str, time: float, *, powered: bool) -> None:
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
    def may_go_home(self) -> bool:
        """Whether a stopping robot may go where it is parked: nothing is wrong with it, and it does not take for
        ever."""
        well = self.stop is None or (self.stop.cause in GOING_HOME and self.stop.then is None)
        return well and self._homed < self._limits.max_home_ticks

    def spend(self, *, stood: bool) -> int | None:
        """One more tick on the way; stood: the robot stands. Ticks of braking so far when there may be no more."""
        self._stood |= stood
        if self._stood and self.may_go_home:
            self._homed += 1  # at the end of these it stands where it is
        elif self._braked == self._limits.max_brake_ticks:
            return self._braked
        else:
            self._braked += 1
        return None
