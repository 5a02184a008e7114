"""A live performer as a run follows it: valid sensors in our world, with holds."""

from collections.abc import Iterable, Mapping, Sequence
from math import inf
from types import MappingProxyType

import numpy as np

from hardware.clock import Clock, TickTiming
from retarget.arithmetic import arctan2
from retarget.errors import UsageError
from retarget.frames import (
    REFLECT_POSITION,
    REFLECT_QUATERNION,
    SensorFrames,
    SensorSample,
    mirrored_name,
    on_grid,
)
from retarget.human.pose_validation import LIMITS, ValidityState
from retarget.human.rest_pose import REQUIRED
from retarget.human.samples import Clip
from retarget.human.stance import facing_of
from retarget.live.advice import advice, refusal
from retarget.live.rest_capture import Alignment
from retarget.live.roles import Roles
from retarget.live.sensor_validity import Debounce, Engagement, SensorDebounce
from retarget.live.stream import LiveStream, StreamReading
from retarget.live.stream_report import (
    MS,
    GoalLatency,
    LiveReport,
    StreamNews,
    StreamProblems,
    Tally,
    refused_counts,
    spread_of,
)
from retarget.types import BoolArray, News, Notify

BASE_SENSORS = ("pelvis", "l_ankle", "r_ankle")
"""Sensors that locate the body and its feet. The robot holds while a worn one is lost."""
FALLBACK = ("head",)  # the base sensor of a performer who wears none of these


def base_sensors(names: Iterable[str]) -> tuple[str, ...]:
    """The sensors among these without which the robot holds."""
    worn = tuple(names)
    return tuple(name for name in BASE_SENSORS if name in worn) or tuple(name for name in FALLBACK if name in worn)


def needed(roles: Roles) -> tuple[str, ...]:
    """The sensors that must be fresh to begin."""
    return tuple(dict.fromkeys((*REQUIRED, *(() if roles.partial else base_sensors(roles.sensors)))))


def missing_sensors(stream: LiveStream, now: float) -> list[str]:
    """List the sensors to wait for: needed ones that are not fresh, and listed ones that the stream lacks."""
    reading, must, roles = stream.read(now), needed(stream.roles), stream.roles
    known: BoolArray = np.asarray(np.isfinite(reading.position).all(axis=1))
    missing = []
    for name, place, fresh, was_sent in zip(roles.sensors, roles.places, reading.fresh, known, strict=True):
        absent = not (was_sent or roles.partial or {place.position, place.orientation} & stream.names.keys())
        if absent or (name in must and not fresh):
            missing.append(name)
    return missing


def refuse_unmeasurable(roles: Roles, *, where: str) -> None:
    """Raise UsageError without a sensor that measuring needs."""
    missing = [name for name in REQUIRED if name not in roles.sensors]
    if missing:
        found = f"a performer's file without {', '.join(missing)}"
        raise refusal(UsageError, f"unmeasurable {roles.convention}", where, found=found)


PLAYED_S = 0.05  # a recording is over this long after its last datagram; the playout delay is less


def live_sample(
    names: tuple[str, ...],
    reading: StreamReading,
    alignment: Alignment,
    *,
    mirror: bool = False,
    used: BoolArray | None = None,
) -> SensorSample:
    """The sample of a reading, in our world. used (k,): valid sensors, by default fresh ones."""
    position, orientation = alignment.positions(reading.position), alignment.orientations(reading.orientation)
    valid = reading.fresh if used is None else used
    if mirror:
        order = [names.index(mirrored_name(name)) for name in names]
        position, orientation = position[order] * REFLECT_POSITION, orientation[order] * REFLECT_QUATERNION
        valid = valid[order]
    return SensorSample(names, position, orientation, valid, reading.times)


def lost_words(sensors: Mapping[str, ValidityState]) -> str:
    """The state of each of these sensors, in a few words; "" for none."""
    return ", ".join(f"{name}: {advice(f'short {state.name.lower()}').what}" for name, state in sensors.items())


TOO_SHORT = advice("too short", healthy=LIMITS.healthy).what


