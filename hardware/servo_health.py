"""Servo health: values against bounds, first warnings, then stops; and bus health: silence and damaged answers."""

from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass
from enum import IntEnum
from math import inf

import numpy as np

from hardware.arrays import BoolArray, FloatArray, TickArray
from hardware.bus import UNREAD_AFTER_S, ServoStates, alert_names
from hardware.errors import BusError, GuardError, HardwareError
from hardware.guard_state import GuardLimits, StopCategory, StopCause
from hardware.heat import HeatForecast
from hardware.joint_map import JointMap
from hardware.servo import ServoSpec

Bounds = tuple[float, float]

ANYTHING: Bounds = (-inf, inf)
EASE = 0.1
"""Share of its level by which a current or following error must fall before a warning ends."""
COOLER = 2.0
"""[degrees Celsius] The same for temperatures, reported in whole degrees."""
STEADIER = 0.2
"""[V] The same for voltages."""
MOST_OF_ALL = 3
"""Servos up to which all are named."""


@dataclass(frozen=True, kw_only=True)
class Watched:
    """One quantity of every servo. stop: bounds beyond which the robot stops after `debounce`, s. warn: bounds of a
    warning, which ends `ease` within them. slows: the warning slows the robot. text: the fault, with bounds {0} and
    {1}. value: format of a value. quantity: name of a value that must remain readable."""

    cause: StopCause
    stop: Bounds
    text: str
    value: str = ""
    debounce: float = 0.0
    warn: Bounds = ANYTHING
    ease: float = 0.0
    slows: bool = False
    quantity: str = ""

    def in_words(self, value: float) -> str:
        """A value in words."""
        if self.cause is StopCause.SERVO_ALERT:
            return "+".join(alert_names(int(value)))
        return self.value.format(value)


def watched(limits: GuardLimits) -> tuple[Watched, ...]:
    """The watched quantities, in the order of `WatchedRow`."""

    def eased(level: float) -> float:
        return EASE * level if np.isfinite(level) else 0.0

    return (
        Watched(cause=StopCause.SERVO_ALERT, stop=(0, 0), text="reports"),
        Watched(
            cause=StopCause.SERVO_LOST,
            stop=(0, limits.max_age),
            warn=(0, limits.warn_age),
            text="has not answered for more than {1:g} s:",
        ),
        Watched(
            cause=StopCause.SERVO_LIMP,
            stop=(0, 0),
            text="does not follow its goals (restarted, or stopped by its watchdog):",
        ),
        Watched(
            cause=StopCause.TEMPERATURE,
            stop=(-inf, limits.max_temperature),
            warn=(-inf, limits.warn_temperature),
            text="is hotter than {1:g} degrees Celsius:",
            value="{:.0f}",
            ease=COOLER,
            slows=True,
            quantity="temperature",
        ),
        Watched(
            cause=StopCause.VOLTAGE,
            stop=limits.voltage,
            warn=limits.warn_voltage,
            text="has a supply outside {0:g} to {1:g} V:",
            value="{:.1f} V",
            ease=STEADIER,
            quantity="voltage",
        ),
        Watched(
            cause=StopCause.CURRENT,
            stop=(0, limits.max_current),
            warn=(0, limits.warn_current),
            text=f"draws more than {{1:g}} A for {limits.current_time:g} s:",
            value="{:.2f} A",
            debounce=limits.current_time,
            ease=eased(limits.warn_current),
            slows=True,
        ),
        Watched(  # a large following error at once, a smaller one after sustained_time
            cause=StopCause.FOLLOWING_ERROR,
            stop=(0, limits.following_error),
            text="is more than {1:g} rad from its goal:",
            value="{:.2f} rad",
        ),
        Watched(
            cause=StopCause.FOLLOWING_ERROR,
            stop=(0, limits.sustained_error),
            warn=(0, limits.warn_following_error),
            text=f"is more than {{1:g}} rad from its goal for {limits.sustained_time:g} s:",
            value="{:.2f} rad",
            debounce=limits.sustained_time,
            ease=eased(limits.warn_following_error),
        ),
    )


class WatchedRow(IntEnum):
    """Rows of the array of watched values (rows, n)."""

    ALERT, AGE, LIMP, TEMPERATURE, VOLTAGE, CURRENT, FAR, STILL_FAR = range(8)


