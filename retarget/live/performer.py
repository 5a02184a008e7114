"""A live performer as a run follows it: valid sensors in our world, with holds and reacquisition blends."""

from collections.abc import Iterable

import numpy as np

from hardware.clock import Clock, TickTiming
from retarget.errors import UsageError
from retarget.frames import SensorFrames, SensorSample, mirrored_name, on_grid
from retarget.human.rest_pose import REQUIRED
from retarget.human.samples import Clip
from retarget.human.sensor_intake import IntakeTimes
from retarget.live.engagement import Debounce, Engagement, EngagementTimes, ReacquisitionBlend, ReacquisitionTurn
from retarget.live.rest_capture import Alignment, facing_of
from retarget.live.roles import NO_WRISTS, Roles
from retarget.live.sensor_validity import ValidityState
from retarget.live.stream import CatchingUp, LiveStream, StreamReading
from retarget.live.stream_report import (
    HoldEvidence,
    LiveReport,
    StreamNews,
    StreamProblems,
    Tally,
    hold_reason_of,
    live_report,
)
from retarget.types import BoolArray, FloatArray, Notify

# The sensors without which a performer cannot be measured, and those without which the robot holds.

BASE_SENSORS = ("pelvis", "l_ankle", "r_ankle")
"""These locate the body and its feet. The robot holds while one that the performer wears is lost."""
FALLBACK = ("head",)
"""The base sensor of a performer who wears none of these."""


def base_sensors(names: Iterable[str]) -> tuple[str, ...]:
    """The sensors among these without which the robot holds."""
    worn = tuple(names)
    return tuple(name for name in BASE_SENSORS if name in worn) or tuple(name for name in FALLBACK if name in worn)


def needed(roles: Roles) -> tuple[str, ...]:
    """The sensors that must be fresh to begin. A partial performer's file needs only those that measure."""
    return tuple(dict.fromkeys((*REQUIRED, *(() if roles.partial else base_sensors(roles.sensors)))))


def missing_sensors(stream: LiveStream, now: float) -> list[str]:
    """Sensors to wait for: needed ones that are not fresh, and listed ones that the stream does not have."""
    reading, must, roles = stream.read(now), needed(stream.roles), stream.roles
    known: BoolArray = np.asarray(np.isfinite(reading.position).all(axis=1))
    missing = []
    for name, place, fresh, was_sent in zip(roles.sensors, roles.places, reading.fresh, known, strict=True):
        absent = not (was_sent or roles.partial or {place.position, place.orientation} & stream.names.keys())
        if absent or (name in must and not fresh):
            missing.append(name)
    return missing


def refuse_unmeasurable(roles: Roles, *, where: str) -> None:
    """Raise UsageError where the performer's file does not list a sensor that measuring needs."""
    missing = [name for name in REQUIRED if name not in roles.sensors]
    if missing:
        vrchat = roles.convention == "slimevr_vrchat"
        raise UsageError(
            "the performer cannot be measured without head and both wrists",
            where=where,
            found=f"a performer's file without {', '.join(missing)}",
            next_step=NO_WRISTS if vrchat else "Add them to the performer's file, or choose another --performer",
        )


INTAKE = IntakeTimes(hold=0.08, fade=0.25, speed=0.4)
"""A sensor becomes invalid within 0.2 s, and with these times has no weight within 0.3 s. It comes back by the weight
of `ReacquisitionBlend`, no faster than `speed`, m/s: an elbow then uses at most half of its servo's speed."""
SILENCE_S = 0.13
"""The robot holds after this long without a frame, before the sensors are stale."""
PLAYED_S = 0.05
"""A recording is over this long after its last datagram; the playout delay is less."""
_REFLECT = np.array([1.0, -1.0, 1.0])
_REFLECT_TURN = np.array([1.0, -1.0, 1.0, -1.0])


def live_sample(
    names: tuple[str, ...],
    reading: StreamReading,
    alignment: Alignment,
    *,
    usable: BoolArray,
    mirror: bool = False,
    weight: FloatArray | None = None,
) -> SensorSample:
    """The sample of a reading, in our world. usable (k,): the other sensors are not valid in it; weight (k,): how far
    sensors that were lost have come back. mirror: swap left and right."""
    position, orientation = alignment.positions(reading.position), alignment.orientations(reading.orientation)
    valid = reading.fresh & usable
    if mirror:
        order = [names.index(mirrored_name(name)) for name in names]
        position, orientation = position[order] * _REFLECT, orientation[order] * _REFLECT_TURN
        valid = valid[order]
        weight = None if weight is None else weight[order]
    return SensorSample(names, position, orientation, valid, weight)