class SampleRecord:
    """The followed samples, or the held one during a hold. kept: number of first ticks that are kept."""

    def __init__(self, names: tuple[str, ...], *, kept: int, rate_hz: float) -> None:
        self.kept, self.rate_hz = kept, rate_hz
        self._names, self._count = names, 1
        self._positions = np.full((kept, len(names), 3), np.nan)
        self._orientations = np.full((kept, len(names), 4), np.nan)
        self._valid = np.zeros((kept, len(names)), dtype=bool)

    def append(self, tick: int, shown: SensorSample) -> None:
        """Keep the sample of a tick, unless there are too many."""
        if tick < self.kept:
            self._positions[tick], self._orientations[tick] = shown.position, shown.orientation
            self._valid[tick] = shown.valid
            self._count = max(self._count, tick + 1)

    def clip(self) -> Clip:
        """All samples that were kept."""
        count, valid = self._count, self._valid[: self._count]
        frames = SensorFrames(
            time=np.arange(count) / self.rate_hz,
            names=self._names,
            position=np.where(valid[..., None], self._positions[:count], np.nan),
            orientation=np.where(valid[..., None], self._orientations[:count], np.nan),
            valid=valid,
            source="live",
            rate_hz=self.rate_hz,
        )
        return Clip(frames, count, self.rate_hz, 1.0, count)


