"""The beginning of a live run: wait for data, calibrate, check the sides, and make the performer of the run."""

from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from hardware.clock import Clock, today
from retarget.arithmetic import norms
from retarget.errors import InputError, UsageError
from retarget.human.calibration import dimensions_from_skeleton
from retarget.human.performer_calibration import check_person_place, person_of, read_person, write_person
from retarget.human.samples import MAX_KEPT, Performance
from retarget.human.sensor_intake import SLOW_INTAKE
from retarget.human.side_check import ASIDE, FRONT_M, OTHER_RISE_M, RAISED, REFUSED, RISE_M, SideCheck
from retarget.live.advice import refusal
from retarget.live.performer import LivePerformer, live_sample, missing_sensors, needed, refuse_unmeasurable
from retarget.live.playout import LIGHT
from retarget.live.rest_capture import (
    CAPTURE_S,
    KNOWN_CAPTURE_S,
    LIVE_STATURE_M,
    Alignment,
    Calibrated,
    RestCapture,
    frozen_as_fresh,
)
from retarget.live.stream import LiveStream, StreamReading
from retarget.live.stream_report import StreamProblems, refuse_version, unusable
from retarget.model.human_dimensions import HumanDimensions, mirrored_dimensions
from retarget.model.robot import RobotBody
from retarget.sources.streams.stream_frame import SkeletonSender
from retarget.types import Notify, RunState

Enter = Callable[[RunState], object]  # takes the state of a run that begins
LONGEST_COUNTDOWN_S = 600.0  # ten minutes to put on sensors


@dataclass(frozen=True)
class LiveOptions:
    """Options of the beginning of a live run.

    patience: s of waiting for data. countdown: s to get into the pose. duration: s of the run, None: until it is
    stopped. stature: m, if known. latest: use the newest poses, without a playout buffer. person: name under which the
    size is kept. recalibrate: measure a known person, too.

    Raises UsageError for a countdown or a stature out of range.
    """

    patience: float = 10.0
    countdown: float = 3.0
    duration: float | None = None
    mirror: bool = False
    stature: float | None = None
    smoothing: str = LIGHT
    latest: bool = False
    use_generated_legs: bool = False
    mirrored_camera: bool = False
    person: str | None = None
    recalibrate: bool = False
    check_sides: bool = False

    def __post_init__(self) -> None:
        if not 0.0 <= self.countdown <= LONGEST_COUNTDOWN_S:  # nor NaN
            found, allowed, step = (
                f"{self.countdown:g}",
                f"0 to {LONGEST_COUNTDOWN_S:g} s",
                "Leave it out, or give some seconds",
            )
            raise UsageError(
                "countdown out of range", where="--countdown", found=found, allowed=allowed, next_step=step
            )
        low, high = LIVE_STATURE_M
        if self.stature is not None and not low <= self.stature <= high:
            found, allowed = f"{self.stature:g}", f"{low:g} to {high:g} m"
            raise UsageError("stature out of range", where="--stature", found=found, allowed=allowed)


WAIT_S = 10.0  # [s] to raise the arm: enough to hear, understand and do it


def _not_raised(check: SideCheck, why: str, lost: list[str], where: str) -> InputError:
    """The error for an arm that was not raised. why: the problem of the stream. lost: wrists that are not fresh."""
    if why:
        return InputError(why.rstrip("."), where=where)
    if lost:
        return refusal(InputError, "lost sensors", where, found=f"no {', no '.join(lost)}")
    symptom = ASIDE if check.aside else "not raised"
    return refusal(InputError, symptom, where, found=check.found(), rise=RISE_M, front=FRONT_M, still=OTHER_RISE_M)


POLL_S = 0.01  # [s] between polls while nothing moves
SETTLE_S = 0.3  # the smoothing filter settles after the offset of a sensor was corrected
MESSAGE_S = 1.0  # [s] between sentences on the pose: long enough to hear and follow one
TRY_S = 0.1  # [s] between checks for standing still


