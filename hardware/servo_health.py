"""What the servos say of themselves, held against what is tolerated: in words that name every servo concerned."""

import numpy as np

from hardware.arrays import BoolArray, FloatArray, TickArray
from hardware.bus import ServoStates
from hardware.errors import BusError, GuardError, HardwareError, describe
from hardware.few_values import all_of
from hardware.guard_state import GuardLimits, StopCause
from hardware.joint_map import JointMap
from hardware.line_health import LineHealth
from hardware.servo_lag import ExpectedWay
from hardware.servo_levels import ServoLevels
from hardware.servo_warnings import ServoWarnings
from hardware.servo_watched import Row, name_servos, watched

UNHEARD = "Check power, wiring and the bus of the profile, or whether the host is too busy"


class ServoHealth:
    """Judges the states of one robot's servos. A temperature or voltage that is no longer known (NaN) is a complaint;
    one that never was is none: there are buses without. A current that is not known is none."""

    def __init__(self, joint_map: JointMap, limits: GuardLimits) -> None:
        self._joint_map = joint_map
        self._rows = watched(limits)
        self._lines = LineHealth(joint_map)
        self._way = ExpectedWay(np.array(limits.lag or (0.0,) * len(joint_map)))
        count = len(joint_map)
        self._levels = ServoLevels([row.stop for row in self._rows], [row.patience for row in self._rows], count)
        self.warnings = ServoWarnings(joint_map.servos, self._rows, limits.slow_share)
        warned = self.warnings.levels
        self._least = np.maximum(self._levels.least, warned.least)  # within these there is nothing to say
        self._most = np.minimum(self._levels.most, warned.most)
        self._seen = np.zeros((len(self._rows), count))
        self._known = np.zeros(self._seen.shape, dtype=np.bool_)  # what was told at least once
        self._zeros = np.zeros(count)
        self._limited = np.isfinite(self._levels.least) | np.isfinite(self._levels.most)
        self._all_known = np.ones(self._seen.shape, dtype=np.bool_)

    @property
    def slow(self) -> float:
        """Share of all speeds, to 1, at which the robot spares servos that are too warm or draw too much."""
        return self.warnings.slow

    def complaint(
        self, states: ServoStates, sent: TickArray | None, held: FloatArray | None = None
    ) -> tuple[StopCause, str] | None:
        """Why the robot must stop, or None. sent (n,): goal ticks of the last tick. held (n,): rad, where these goals
        hold the joints under their load, if not there.

        Raises BusError where a bus is deaf: there is no way to brake on it.
        """
        lost = self._lines.lost(states)
        if lost is not None:
            raise BusError(lost)
        self._look(states, sent if sent is None or held is None else self._aimed(sent, held))
        rough = self._lines.rough(states)
        if rough is not None:
            return StopCause.BUS, rough
        seen, levels, warnings = self._seen, self._levels, self.warnings
        if not (levels.waiting or warnings.busy) and self._all_well():
            warnings.pass_over(states.time)
            return None
        warnings.look(seen, states.time)
        wrong = self._wrong(states.time)
        return next(iter(self._complaints(wrong)), None) if wrong.any() else None

    def refuse_unhealthy(self, states: ServoStates) -> None:
        """Raise for servos that cannot be armed: BusError when none answers, GuardError with all that is wrong."""
        missing = ~states.valid
        if missing.all():
            raise BusError(describe(what="no servo answers", where="arming", then=UNHEARD))
        self._levels.forget()
        self._look(states, None)
        age = self._rows[Row.AGE]
        names = name_servos(self._joint_map.servos, missing, age.tell, states.age)
        problems = [f"servo does not answer: {names}"] if missing.any() else []
        problems += [text for _, text in self._complaints(self._wrong(states.time) & states.valid)]
        if problems:
            raise GuardError(
                describe(
                    what="not every servo is well",
                    where="arming",
                    found="; ".join(problems),
                    then="It was not armed",
                )
            )

    def _aimed(self, sent: TickArray, held: FloatArray) -> TickArray:
        """Ticks (n,) where shafts are to be held: those that were sent, where nothing is held beside its goal."""
        if all_of(np.abs(self._joint_map.to_radians(sent) - held) <= self._joint_map.tick_rad):
            return sent
        try:
            return self._joint_map.to_ticks(held)
        except HardwareError:  # beyond the servos' travel
            return sent

    def _look(self, states: ServoStates, sent: TickArray | None) -> None:
        """Take down what is watched."""
        seen = self._seen
        seen[Row.ALERT], seen[Row.AGE] = states.alert, states.age
        seen[Row.TEMPERATURE], seen[Row.VOLTAGE] = states.temperature, states.voltage
        np.fmax(np.abs(states.current), self._zeros, out=seen[Row.CURRENT])  # 0 where it is not known
        if sent is None:  # before goals are sent torque may well be off
            seen[Row.LIMP] = seen[Row.FAR] = seen[Row.STILL_FAR] = 0.0
            self._way.forget()
            return
        np.logical_not(states.driven, out=seen[Row.LIMP])
        far = np.abs(self._joint_map.turned(self._way.off(states.time, sent, states.position)))
        if all_of(states.valid):
            seen[Row.FAR] = seen[Row.STILL_FAR] = far
        else:  # where a silent servo was is not where it is: what was known of it last still stands
            heard = self._joint_map.heard(states.valid)
            seen[Row.FAR] = seen[Row.STILL_FAR] = np.where(heard, far, seen[Row.FAR])

    def _all_well(self) -> bool:
        """Whether there is nothing to say of any servo, not even that something lasts for too long."""
        seen = self._seen
        inside = (seen >= self._least) & (seen <= self._most)
        if all_of(inside):
            self._known = self._all_known
            return True
        unknown = np.isnan(seen)
        if not (inside | (unknown & ~(self._known & self._limited))).all():
            return False
        self._known = self._known | ~unknown
        return True

    def _wrong(self, now: float) -> BoolArray:
        """Which servos (rows, n) are beyond which bound."""
        unknown = np.isnan(self._seen)
        wrong = self._levels.beyond(self._seen, now) | (unknown & self._known & self._limited)
        self._known = self._known | ~unknown
        return np.asarray(wrong)

    def _complaints(self, wrong: BoolArray) -> list[tuple[StopCause, str]]:
        """All complaints about the servos (rows, n), in order of the rows."""
        servos = self._joint_map.servos
        return [
            (row.cause, f"servo {row.complaint} {name_servos(servos, which, row.tell, values)}")
            for row, which, values in zip(self._rows, wrong, self._seen, strict=True)
            if which.any()
        ]