def name_servos(servos: Sequence[ServoSpec], row: Watched, which: BoolArray, values: FloatArray) -> str:
    """Name the servos of a mask (n,) with their values (n,), for example: l_el (id 6) OVERLOAD. If all are masked, only
    their number and range are given."""
    if which.all() and len(servos) > MOST_OF_ALL:
        found = list(dict.fromkeys(row.in_words(float(value)) for value in np.sort(values)))
        values_text = " and ".join(found) if len(found) < MOST_OF_ALL else f"{found[0]} to {found[-1]}"
        return f"all {len(servos)} servos {values_text}".rstrip()
    places = np.flatnonzero(which).tolist()
    return ", ".join(f"{servos[place].label} {row.in_words(float(values[place]))}".rstrip() for place in places)


@dataclass(frozen=True)
class ServoFault:
    """A fault of servos or of their bus, and the required stop category."""

    category: StopCategory
    cause: StopCause
    reason: str


TIME_ROUND_OFF = 1e-9
"""[s] Of sums of ticks."""


class ServoLevels:
    """Bounds of values (rows, n), and a debounce time, s, per row. NaN is within every bound."""

    def __init__(self, bounds: Sequence[tuple[float, float]], debounce: Sequence[float], count: int) -> None:
        self.least = np.array([[least] * count for least, _ in bounds])  # (rows, n)
        self.most = np.array([[most] * count for _, most in bounds])
        self._debounce = np.array(debounce)[:, None] - TIME_ROUND_OFF
        self._nothing = np.full(self.least.shape, np.inf)
        self._since = self._nothing  # [s] when each went beyond, infinite where it is within
        self.count = 0
        """Values beyond their bounds."""

    def beyond(self, seen: FloatArray, now: float) -> BoolArray:
        """The mask (rows, n) of values beyond their bounds for their whole debounce time at `now`, s."""
        out: BoolArray = (seen < self.least) | (seen > self.most)
        self.count = int(np.count_nonzero(out))
        if not self.count:
            self._since = self._nothing
            return out
        self._since = np.where(out, np.minimum(self._since, now), np.inf)
        late = now - self._since >= self._debounce
        return np.asarray(out & late)

    def forget(self) -> None:
        """Restart all debounce times."""
        self._since, self.count = self._nothing, 0


class ExpectedRange:
    """Range of n shafts between the response of a position loop with its lag and the goal."""

    def __init__(self, lag: FloatArray) -> None:
        """lag (n,): s."""
        self._lag = np.maximum(lag, 1e-9)
        self._at: FloatArray | None = None
        self._time = 0.0

    def forget(self) -> None:
        """Restart the response at the next goal."""
        self._at = None

    def error(self, time: float, goal: TickArray, position: TickArray) -> FloatArray:
        """The distance (n,), ticks, of `position` from the range of goals held until `time`, s."""
        end, here = goal.astype(np.float64), position.astype(np.float64)
        if self._at is None:
            self._at = end
        else:
            self._at = end + (self._at - end) * np.exp((self._time - time) / self._lag)
        self._time = time
        lowest, highest = np.minimum(self._at, end), np.maximum(self._at, end)
        return np.asarray(here - np.minimum(np.maximum(here, lowest), highest))


RAMP_S = 0.4
"""[s] Duration of the speed ramp from full to slow, and back."""
CALM_S = 1.0
"""[s] Time within bounds before a warning ends."""
MOST_NEWS = 100
"""Bound of the kept texts."""