@dataclass(frozen=True, kw_only=True)
class Beginning:
    """A live run that begins. where: the stream, for messages. notify: receives the instructions for the performer.

    enter: receives COUNTDOWN, CALIBRATING, CHECKING_SIDES as they begin. look: called every POLL_S; may raise
    KeyboardInterrupt.
    """

    stream: LiveStream
    options: LiveOptions
    clock: Clock
    where: str
    notify: Notify
    enter: Enter = lambda state: None
    look: Callable[[], object] = lambda: None

    def wait_for_data(self) -> None:
        """Wait until every needed sensor is fresh, and the stream has every sensor of the performer's file.

        Raises InputError after `options.patience` s.
        """
        now, readings = self.clock.now(), self._readings(measured=False)
        deadline = now + self.options.patience
        self.stream.poll(now, moving=False)
        while missing := missing_sensors(self.stream, now):
            if now >= deadline:
                raise unusable(self.stream, missing, self.options.patience, where=self.where, now=now)
            now, _ = next(readings)

    def measure(self, known: HumanDimensions | None) -> Calibrated:
        """Measure floor, heading and size. The size is `known`, else that of the stream's skeleton, else of the rest
        pose.

        Raises InputError: no fresh data, not still, no rest pose, or not of the known size.
        """
        stream, notify = self.stream, self.notify
        pose = (
            "Stand upright and still, legs straight, facing where the robot faces, "
            "arms hanging or straight out to the sides"
        )
        self.enter(RunState.COUNTDOWN)
        if self.options.countdown > 0.0:
            notify(f"{pose}: {self.options.countdown:g} s")
        self._poll_for(self.options.countdown, measured=False)
        self.enter(RunState.CALIBRATING)
        size = known or (None if self.options.stature is not None else self._skeleton_size())
        seconds = CAPTURE_S if known is None else KNOWN_CAPTURE_S
        roles = stream.roles
        # The axes of a rigid body of Motive are the room's, not the performer's.
        oriented = roles.convention != "natnet"
        capture = RestCapture(
            where=self.where, seconds=seconds, loose=roles.loose, needed=needed(roles), oriented=oriented
        )
        found = self._captured(capture, size)
        height = f"{found.dimensions.stature:.2f} m tall"
        if size is not None:
            notify(f"known: {height} ({size.origin})")
        elif self.options.stature is not None:
            notify(f"known: {height} (--stature)")
        else:
            notify(f"measured: {height}")
        if found.offset.any():
            stream.roles = roles.shifted(found.offset)
            off = norms(found.offset)
            offsets = [f"{name} {100 * by:.0f} cm" for name, by in zip(found.sensors, off, strict=True) if by > 0.0]
            notify(f"beside their joints: {', '.join(offsets)}")
            self._poll_for(SETTLE_S, measured=True)
        return found

    def check_sides(self, rest: Calibrated) -> None:
        """Request the left arm to the front, and once more if it goes to the side. rest: position of the wrists.

        Raises InputError with the motion and the next step.
        """
        self.enter(RunState.CHECKING_SIDES)
        names, where = self.stream.roles.sensors, f"{self.where}, raise your left arm"
        rows = [names.index("l_wrist"), names.index("r_wrist")]
        check, repeated, problems = SideCheck(rest.position[rows]), False, StreamProblems(self.stream)
        self.notify(f"Raise your left arm forward, to the front, and only that: {WAIT_S:g} s")
        end = self.clock.now() + WAIT_S
        for now, reading in self._readings(measured=True):
            sample = live_sample(names, frozen_as_fresh(reading), rest.alignment)
            check.take(now, np.where(sample.valid[rows, None], sample.position[rows], np.nan))
            if message := problems.look(now):
                self.notify(str(message))  # nothing moves yet, so all are sent
            if check.seen in REFUSED:
                raise refusal(InputError, check.seen, where, found=check.found())
            if check.seen == RAISED:
                break
            if check.aside and not repeated:
                repeated, end = True, now + WAIT_S
                self.notify(f"To the front, not to the side, which looks the same in a mirrored world: {WAIT_S:g} s")
            if now >= end:
                lost = [names[row] for row in rows if not sample.valid[row]]
                raise _not_raised(check, problems.why(now), lost, where)
        self.notify("left is left, up is up, and the front is in front: lower the arm")

    def _readings(self, *, measured: bool) -> Iterator[tuple[float, StreamReading]]:
        """The time, s, and the stream then, every POLL_S. measured: no other source may take over any more."""
        while True:
            self.clock.sleep_until(self.clock.now() + POLL_S)
            now = self.clock.now()
            self.look()
            self.stream.poll(now, moving=measured)
            yield now, self.stream.read(now)

    def _poll_for(self, seconds: float, *, measured: bool) -> None:
        end, readings = self.clock.now() + seconds, self._readings(measured=measured)
        while self.clock.now() < end:
            next(readings)

    def _skeleton_size(self) -> HumanDimensions | None:
        decoder = self.stream.decoder
        skeleton = decoder.rest_of(self.stream.roles.names) if isinstance(decoder, SkeletonSender) else None
        if skeleton is None:
            return None
        try:
            size = dimensions_from_skeleton(skeleton, source=self.where)
            return mirrored_dimensions(size) if self.stream.roles.mirrored else size
        except InputError as error:
            self.notify(f"the stream's skeleton is not used: {error}")
            return None

    def _captured(self, capture: RestCapture, size: HumanDimensions | None) -> Calibrated:
        """The calibration from the first interval of standing still.

        A silent stream is reported at once, and is then the reason of the InputError at the end.
        """
        problems, names = StreamProblems(self.stream), self.stream.roles.sensors
        end, look = self.clock.now() + self.options.patience + CAPTURE_S, 0.0
        tries, refused = Counter[str](), dict[str, InputError]()  # by problem
        reported = ""
        quiet = self.clock.now() + CAPTURE_S + MESSAGE_S  # the performer may still be getting into the pose
        for now, reading in self._readings(measured=True):
            capture.take(now, live_sample(names, frozen_as_fresh(reading), Alignment()))
            if message := problems.look(now):
                self.notify(str(message))  # nothing moves yet, so all are sent
            if now < end and not (capture.done and now >= look):
                continue
            look = now + TRY_S
            try:
                found = capture.result(stature=self.options.stature, size=size)
            except InputError as error:
                problem = error.problems[0]
                tries[problem.what] += 1
                refused[problem.what] = error
                if quiet <= now < end and problem.what != reported:
                    reported, quiet = problem.what, now + MESSAGE_S
                    self.notify(f"not yet, {problem.what}: {problem.found}. {problem.next_step}")
                if now >= end and (why := problems.why(now)):
                    raise InputError(why, where=f"{self.where}, calibration") from None
                if now >= end:
                    raise refused[tries.most_common(1)[0][0]] from None
                continue
            if now >= end or not any(self.stream.has_sent(name) for name in found.missing):  # it may be fresh soon
                return found
        raise AssertionError("readings do not end")


