"""What the servos say of themselves, held against what is tolerated: in words that name every servo concerned."""

from collections.abc import Callable

import numpy as np

from hardware.arrays import BoolArray, FloatArray, TickArray
from hardware.bus import ServoAlert, ServoStates
from hardware.errors import BusError, GuardError, describe
from hardware.guard_state import GuardLimits, StopCause
from hardware.joint_map import JointMap

UNHEARD = "Check power, wiring and the bus of the profile, or whether the host is too busy"


class ServoHealth:
    """Judges the states of one robot's servos. A temperature or voltage that is no longer known (NaN) is a complaint;
    one that never was is none: there are buses without."""

    def __init__(self, joint_map: JointMap, limits: GuardLimits) -> None:
        self._servos = joint_map.servos
        self._joint_map = joint_map
        low, high = limits.voltage
        far = np.full(len(joint_map), limits.following_error)  # (n,) [rad]
        # What is watched, a row each: the cause, least and most, the complaint, and how a value is told.
        table: tuple[tuple[StopCause, object, object, str, Callable[[int, float], str]], ...] = (
            (StopCause.SERVO_ALERT, 0, 0, "reports", lambda _, value: _alert_text(int(value))),
            (StopCause.SERVO_LOST, 0, limits.max_age, f"has not answered for more than {limits.max_age:g} s:", _untold),
            (
                StopCause.SERVO_LIMP,
                0,
                0,
                "does not follow its goals (started anew, or stopped by its watchdog):",
                _untold,
            ),
            (
                StopCause.TEMPERATURE,
                -np.inf,
                limits.max_temperature,
                f"is hotter than {limits.max_temperature:g} degrees Celsius:",
                lambda _, value: _known(f"{value:.0f}"),
            ),
            (
                StopCause.VOLTAGE,
                low,
                high,
                f"has a supply outside {low:g} to {high:g} V:",
                lambda _, value: _known(f"{value:.1f} V"),
            ),
            (
                StopCause.FOLLOWING_ERROR,
                -far,
                far,
                f"is more than {limits.following_error:g} rad from its goal:",
                lambda _, value: f"{abs(value):.2f} rad",
            ),
        )
        self._told = [(cause, complaint, tell) for cause, _, _, complaint, tell in table]
        self._seen = np.zeros((len(table), far.size))
        self._known = np.zeros(self._seen.shape, dtype=np.bool_)  # what was told at least once
        self._least = np.array([np.broadcast_to(np.asarray(least), far.shape) for _, least, *_ in table])
        self._most = np.array([np.broadcast_to(np.asarray(most), far.shape) for _, _, most, *_ in table])

    def complaint(self, states: ServoStates, sent: TickArray | None) -> tuple[StopCause, str] | None:
        """Why the robot must stop, or None. sent (n,): goal ticks of the last tick."""
        wrong = self._wrong(states, sent)
        if not wrong.any():
            return None
        wrong[-1] &= self._joint_map.heard(states.valid)  # where a silent servo was is not where it is
        return next(iter(self._complaints(wrong)), None)

    def refuse_unhealthy(self, states: ServoStates) -> None:
        """Raise for servos that cannot be armed: BusError when none answers, GuardError with all that is wrong."""
        missing = ~states.valid
        if missing.all():
            raise BusError(describe(what="no servo answers", where="arming", then=UNHEARD))
        problems = [self._name(missing, "does not answer:", _untold, states.age)] if missing.any() else []
        problems += [text for _, text in self._complaints(self._wrong(states, None) & states.valid)]
        if problems:
            raise GuardError(
                describe(
                    what="not every servo is well",
                    where="arming",
                    found="; ".join(problems),
                    then="Torque was not switched on",
                )
            )

    def _wrong(self, states: ServoStates, sent: TickArray | None) -> BoolArray:
        """Which servos (rows, n) are beyond which bound."""
        seen = self._seen
        seen[0], seen[1], seen[3], seen[4] = states.alert, states.age, states.temperature, states.voltage
        # Before goals are sent torque may well be off.
        seen[2] = 0 if sent is None else ~states.driven
        seen[5] = 0 if sent is None else self._joint_map.turned(states.position - sent)
        unknown = np.isnan(seen)
        self._known |= ~unknown
        return np.asarray((seen < self._least) | (seen > self._most) | (unknown & self._known))

    def _complaints(self, wrong: BoolArray) -> list[tuple[StopCause, str]]:
        """All complaints about the servos (rows, n), in order of the rows."""
        return [
            (cause, self._name(which, complaint, tell, values))
            for (cause, complaint, tell), which, values in zip(self._told, wrong, self._seen, strict=True)
            if which.any()
        ]

    def _name(self, which: BoolArray, complaint: str, tell: Callable[[int, float], str], values: FloatArray) -> str:
        """One text that names every servo of the mask, for example: servo reports l_el (id 6) OVERLOAD."""
        named = []
        for index in np.flatnonzero(which).tolist():
            servo = self._servos[index]
            named.append(f"{servo.joint} (id {servo.id}) {tell(index, float(values[index]))}".rstrip())
        return f"servo {complaint} " + ", ".join(named)


def _untold(index: int, value: float) -> str:
    return ""


def _known(value: str) -> str:
    return "not known" if value.startswith("nan") else value


def _alert_text(bits: int) -> str:
    """Names of the alert bits; bits that the maker leaves undefined as a number."""
    known = [alert.name or "" for alert in ServoAlert if bits & alert]
    rest = bits & ~sum(ServoAlert)
    return "+".join([*known, *([f"0x{rest:02x}"] if rest else [])])