class ServoWarnings:
    """Warnings about one robot's servos, each reported once. share: speed override during one that slows the robot.

    speed_override: present value. active (rows, n): mask of active warnings.
    """

    def __init__(self, servos: Sequence[ServoSpec], rows: Sequence[Watched], share: float) -> None:
        self._servos, self._rows = tuple(servos), tuple(rows)
        self._share = share
        bounds, ease = [row.warn for row in rows], np.array([[row.ease] for row in rows])
        self.levels = ServoLevels(bounds, [row.debounce for row in rows], len(servos))
        self._calm_least, self._calm_most = self.levels.least + ease, self.levels.most - ease
        self._slows = np.array([row.slows for row in rows])
        self.active = np.zeros(self.levels.least.shape, dtype=np.bool_)
        self._beyond_at = np.full(self.active.shape, -np.inf)  # [s] when each was last beyond its calm bounds
        self._at: float | None = None  # [s] of the last look
        self._news: list[str] = []
        self._count = 0  # active warnings
        self.speed_override = 1.0

    @property
    def busy(self) -> bool:
        """True if a warning is active or pending, or the robot is slowed."""
        return self.speed_override < 1.0 or self.levels.count > 0 or self._count > 0

    def look(self, seen: FloatArray, now: float) -> None:
        """Judge values (rows, n) at `now`, s."""
        beyond = self.levels.beyond(seen, now)
        if not self.busy:
            self._at = now
            return
        began = beyond & ~self.active
        calm = (seen >= self._calm_least) & (seen <= self._calm_most)
        self._beyond_at = np.where(calm, self._beyond_at, now)
        ended = self.active & (now - self._beyond_at >= CALM_S)
        self.active = (self.active | began) & ~ended
        self._count = int(np.count_nonzero(self.active))
        if began.any():
            self._notify(began, seen, "warning: servo {warning} {names}{slower}")
        if ended.any():
            self._notify(ended, seen, "over: servo {warning} {names} now")
        # The speed override ramps down while a warning slows the robot, then up again.
        elapsed = 0.0 if self._at is None else max(now - self._at, 0.0)
        self._at = now
        goal = self._share if self.active[self._slows].any() else 1.0
        step = (1.0 - self._share) * elapsed / RAMP_S
        self.speed_override = (
            max(goal, self.speed_override - step)
            if goal < self.speed_override
            else min(goal, self.speed_override + step)
        )

    def add(self, text: str) -> None:
        """Add a warning about something other than a servo's values."""
        self._news = [*self._news, text][-MOST_NEWS:]

    def take_news(self) -> list[str]:
        """The warnings that began or ended since the last call."""
        news, self._news = self._news, []
        return news

    def _notify(self, which: BoolArray, seen: FloatArray, form: str) -> None:
        for row, mask, values in zip(self._rows, which, seen, strict=True):
            if mask.any():
                names = name_servos(self._servos, row, mask, values)
                slower = f"; the robot goes at {self._share:.0%} of its speed" if row.slows else ""
                self._news.append(form.format(warning=row.text.format(*row.warn), names=names, slower=slower))
        del self._news[:-MOST_NEWS]


SILENCE_GAP_S = 0.5
"""[s] Silent cycles with a longer gap are not counted together."""
HIGHEST_ERROR_RATE = 0.6
"""Error rate at which the robot stops (see `ServoStates.error_rate`)."""


class BusHealth:
    """Judges the buses of one robot. On a bus with one servo, the servo's own age counts instead.

    max_silence: s without an answer from a whole bus, during which the robot may hold. limbs (n,): dispensable servos;
    a bus of these alone is never lost.
    """

    def __init__(self, joint_map: JointMap, max_silence: float, limbs: BoolArray | None = None) -> None:
        buses = np.array([servo.bus for servo in joint_map.servos])
        groups = {str(name): np.flatnonzero(buses == name) for name in buses}
        self._columns = {name: columns for name, columns in groups.items() if columns.size > 1}
        self._needed = {name for name, columns in self._columns.items() if limbs is None or not limbs[columns].all()}
        self._max_silence = max_silence
        self._silent_since = inf  # [s] the first cycle in which a bus was silent; infinite: none is
        self._silent_at = -inf  # [s] the last
        self._cycles = self._silent = 0  # since the first of those silent cycles
        self.lost: BoolArray = np.zeros(len(joint_map), dtype=np.bool_)
        """Mask (n,) of abandoned servos."""

    @property
    def answered(self) -> float:
        """Share of cycles with answers from all buses, since the first silent cycle that is counted."""
        return 1.0 - self._silent / max(self._cycles, 1)

    def silence(self, states: ServoStates) -> ServoFault | None:
        """A fault while a bus is silent: hold, then torque off after max_silence, in the second silent cycle at
        the earliest, since the host may be late."""
        age, name = self.quietest(states)
        first, self._silent_since = self._silent_since, inf if age == 0.0 else min(self._silent_since, states.time)
        if age > 0.0 and states.time - self._silent_at > SILENCE_GAP_S:
            self._cycles = self._silent = 0
        self._cycles += 1
        if age == 0.0:
            return None
        self._silent_at, self._silent = states.time, self._silent + 1
        needed, its_name = self.quietest(states, self._needed)
        lost = self._max_silence < needed < inf and first < states.time
        age, name = (needed, its_name) if lost else (age, name)
        reason = f"the bus is silent: no valid answer from any servo of bus {name} for {age:.3f} s"
        return ServoFault(StopCategory.TORQUE_OFF if lost else StopCategory.HOLD, StopCause.BUS_SILENT, reason)

    def error_rate(self, states: ServoStates) -> ServoFault | None:
        """The fault of a bus with too many damaged answers, or None."""
        if states.error_rate < HIGHEST_ERROR_RATE:
            return None
        share = f"in {states.error_rate:.0%} of the cycles of late"
        reason = f"answers came damaged or incomplete {share}: a noisy line, or a computer that is too slow or too busy"
        return ServoFault(StopCategory.BRAKE_AND_TORQUE_OFF, StopCause.BUS, reason)

    def quietest(self, states: ServoStates, buses: Collection[str] | None = None) -> tuple[float, str]:
        """The longest time, s, since the last answer from a whole bus, and its name; 0 if all answer. buses:
        those that count; None: all."""
        if states.complete:
            return 0.0, ""
        ages = (
            (float(states.age[columns].min()), name)
            for name, columns in self._columns.items()
            if (buses is None or name in buses) and not self.lost[columns].all()
        )
        return max(ages, default=(0.0, ""))