class LivePerformer:
    """`retarget.human.samples.Samples` of a stream. `first`: the sample that the robot approaches.

    ticks: at most; kept: samples that are recorded. optional: sensors for which the robot never holds. notify: receives
    what changes, a sentence each.
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
        notify: Notify = lambda text: None,
    ) -> None:
        self.stream, self.alignment, self.mirror = stream, alignment, mirror
        self.engagement = Engagement(first)
        self._approaching, self._waits = Debounce(EngagementTimes().healthy, good=True), False
        self._problems, self._news = StreamProblems(stream), StreamNews(stream, notify)
        self._first, self._clock, self._notify = first, clock, notify
        self._rate_hz, self._ticks, self._kept = rate_hz, ticks, min(kept, ticks)
        self._timing, self._catching_up = TickTiming(1.0 / rate_hz), CatchingUp(stream)
        names = stream.roles.sensors
        self._reacquisition: ReacquisitionBlend | None = None
        self._tally = Tally(names, self.dt)
        self._turning = ReacquisitionTurn(len(names))
        self._message: str | None = None  # what is wrong with the stream
        self._none: BoolArray = np.zeros(len(names), dtype=bool)
        self._jumped = self._none  # while it was followed
        self._came_back = False  # whether data have been good since the hold began
        self._base = [names.index(name) for name in base_sensors(name for name in names if name not in optional)]
        self._positions = np.full((self._kept, len(names), 3), np.nan)
        self._orientations = np.full((self._kept, len(names), 4), np.nan)
        self._valid = np.zeros((self._kept, len(names)), dtype=bool)
        self._last_tick, self._states = -1, np.full(len(names), ValidityState.STALE, dtype=np.uint8)

    @property
    def ticks(self) -> int:
        """Greatest number of ticks."""
        return self._ticks

    @property
    def kept(self) -> int:
        """Ticks that are recorded."""
        return self._kept

    @property
    def dt(self) -> float:
        """Seconds between ticks."""
        return 1.0 / self._rate_hz

    @property
    def motion_dt(self) -> float:
        """The performer moves in real time."""
        return self.dt

    @property
    def over(self) -> bool:
        """Whether the recording of a stream has been played."""
        return self.stream.receiver.finished and self._clock.now() - self.stream.last > PLAYED_S

    @property
    def settled(self) -> float:
        """Share of its speed that the robot may use beyond that of its slow approach, 0 to 1."""
        return self.engagement.settled

    def may_approach(self) -> bool:
        """Whether data have been good for long enough to go on with the approach."""
        now = self._clock.now()
        if self._catching_up.step(now):
            return False
        reading, _ = self._read(now)
        good = self._is_good(reading, now)
        goes = self._approaching.step(now, good=good)
        self._came_back = (self._came_back or good) and not goes
        self._say_news()
        if goes is self._waits:
            late = " because ticks come late" if self._timing.behind else ""
            self._notify("the robot goes on" if goes else f"the robot waits during its approach{late}")
            self._waits = not goes
        return goes

    def catch_up(self) -> None:
        """Take all that has arrived; for a robot without torque."""
        self._catching_up.at_once(self._clock.now())

    def poll(self) -> None:
        """Take what has arrived, and report what changed."""
        self.stream.poll(self._clock.now(), moving=True)
        self._news.look()

    def sample(self, tick: int) -> SensorSample | None:
        """The sample to follow now; None: hold."""
        if tick == 0:
            self.engagement.begin(self._first)
        sample = self._first if tick == 0 else self._now()
        sample = None if sample is None else on_grid(sample)
        if tick < self._kept:
            shown = self.engagement.shown if sample is None else sample
            self._positions[tick], self._orientations[tick] = shown.position, shown.orientation
            self._valid[tick] = shown.valid
            self._last_tick = max(self._last_tick, tick)
        return sample

    @property
    def hold_reason(self) -> str:
        """Why the performer is not followed, in a few words."""
        if not self.engagement.wanted:
            return "paused by the operator"
        problem, late = self._problems.briefly(self._clock.now(), SILENCE_S), self._timing.behind
        evidence = HoldEvidence(self._states, self._jumped, tuple(self._base), late, problem, self._came_back)
        return hold_reason_of(self.stream.roles.sensors, evidence)

    def clutch(self, *, engaged: bool) -> None:
        """Follow again from where the robot is, or hold it."""
        self.engagement.wanted = engaged
        if not engaged:
            self.engagement.hold()

    def reset_heading(self) -> bool:
        """Take the direction that the performer faces now as straight ahead, since trackers drift. The robot holds, and
        goes on from there. Returns False where left and right sensors do not show a direction."""
        reading = self.stream.read(self._clock.now())
        every_sensor = np.ones(len(reading.states), dtype=bool)
        names = self.stream.roles.sensors
        sample = live_sample(names, reading, self.alignment, usable=every_sensor)
        at = {name: point for name, point, ok in zip(names, sample.position, sample.valid, strict=True) if ok}
        forward = facing_of(at)
        if forward is None:
            return False
        self.engagement.hold()
        self.alignment = self.alignment.turned(
            -float(np.arctan2(forward[1], forward[0])), np.mean([*at.values()], axis=0)
        )
        return True

    def report(self, *, address: str, person: str | None) -> LiveReport:
        """The report on the stream."""
        return live_report(self.stream, self._tally, address=address, person=person)

    def recorded(self) -> Clip:
        """The samples that were followed; during a hold, the held one."""
        count = max(self._last_tick + 1, 1)
        valid = self._valid[:count]
        frames = SensorFrames(
            time=np.arange(count) / self._rate_hz,
            names=self.stream.roles.sensors,
            position=np.where(valid[..., None], self._positions[:count], np.nan),
            orientation=np.where(valid[..., None], self._orientations[:count], np.nan),
            valid=valid,
            source="live",
            rate_hz=self._rate_hz,
        )
        return Clip(frames, count, self._rate_hz, 1.0, count)

    def _now(self) -> SensorSample | None:
        now = self._clock.now()
        reading, sample = self._read(now)
        before = self.engagement.state
        good = self._is_good(reading, now)
        followed = self.engagement.step(now, sample, good=good)
        self._came_back = (self._came_back or (good and self.engagement.wanted)) and followed is None
        self._tally.count(reading.states, followed=followed is not None)
        self._say_news()
        if self.engagement.state is not before:
            late = " because ticks come late" if self._timing.behind else ""
            self._notify(
                "the performer is followed" if followed else f"the performer is not followed{late}: the robot holds"
            )
        return followed

    def _read(self, now: float) -> tuple[StreamReading, SensorSample]:
        """The reading of this tick, and the sample of its valid sensors in our world."""
        self._timing.begin(now)
        reading = self.stream.read(now)
        self._states = reading.states
        if self._reacquisition is None:  # the body has not moved yet
            self._reacquisition = ReacquisitionBlend(len(reading.states))
            self._reacquisition.start(reading.states)
            self.stream.validity.forget_recovered()
        before = self._reacquisition.weights
        weight = self._reacquisition.step(reading.states, self.dt)
        if np.count_nonzero(reading.states):
            jumped = reading.states == ValidityState.JUMPED
            self._jumped = jumped & (self._jumped | (before > 0.5))
        else:
            self._jumped = self._none
        self._message = self._problems.look(now)
        names = self.stream.roles.sensors
        sample = live_sample(
            names, reading, self.alignment, usable=weight > 0.0, mirror=self.mirror, weight=weight.copy()
        )
        return reading, self._turning.step(sample)

    def _say_news(self) -> None:
        for message in (*self.stream.validity.messages(), self._message):
            if message:
                self._notify(message)

    def _is_good(self, reading: StreamReading, now: float) -> bool:
        """Whether data are good enough to move: the sender sends, no sensor has jumped, the base sensors are fresh, and
        ticks are on time."""
        fresh = reading.fresh.tolist()
        known = any(fresh) and all(fresh[row] for row in self._base)
        return (
            now - self.stream.last <= SILENCE_S
            and known
            and not (self._timing.behind or np.count_nonzero(self._jumped) or self._problems.foreign)
        )
