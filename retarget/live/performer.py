"""A live performer as the pipeline plays it: sensors that are trusted, in our world, held and blended where they are
not.
"""

from collections.abc import Callable, Iterable

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
from retarget.live.stream import CatchingUp, Heard, LiveStream
from retarget.live.stream_report import (
    HoldEvidence,
    LiveReport,
    StreamNews,
    StreamProblems,
    Tally,
    hold_reason_of,
    live_report,
)
from retarget.types import BoolArray, FloatArray

__all__ = ["INTAKE", "LivePerformer", "carrying", "live_sample", "missing_sensors", "needed", "refuse_unmeasurable"]


# Without which of a performer's sensors nobody is measured, and without which the robot does not move.

CARRYING = ("pelvis", "l_ankle", "r_ankle")
"""Without one of these that is worn, the robot does not know how to stand."""
CARRYING_ALONE = ("head",)
"""What stands for them where none is worn: all that tells where the body is."""


def carrying(names: Iterable[str]) -> tuple[str, ...]:
    """Of these sensors, those without which the robot holds."""
    worn = tuple(names)
    return tuple(name for name in CARRYING if name in worn) or tuple(name for name in CARRYING_ALONE if name in worn)


def needed(roles: Roles) -> tuple[str, ...]:
    """Those of a performer that must be heard to begin: a file that takes what there is needs what measures only."""
    return tuple(dict.fromkeys((*REQUIRED, *(() if roles.partial else carrying(roles.sensors)))))


def missing_sensors(stream: LiveStream, now: float) -> list[str]:
    """Sensors to be waited for: those needed that are not fresh, and those listed that the stream does not have."""
    heard, must, roles = stream.read(now), needed(stream.roles), stream.roles
    known: BoolArray = np.asarray(np.isfinite(heard.position).all(axis=1))
    missing = []
    for name, place, fresh, told in zip(roles.sensors, roles.places, heard.fresh, known, strict=True):
        lacks = not (told or roles.partial or {place.position, place.orientation} & stream.names.keys())
        if lacks or (name in must and not fresh):
            missing.append(name)
    return missing


def refuse_unmeasurable(roles: Roles, *, where: str) -> None:
    """Raise UsageError where the performer's file lacks a sensor without which nobody can be measured."""
    lacking = [name for name in REQUIRED if name not in roles.sensors]
    if lacking:
        vrchat = roles.convention == "slimevr_vrchat"
        raise UsageError(
            "the performer cannot be measured without head and both wrists",
            where=where,
            found=f"a performer's file without {', '.join(lacking)}",
            next_step=NO_WRISTS if vrchat else "Add them to the performer's file, or choose another --performer",
        )


INTAKE = IntakeTimes(hold=0.08, fade=0.25, speed=0.4)
"""A sensor is doubted after up to 0.2 s: with this it is out within 0.3 s. It comes back by the weight of
`ReacquisitionBlend`, no faster than this, in m/s: an elbow is then at half of its servo's speed, at most."""
SILENCE_S = 0.13
"""A stream that says nothing for so long is held, before its sensors are stale."""
PLAYED_S = 0.05
"""So long after its last datagram a recording has been played: what is held back to play evenly is less."""
_REFLECT = np.array([1.0, -1.0, 1.0])
_REFLECT_TURN = np.array([1.0, -1.0, 1.0, -1.0])


def live_sample(
    names: tuple[str, ...],
    heard: Heard,
    alignment: Alignment,
    *,
    believed: BoolArray,
    mirror: bool = False,
    weight: FloatArray | None = None,
) -> SensorSample:
    """What was heard, in our world; believed (k,): who counts; weight (k,): how far who was lost has come back. mirror:
    left and right exchanged."""
    position, orientation = alignment.positions(heard.position), alignment.orientations(heard.orientation)
    valid = heard.fresh & believed
    if mirror:
        order = [names.index(mirrored_name(name)) for name in names]
        position, orientation = position[order] * _REFLECT, orientation[order] * _REFLECT_TURN
        valid = valid[order]
        weight = None if weight is None else weight[order]
    return SensorSample(names, position, orientation, valid, weight)