HEAT_SHOWN_S, HEAT_WARNED_S = 3600.0, 300.0
"""[s] Times before a heat warning at which it is shown, and reported once."""
CHECK_BUS = "Check power, wiring and the bus of the profile, or whether the host is too busy"


class ServoHealth:
    """Judges the states of one robot's servos. A temperature or voltage that is no longer known is a fault.

    lost (n,): silent servos of limbs, with the partner of a coupled pair, which are no longer judged.
    """

    def __init__(self, joint_map: JointMap, limits: GuardLimits) -> None:
        self._joint_map = joint_map
        self._rows = watched(limits)
        count = len(joint_map)
        self._limbs = np.array(limits.limbs or (False,) * count)
        self._max_age = limits.max_age
        self.buses = BusHealth(joint_map, limits.max_silence, self._limbs)
        self.lost: BoolArray = np.zeros(count, dtype=np.bool_)
        self._expected = ExpectedRange(np.array(limits.lag or (0.0,) * count))
        self._levels = ServoLevels([row.stop for row in self._rows], [row.debounce for row in self._rows], count)
        self.warnings = ServoWarnings(joint_map.servos, self._rows, limits.slow_share)
        warm = limits.warn_temperature if np.isfinite(limits.warn_temperature) else limits.max_temperature
        self._heat = HeatForecast(warm, ~self._limbs)
        self._heat_warned = False
        self._seen = np.zeros((len(self._rows), count))
        self._reported = np.zeros(self._seen.shape, dtype=np.bool_)  # limited values that were known at least once
        self._zeros = np.zeros(count)
        self._limited = np.isfinite(self._levels.least) | np.isfinite(self._levels.most)

    def check(self, states: ServoStates, sent: TickArray | None, held: FloatArray | None = None) -> ServoFault | None:
        """The gravest fault for which the robot must stop or hold, or None. sent (n,): goal ticks of the last
        tick. held (n,): rad, expected under load; None: the goals."""
        if self._heat.look(states.time, states.temperature):
            first = self._heat.soonest
            if first is not None and 0.0 < first.left < HEAT_WARNED_S and not self._heat_warned:
                self._heat_warned = True
                self.warnings.add(f"warning: {self.heat_words}, if it goes on so: let it sit for a while")
        silence = self.buses.silence(states)
        if silence is not None and silence.category is StopCategory.TORQUE_OFF:
            return silence
        self._look(states, sent if sent is None or held is None else self._aimed(sent, held))
        noise = self.buses.error_rate(states)
        if noise is not None:
            return noise
        self.warnings.look(self._seen, states.time)
        wrong = self._wrong(states.time)
        if not wrong.any():
            return silence
        late = wrong[WatchedRow.AGE]
        if late.any() and not (late & ~self._limbs).any():
            # Servos on one cable fall silent within some cycles.
            silent = self._limbs & ~self.lost & (states.age > 0.5 * self._max_age)
            self.lost = self.buses.lost = self.lost | ~self._joint_map.known_joints(~silent)
            row = self._rows[WatchedRow.AGE]
            names = name_servos(self._joint_map.servos, row, silent, states.age)
            reason = f"servo of a limb {row.text.format(*row.stop)} {names}"
            return ServoFault(StopCategory.BRAKE_AND_TORQUE_OFF, StopCause.LIMB_LOST, reason)
        return next(self._faults(wrong), silence)

    @property
    def heat_words(self) -> str:
        """The carrying servo that will be warm first; "" if none will be within an hour."""
        first = self._heat.soonest
        if first is None or not first.left < HEAT_SHOWN_S:
            return ""
        joint, minutes = self._joint_map.joints[first.column], max(round(first.left / 60.0), 1)
        when = f"in about {minutes} min" if first.left else "now"
        return f"{joint} {first.temperature:.0f} °C, warm ({first.warns_at:g} °C) {when}"

    def refuse_unhealthy(self, states: ServoStates) -> None:
        """Raise for servos that cannot be armed: BusError when none answers, GuardError with all faults."""
        missing = ~states.valid
        if missing.all():
            raise BusError("no servo answers", where="arming", then=CHECK_BUS)
        self._levels.forget()
        self._look(states, None)
        names = name_servos(self._joint_map.servos, self._rows[WatchedRow.AGE], missing, states.age)
        problems = [f"servo does not answer: {names}"] if missing.any() else []
        problems += [fault.reason for fault in self._faults(self._wrong(states.time) & states.valid)]
        if problems:
            raise GuardError(
                "not every servo is well", where="arming", found="; ".join(problems), then="It was not armed"
            )

    def _aimed(self, sent: TickArray, held: FloatArray) -> TickArray:
        """The ticks (n,) of `held`, or `sent` if both agree within a tick."""
        if (np.abs(self._joint_map.to_radians(sent) - held) <= self._joint_map.tick_rad).all():
            return sent
        try:
            return self._joint_map.to_ticks(held)
        except HardwareError:  # beyond the servos' travel
            return sent

    def _look(self, states: ServoStates, sent: TickArray | None) -> None:
        seen = self._seen
        seen[WatchedRow.ALERT], seen[WatchedRow.AGE] = states.alert, states.age
        seen[WatchedRow.TEMPERATURE], seen[WatchedRow.VOLTAGE] = states.temperature, states.voltage
        np.fmax(np.abs(states.current), self._zeros, out=seen[WatchedRow.CURRENT])  # 0 where it is not known
        if sent is None:  # before goals are sent, torque may be off
            seen[WatchedRow.LIMP] = seen[WatchedRow.FAR] = seen[WatchedRow.STILL_FAR] = 0.0
            self._expected.forget()
            return
        np.logical_not(states.driven, out=seen[WatchedRow.LIMP])
        far = np.abs(self._joint_map.turned(self._expected.error(states.time, sent, states.position)))
        if states.complete:
            seen[WatchedRow.FAR] = seen[WatchedRow.STILL_FAR] = far
        else:  # the position of a silent servo is out of date: its last known error stays
            known = self._joint_map.known_joints(states.valid)
            seen[WatchedRow.FAR] = seen[WatchedRow.STILL_FAR] = np.where(known, far, seen[WatchedRow.FAR])

    def _wrong(self, now: float) -> BoolArray:
        beyond = self._levels.beyond(self._seen, now)
        unknown = np.isnan(self._seen)
        if not unknown.any():
            self._reported = self._limited
            return beyond & ~self.lost
        wrong = beyond | (unknown & self._reported)
        self._reported = self._reported | (self._limited & ~unknown)
        return np.asarray(wrong & ~self.lost)

    def _faults(self, wrong: BoolArray) -> Iterator[ServoFault]:
        unread = np.isnan(self._seen) & wrong
        for row, which, values in zip(self._rows, wrong & ~unread, self._seen, strict=True):
            if which.any():
                names = name_servos(self._joint_map.servos, row, which, values)
                reason = f"servo {row.text.format(*row.stop)} {names}"
                yield ServoFault(StopCategory.BRAKE_AND_TORQUE_OFF, row.cause, reason)
        if unread.any():
            servos: BoolArray = np.asarray(unread.any(axis=0))
            names = name_servos(self._joint_map.servos, self._rows[WatchedRow.AGE], servos, self._zeros)
            quantities = [row.quantity for row, which in zip(self._rows, unread, strict=True) if which.any()]
            have = "has" if len(quantities) == 1 else "have"
            why = "the bus is too slow, or too many answers come damaged or late"
            reason = f"{' and '.join(quantities)} {have} not been read for {UNREAD_AFTER_S:g} s: {why}: {names}"
            yield ServoFault(StopCategory.BRAKE_AND_TORQUE_OFF, StopCause.NOT_READ, reason)