KEPT_S = 600.0  # of a run that are recorded for its report
FOR_EVER = 10**9  # more ticks than any run has
HUMAN_RATE_HZ = 100.0  # without a robot profile


def live_rate_hz(robot: RobotBody | None) -> float:
    """Ticks per second of a live run of this robot, or of the human alone."""
    return HUMAN_RATE_HZ if robot is None else robot.profile.safety.rate_hz


def begin_live(
    stream: LiveStream,
    options: LiveOptions,
    *,
    clock: Clock,
    rate_hz: float,
    where: str,
    notify: Notify,
    enter: Enter = lambda state: None,
    look: Callable[[], object] = lambda: None,
    has_deadlines: bool = True,
) -> Performance:
    """Wait for the stream, calibrate, and return the performance.

    The arguments are those of `Beginning` and `LivePerformer`. Raises InputError: no data, sensors missing, not still,
    no rest pose, sides swapped; ConfigError, UsageError: the person's file.
    """
    person = None
    if options.person is not None:
        check_person_place(options.person)
        person = None if options.recalibrate else read_person(options.person)
    if person is not None and options.stature is not None:
        raise refusal(UsageError, "known size", "--stature", found=f"--person {options.person}")
    if person is not None:
        stream.roles = stream.roles.shifted(person.offset(stream.roles.convention, stream.roles.sensors))
    refuse_unmeasurable(stream.roles, where=where)
    begin = Beginning(stream=stream, options=options, clock=clock, where=where, notify=notify, enter=enter, look=look)
    begin.wait_for_data()
    refuse_version(stream, clock.now())
    calibrated = begin.measure(None if person is None else person.dimensions)
    first = live_sample(stream.roles.sensors, stream.read(clock.now()), calibrated.alignment, mirror=options.mirror)
    ticks = FOR_EVER if options.duration is None else max(round(options.duration * rate_hz), 1)
    if options.check_sides:
        begin.check_sides(calibrated)
    if options.person is not None and person is None:
        _keep(options.person, calibrated, stream.roles.convention, notify)
    performer = LivePerformer(
        stream,
        calibrated.alignment,
        first,
        clock=clock,
        rate_hz=rate_hz,
        ticks=ticks,
        kept=min(ticks, round(KEPT_S * rate_hz), MAX_KEPT),
        mirror=options.mirror,
        optional=calibrated.missing if stream.roles.partial else (),
        has_deadlines=has_deadlines,
        waits=where.startswith("web:") and not has_deadlines,  # the page of simulated servos goes on without a new run
        notify=notify,
    )
    notes = tuple(f"{name} is not worn, or was not fresh: it takes no part until it is" for name in calibrated.missing)
    size = calibrated.dimensions
    return Performance(performer, mirrored_dimensions(size) if options.mirror else size, notes, SLOW_INTAKE)


def _keep(name: str, calibrated: Calibrated, convention: str, notify: Notify) -> None:
    rows = [row for row, sensor in enumerate(calibrated.sensors) if sensor not in calibrated.missing]
    person = person_of(
        name,
        calibrated.dimensions,
        sensors=tuple(calibrated.sensors[row] for row in rows),
        date=today(),
        convention=convention,
        offset=calibrated.offset[rows],
    )
    path = write_person(person)
    notify(f"kept for --person {name}: {path}")