class LivePerformer:
    """`retarget.human.samples.Samples` of a stream. `first`: the sample that the robot approaches.

    ticks: at most; kept: recorded samples. optional: sensors for which the robot never holds. has_deadlines: hold for
    late ticks. waits: a hold has no limit in time.
    """

    def __init__(
        self,
        stream: LiveStream,
        alignment: Alignment,
        first: SensorSample,
        *,
        clock: Clock,
        rate_hz: float,
        ticks: int,
        kept: int,
        mirror: bool = False,
        optional: tuple[str, ...] = (),
        has_deadlines: bool = True,
        waits: bool = False,
        notify: Notify = lambda text: None,
    ) -> None:
        names = stream.roles.sensors
        self.stream, self.alignment, self.mirror = stream, alignment, mirror
        self.ticks, self._clock, self._notify = ticks, clock, notify
        self._record = SampleRecord(names, kept=min(kept, ticks), rate_hz=rate_hz)
        self._timing = TickTiming(self.dt if has_deadlines else inf)
        self._waits, self._too_short = waits, advice("too short", stream.kind, healthy=LIMITS.healthy).what
        self._problems, self._news = StreamProblems(stream), StreamNews(stream, notify)
        self._tally, self.latency = Tally(names, self.dt), GoalLatency(stream)
        self.engagement = Engagement(first)
        self._approach = Debounce(good=True)
        self._optional = optional
        self._states = stream.read(clock.now()).states
        self._used = SensorDebounce(self._states)
        stream.validity.forget_recovered()

    @property
    def kept(self) -> int:
        """Number of recorded ticks."""
        return self._record.kept

    @property
    def dt(self) -> float:
        """Seconds between ticks."""
        return 1.0 / self._record.rate_hz

    motion_dt = dt

    @property
    def over(self) -> bool:
        """True if the recording of a stream has been played."""
        return self.stream.receiver.finished and self._clock.now() - self.stream.last > PLAYED_S

    @property
    def following(self) -> bool:
        """True while the robot follows."""
        return self.engagement.following

    @property
    def paused(self) -> bool:
        """True if a hold has no limit in time: the operator pauses the robot, or no servo has torque."""
        return self._waits or not self.engagement.engaged

    def catch_up(self) -> None:
        """Take all that has arrived; for a robot without torque."""
        self.stream.poll(self._clock.now(), moving=True)

    def poll(self) -> None:
        """Take all that has arrived, and report changes."""
        self.stream.poll(self._clock.now(), moving=True)
        self._news.look()

    def may_approach(self) -> bool:
        """True if the robot is not paused, and data have been good for long enough."""
        now = self._clock.now()
        reading, _ = self._read(now)
        good = self.engagement.engaged and self._is_good(reading, now)
        went, goes = self._approach.good, self._approach.step(now, good=good)
        if goes is not went:
            self._report("the robot goes on", "the robot waits during its approach{}", good=goes)
        return goes

    def sample(self, tick: int) -> SensorSample | None:
        """The sample to follow now; None: hold."""
        engagement, followed = self.engagement, None
        if tick == 0:  # the sample that the robot has approached; from here on it waits for good data
            engagement.hold()
            followed = engagement.shown
        else:
            now = self._clock.now()
            reading, sample = self._read(now)
            before = engagement.following
            followed = engagement.step(now, sample, good=self._is_good(reading, now))
            self._tally.count(reading.states, followed=followed is not None)
            if engagement.following is not before:
                holds = "the performer is not followed{}: the robot holds"
                self._report("the performer is followed", holds, good=followed is not None)
        followed = None if followed is None else on_grid(followed)
        self._record.append(tick, engagement.shown if followed is None else followed)
        return followed

    def hold(self) -> None:
        """Hold until data are good."""
        self.engagement.hold()

    @property
    def hold_reason(self) -> str:
        """Reason, in a few words, for which the performer is not followed."""
        if not self.engagement.engaged:
            return "paused by the operator"
        late = "ticks were missed" if self._timing.behind else ""
        now = self._problems.briefly(self._clock.now(), self.stream.validity.limits.silent_after)
        now = now or lost_words(self._holding()) or late
        if now and self.engagement.good.tries + self._approach.tries:
            return f"{self._too_short}, at last: {now}"
        return now or self._too_short

    def clutch(self, *, engaged: bool) -> None:
        """Follow again from where the robot is, or hold it."""
        self.engagement.engaged = engaged
        if not engaged:
            self.engagement.hold()

    def reset_heading(self) -> bool:
        """Take the direction that the performer faces now as straight ahead, since trackers drift. The robot holds
        first. False if no direction shows."""
        reading = self.stream.read(self._clock.now())
        names = self.stream.roles.sensors
        sample = live_sample(names, reading, self.alignment)
        at = {name: point for name, point, ok in zip(names, sample.position, sample.valid, strict=True) if ok}
        forward = facing_of(at)
        if forward is None:
            return False
        self.engagement.hold()
        self.alignment = self.alignment.turned(-arctan2(forward[1], forward[0]), np.mean([*at.values()], axis=0))
        return True

    def report(
        self, *, address: str, person: str | None, times: Mapping[str, Sequence[float]] = MappingProxyType({})
    ) -> LiveReport:
        """The report on the stream. times: s, of stages before the arrival of frames."""
        stages, stream = {**times, "goal": self.latency.times}, self.stream
        return LiveReport(
            address=address,
            frames=stream.frames,
            datagrams=stream.arrived,
            dropped=dict(refused_counts(stream).most_common()),
            refused=tuple(f"{source}: {reason}" for source, reason in stream.admission.named),
            lost_s=self._tally.lost_s,
            holds=self._tally.holds,
            playout_delay_ms=MS * stream.playout.delay,
            smoothing=stream.smoothing,
            latency_ms={stage: spread_of(taken) for stage, taken in stages.items() if taken},
            person=person,
        )

    def recorded(self) -> Clip:
        """The followed samples, or the held one during a hold."""
        return self._record.clip()

    def _report(self, goes_on: str, holds: str, *, good: bool) -> None:
        late = " because ticks come late" if self._timing.behind else ""
        self._notify(News(goes_on) if good else News(holds.format(late), holds, is_due=True))

    def _read(self, now: float) -> tuple[StreamReading, SensorSample]:
        self._timing.begin(now)
        reading = self.stream.read(now)
        self._states = reading.states
        used = self._used.step(reading.states, now)
        names = self.stream.roles.sensors
        sample = live_sample(names, reading, self.alignment, mirror=self.mirror, used=used)
        for message in self.stream.validity.messages():
            self._notify(message)
        if problem := self._problems.look(now):
            self._notify(problem)
        return reading, sample

    def _holding(self) -> dict[str, ValidityState]:
        """The sensors for which the robot holds: base sensors that are not fresh, and sensors that have jumped."""
        if not np.count_nonzero(self._states):
            return {}
        states = zip(self.stream.roles.sensors, map(ValidityState, self._states.tolist()), strict=True)
        worn = {name: state for name, state in states if name not in self._optional}
        base = base_sensors(worn)
        return {
            name: state
            for name, state in worn.items()
            if state is ValidityState.JUMPED or (name in base and state is not ValidityState.FRESH)
        }

    def _is_good(self, reading: StreamReading, now: float) -> bool:
        """True if the sender sends, no sensor has jumped, the base sensors are fresh, and ticks are on time."""
        silent = now - self.stream.last > self.stream.validity.limits.silent_after
        known = bool(np.count_nonzero(reading.fresh))
        return known and not (silent or self._timing.behind or self._problems.foreign or self._holding())