class LivePerformer:
    """`retarget.human.samples.Samples` of a stream. `first`: the sample at which the robot arrives.

    ticks: at most; kept: samples that are remembered for who looks at the run afterwards. lacking: sensors for which
    the robot never holds. tell: hears what changes, a sentence each.
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
        lacking: tuple[str, ...] = (),
        notify: Callable[[str], object] = lambda text: None,
    ) -> None:
        self.stream, self.alignment, self.mirror = stream, alignment, mirror
        self.engagement = Engagement(first)
        self._on_the_way, self._waits = Debounce(EngagementTimes().healthy, good=True), False
        self._trouble, self._news = StreamProblems(stream), StreamNews(stream, notify)
        self._first, self._clock, self._notify = first, clock, notify
        self._rate_hz, self._ticks, self._kept = rate_hz, ticks, min(kept, ticks)
        self._pace, self._catching_up = TickTiming(1.0 / rate_hz), CatchingUp(stream)
        names = stream.roles.sensors
        self._reacquisition: ReacquisitionBlend | None = None
        self._tally = Tally(names, self.dt)
        self._turning = ReacquisitionTurn(len(names))
        self._message: str | None = None  # of what is wrong with the stream
        self._nobody: BoolArray = np.zeros(len(names), dtype=bool)
        self._jumped = self._nobody  # while it was followed
        self._came_back = False  # whether data were good since it is not followed
        self._carrying = [names.index(name) for name in carrying(name for name in names if name not in lacking)]
        self._positions = np.full((self._kept, len(names), 3), np.nan)
        self._orientations = np.full((self._kept, len(names), 4), np.nan)
        self._valid = np.zeros((self._kept, len(names)), dtype=bool)
        self._last_tick, self._states = -1, np.full(len(names), ValidityState.STALE, dtype=np.uint8)

    @property
    def ticks(self) -> int:
        """At most."""
        return self._ticks

    @property
    def kept(self) -> int:
        """Ticks that are remembered."""
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
        """How much of its speed the robot may use beyond that of its slow approach, 0 to 1."""
        return self.engagement.settled

    def may_approach(self) -> bool:
        """Whether data are good, and have been for long enough since they were not."""
        now = self._clock.now()
        if self._catching_up.step(now):
            return False
        heard, _ = self._hear(now)
        good = self._is_good(heard, now)
        goes = self._on_the_way.step(now, good=good)
        self._came_back = (self._came_back or good) and not goes
        self._say_news()
        if goes is self._waits:
            late = " because ticks come late" if self._pace.behind else ""
            self._notify("the robot goes on" if goes else f"the robot waits on its way to the performer{late}")
            self._waits = not goes
        return goes

    def catch_up(self) -> None:
        """Take in all that has arrived; for the moment before a robot has torque."""
        self._catching_up.at_once(self._clock.now())

    def listen(self) -> None:
        """Take in what has arrived, and say what changed."""
        self.stream.listen(self._clock.now(), moving=True)
        self._news.look()

    def sample(self, tick: int) -> SensorSample | None:
        """What is to be followed now; None: hold."""
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
        """Why nobody is followed, in a few words."""
        if not self.engagement.wanted:
            return "let go"
        trouble = self._trouble.briefly(self._clock.now(), SILENCE_S)
        carrying, late = tuple(self._carrying), self._pace.behind
        evidence = HoldEvidence(self._states, self._jumped, carrying, late, trouble, self._came_back)
        return hold_reason_of(self.stream.roles.sensors, evidence)

    def clutch(self, *, engaged: bool) -> None:
        """Take the robot up again from where it is, or let go of it: it holds."""
        self.engagement.wanted = engaged
        if not engaged:
            self.engagement.hold()

    def reset_heading(self) -> bool:
        """Take the way that the performer faces now as straight ahead: trackers drift. The robot holds, and goes on
        from there. Whether left and right tell where that is."""
        heard = self.stream.read(self._clock.now())
        everybody = np.ones(len(heard.states), dtype=bool)
        names = self.stream.roles.sensors
        sample = live_sample(names, heard, self.alignment, believed=everybody)
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
        """What there is to tell of the stream."""
        return live_report(self.stream, self._tally, address=address, person=person)

    def recorded(self) -> Clip:
        """The samples that were followed, where they held the last one again."""
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
        heard, sample = self._hear(now)
        before = self.engagement.state
        good = self._is_good(heard, now)
        followed = self.engagement.step(now, sample, good=good)
        self._came_back = (self._came_back or (good and self.engagement.wanted)) and followed is None
        self._tally.count(heard.states, followed=followed is not None)
        self._say_news()
        if self.engagement.state is not before:
            late = " because ticks come late" if self._pace.behind else ""
            self._notify(
                "the performer is followed" if followed else f"the performer is not followed{late}: the robot holds"
            )
        return followed

    def _hear(self, now: float) -> tuple[Heard, SensorSample]:
        """What is heard in this tick, and of it the sensors that are believed, in our world."""
        self._pace.begin(now)
        heard = self.stream.read(now)
        self._states = heard.states
        if self._reacquisition is None:  # the body has not moved yet
            self._reacquisition = ReacquisitionBlend(len(heard.states))
            self._reacquisition.start(heard.states)
            self.stream.validity.forget_recovered()
        before = self._reacquisition.weights
        weight = self._reacquisition.step(heard.states, self.dt)
        if np.count_nonzero(heard.states):
            doubted = (heard.states == ValidityState.JUMPED) | (heard.states == ValidityState.SWAPPED)
            self._jumped = doubted & (self._jumped | (before > 0.5))
        else:
            self._jumped = self._nobody
        self._message = self._trouble.look(now)
        names = self.stream.roles.sensors
        sample = live_sample(
            names, heard, self.alignment, believed=weight > 0.0, mirror=self.mirror, weight=weight.copy()
        )
        return heard, self._turning.step(sample)

    def _say_news(self) -> None:
        for message in (*self.stream.validity.messages(), self._message):
            if message:
                self._notify(message)

    def _is_good(self, heard: Heard, now: float) -> bool:
        """Whether enough can be believed to move: somebody speaks, nobody has leapt, what carries is known, and it is
        not too late for it."""
        fresh = heard.fresh.tolist()
        known = any(fresh) and all(fresh[row] for row in self._carrying)
        return (
            now - self.stream.last <= SILENCE_S
            and known
            and not (self._pace.behind or np.count_nonzero(self._jumped) or self._trouble.foreign)
        )
