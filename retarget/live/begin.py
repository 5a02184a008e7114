"""The beginning of a live run: wait for data, calibrate a performer who stands still, check left and right, and make
the performer that the run follows.
"""

from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from hardware.clock import Clock, today
from retarget.errors import InputError, UsageError
from retarget.human.calibration import dimensions_from_skeleton
from retarget.human.performer_calibration import check_person_place, person_of, read_person, write_person
from retarget.human.samples import MAX_TICKS, Performance
from retarget.live.performer import INTAKE, LivePerformer, live_sample, missing_sensors, needed, refuse_unmeasurable
from retarget.live.playout import LIGHT
from retarget.live.rest_capture import (
    CAPTURE_S,
    KNOWN_CAPTURE_S,
    Alignment,
    Calibrated,
    RestCapture,
    frozen_as_fresh,
    skeleton_of,
)
from retarget.live.stream import LiveStream
from retarget.live.stream_report import StreamProblems, refuse_version, unusable
from retarget.model.human_dimensions import HumanDimensions, mirrored_dimensions
from retarget.model.robot import RobotBody
from retarget.types import FloatArray, Notify, RunState

Enter = Callable[[RunState], object]
"""Takes the state of a run that begins."""
LONGEST_COUNTDOWN_S = 600.0


@dataclass(frozen=True)
class LiveOptions:
    """How a live run begins.

    patience: s of waiting for data. countdown: s to get into the pose. duration: s of the run, None: until it is
    stopped. mirror: swap left and right. mass: kg of the performer, if known. smoothing: a name of
    `playout.SMOOTHINGS`. latest: use the newest poses, without a playout buffer. person: name under which the size is
    kept, None: it is not kept. recalibrate: measure also a person who was measured before. check_sides: ask for the
    left arm first. Raises UsageError for a countdown outside of its range.
    """

    patience: float = 10.0
    countdown: float = 3.0
    duration: float | None = None
    mirror: bool = False
    mass: float | None = None
    smoothing: str = LIGHT
    latest: bool = False
    person: str | None = None
    recalibrate: bool = False
    check_sides: bool = False

    def __post_init__(self) -> None:
        if not 0.0 <= self.countdown <= LONGEST_COUNTDOWN_S:  # nor NaN
            raise UsageError(
                "countdown out of range",
                where="--countdown",
                found=f"{self.countdown:g}",
                allowed=f"0 to {LONGEST_COUNTDOWN_S:g} s",
                next_step="Leave it out, or give some seconds",
            )


# Measuring a live performer: a countdown, and then a second of standing still, as soon as there is one.

POLL_S = 0.01
"""Between two polls of the stream while nothing moves."""
SETTLE_S = 0.3
"""Time in which the smoothing filter settles after the offset of a sensor was corrected."""
TRY_S = 0.1
"""Between two checks whether the performer stands still by now."""


def measure(
    stream: LiveStream,
    options: LiveOptions,
    known: HumanDimensions | None,
    *,
    clock: Clock,
    where: str,
    notify: Notify,
    enter: Enter = lambda state: None,
) -> Calibrated:
    """Measure floor, heading and size. The size is `known`, else that of the stream's skeleton, else of the rest pose.
    enter: receives the states of the run as they begin.

    Raises InputError: no fresh data, not still, no rest pose, or not of the known size.
    """
    pose = "Stand upright and still, facing where the robot faces, arms hanging or straight out to the sides"
    enter(RunState.COUNTDOWN)
    notify(f"{pose}: {options.countdown:g} s")
    _poll_for(stream, clock, options.countdown, measured=False)
    enter(RunState.CALIBRATING)
    size = known or _skeleton_size(stream, options, where=where, notify=notify)
    seconds = CAPTURE_S if known is None else KNOWN_CAPTURE_S
    capture = RestCapture(where=where, seconds=seconds, loose=stream.roles.loose, needed=needed(stream.roles))
    found = _captured(stream, options, capture, size, clock=clock, where=where, notify=notify)
    height = f"{found.dimensions.stature:.2f} m tall"
    notify(f"measured: {height}" if size is None else f"known: {height} ({size.origin})")
    if found.offset.any():
        stream.roles = stream.roles.shifted(found.offset)
        off = np.linalg.norm(found.offset, axis=1)
        offsets = [f"{name} {100 * by:.0f} cm" for name, by in zip(found.sensors, off, strict=True) if by > 0.0]
        notify(f"beside their joints: {', '.join(offsets)}")
        _poll_for(stream, clock, SETTLE_S, measured=True)
    return found


def _poll_for(stream: LiveStream, clock: Clock, seconds: float, *, measured: bool) -> None:
    """Only poll the stream for some seconds. measured: a performer was measured, no other source may take over."""
    end = clock.now() + seconds
    while clock.now() < end:
        clock.sleep_until(clock.now() + POLL_S)
        stream.poll(clock.now(), moving=measured)
        stream.read(clock.now())


def _skeleton_size(stream: LiveStream, options: LiveOptions, *, where: str, notify: Notify) -> HumanDimensions | None:
    """The size by the skeleton that the sender has sent; None where there is none, or none of a human's size."""
    skeleton = skeleton_of(stream.decoder, stream.roles.names)
    if skeleton is None:
        return None
    try:
        return dimensions_from_skeleton(skeleton, mass=options.mass, source=where)
    except InputError as error:
        notify(f"the stream's skeleton is not used: {error}")
        return None


def _captured(
    stream: LiveStream,
    options: LiveOptions,
    capture: RestCapture,
    size: HumanDimensions | None,
    *,
    clock: Clock,
    where: str,
    notify: Notify,
) -> Calibrated:
    """The calibration from the first interval of standing still.

    A stream that falls silent is reported at once, and is then the reason of the InputError at the end.
    """
    problems = StreamProblems(stream)
    end, look = clock.now() + options.patience + CAPTURE_S, 0.0
    tries, refused = Counter[str](), dict[str, InputError]()  # by what was wrong
    names = stream.roles.sensors
    while True:
        clock.sleep_until(clock.now() + POLL_S)
        now = clock.now()
        stream.poll(now, moving=True)  # the size may be that of the sender's skeleton, so no other may take over
        capture.take(now, live_sample(names, frozen_as_fresh(stream.read(now)), Alignment()))
        if message := problems.look(now):
            notify(message)
        if now >= end or (capture.done and now >= look):
            look = now + TRY_S
            try:
                found = capture.result(mass=options.mass, size=size)
            except InputError as error:
                tries[error.problems[0].what] += 1
                refused[error.problems[0].what] = error
                if now >= end and (why := problems.why(now)):
                    raise InputError(why, where=f"{where}, calibration") from None
                if now >= end:
                    raise refused[tries.most_common(1)[0][0]] from None
                continue
            if now < end and any(stream.has_sent(name) for name in found.missing):  # it may be fresh soon
                continue
            return found


# The check of sides: raise your left arm to the front. This one motion shows that left and right, up and down are not
# swapped, and that the world is not mirrored: calibration turns a mirrored world until left is left, and its front is
# then behind.

RISE_M = 0.3
"""The left wrist must rise by more than this. A wrist that sinks by more than this shows a vertical axis with the wrong
sign."""
FRONT_M = 0.25
"""The left wrist must come forward by more than this. Less is an arm to the side, which looks the same in a mirror."""
BACK_M = 0.15
"""A raised arm cannot be farther back than this: shoulders do not turn that way."""
STILL_M = 0.15
"""The other wrist must rise by less than this."""
STAYS_M = 0.25
"""The other wrist must move horizontally by less than this: a performer who turns around proves nothing."""
SURE_S = 0.2
"""The wrists must be so for this long: a single jump proves nothing."""
WAIT_S = 10.0

SIDES = ("left", "right")
ASIDE = "left rose aside"
_SWAP = "Swap the roles of the left and right trackers, or their names in the performer's file"


class SideCheck:
    """Watches how both wrists move from where they hang. `take` their positions; read `passed` and `refused`."""

    def __init__(self, rest: FloatArray) -> None:
        """rest (2, 3) m: the left and the right wrist at rest; x forward, z up."""
        self.passed = False
        self.refused: tuple[str, str] | None = None
        """What is wrong, and the next step."""
        self.aside = False
        """Whether the left arm was raised to the side."""
        self.highest = np.zeros(2)
        """m above rest, the highest so far, of the left and the right wrist."""
        self.forward = 0.0
        """m forward of rest, of the left wrist when it was highest."""
        self._rest = np.array(rest, dtype=float)
        self._seen: str = ""
        self._since = 0.0

    def take(self, time: float, position: FloatArray) -> None:
        """Take the positions (2, 3) m of both wrists at `time`, s; NaN where unknown."""
        moved = position - self._rest
        if moved[0, 2] > self.highest[0]:
            self.forward = float(moved[0, 0])
        self.highest = np.fmax(self.highest, moved[:, 2])
        seen = _what_moved(moved)
        if seen != self._seen:
            self._seen, self._since = seen, time
        if not seen or time - self._since < SURE_S:
            return
        self.passed = seen == "left rose"
        self.aside |= seen == ASIDE
        self.refused = _REFUSALS.get(seen)


_REFUSALS = {
    "right rose": ("the right wrist rose: left and right are swapped", _SWAP),
    "left rose behind": (
        "the left wrist went back: the axes are mirrored",
        "One horizontal axis (x or y) of what is sent has the wrong sign: see that the convention of roles, "
        "or the axes that the sender names, are the sender's, and that it mirrors nothing",
    ),
    "left sank": (
        "the left wrist went down: up is down",
        "See that the convention of roles is that of the sender, and reset the trackers",
    ),
    "right sank": (
        "the right wrist went down: left and right are swapped, and up is down",
        "See that the convention of roles is that of the sender, and which tracker is worn where",
    ),
}


def _what_moved(moved: FloatArray) -> str:
    """How one wrist moved while the other stayed; "" for anything else. moved (2, 3) m, from where they hang."""
    for side, row in zip(SIDES, (0, 1), strict=True):
        other = moved[1 - row]
        if not (abs(other[2]) < STILL_M and np.hypot(other[0], other[1]) < STAYS_M):  # nor NaN
            continue
        if moved[row, 2] < -RISE_M:
            return f"{side} sank"
        if moved[row, 2] > RISE_M:
            return f"{side} rose{_direction(moved[row, 0]) if side == 'left' else ''}"
    return ""


def _direction(forward: float) -> str:
    if forward < -BACK_M:
        return " behind"
    return "" if forward > FRONT_M else " aside"


def check_sides(stream: LiveStream, rest: Calibrated, *, clock: Clock, where: str, notify: Notify) -> None:
    """Ask for the left arm to the front, and wait until it comes. Ask once more if it goes to the side.

    rest: where the wrists were when the performer was measured. Raises InputError with what moved instead, and the next
    step.
    """
    names = stream.roles.sensors
    rows = [names.index("l_wrist"), names.index("r_wrist")]
    check, asked_again, problems = SideCheck(rest.position[rows]), False, StreamProblems(stream)
    notify(f"Raise your left arm forward, to the front, and only that: {WAIT_S:g} s")
    end = clock.now() + WAIT_S
    while not check.passed:
        clock.sleep_until(clock.now() + POLL_S)
        now = clock.now()
        stream.poll(now, moving=True)  # no other source may take over: the size is that of this performer
        reading = frozen_as_fresh(stream.read(now))
        sample = live_sample(names, reading, rest.alignment)
        check.take(now, np.where(sample.valid[rows, None], sample.position[rows], np.nan))
        if message := problems.look(now):
            notify(message)
        if check.refused is not None:
            what, step = check.refused
            raise InputError(what, where=f"{where}, raise your left arm", found=_found(check), next_step=step)
        if check.aside and not asked_again:
            asked_again, end = True, now + WAIT_S
            notify(f"To the front, not to the side, which looks the same in a mirrored world: {WAIT_S:g} s")
        if now >= end and not check.passed:
            lost = [names[row] for row in rows if not reading.fresh[row]]
            raise _no_data(problems.why(now), lost, where) or _not_seen(check, where)
    notify("left is left, up is up, and the front is in front: lower the arm")


def _no_data(why: str, lost: list[str], where: str) -> InputError | None:
    """The error for missing data, None where data are fine. It does not propose to leave the check out.

    why: what is wrong with the stream, "" for nothing. lost: wrists that are not fresh.
    """
    if why:
        return InputError(why.rstrip("."), where=f"{where}, raise your left arm")
    if lost:
        step = "See that they are worn, switched on and seen, and try again"
        return InputError(
            "sensors are lost", where=f"{where}, raise your left arm", found=f"no {', no '.join(lost)}", next_step=step
        )
    return None


def _not_seen(check: SideCheck, where: str) -> InputError:
    what, step = (
        "the left arm was not seen to rise",
        "See that the trackers of both hands move with them, and try again",
    )
    if check.aside:
        what = "the left arm rose to the side only, which does not show whether the axes are mirrored"
        step = "Raise it to the front"
    return InputError(
        what,
        where=f"{where}, raise your left arm",
        found=_found(check),
        allowed=f"the left wrist up by more than {RISE_M:g} m and forward by more than {FRONT_M:g} m, the right one "
        f"up by less than {STILL_M:g} m",
        next_step=f"{step}; or --no-check-sides",
    )


def _found(check: SideCheck) -> str:
    left, right = 100 * check.highest
    forward = 100 * check.forward
    way = f"forward by {forward:.0f} cm" if forward >= 0.0 else f"back by {-forward:.0f} cm"
    return f"the left wrist rose by {left:.0f} cm and went {way}, the right wrist rose by {right:.0f} cm"


KEPT_S = 600.0
"""A run is recorded for its report up to this long; a longer one goes on without."""
FOR_EVER = 10**9
HUMAN_RATE_HZ = 100.0
"""Ticks per second where there is no robot with a profile."""


def live_rate_hz(robot: RobotBody | None) -> float:
    """Ticks per second of a live run of this robot; of the human alone for None."""
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
    has_deadlines: bool = True,
) -> Performance:
    """Wait for the stream, calibrate, and return the performance.

    notify: receives what the performer is to do, and later what changes. enter: receives the states of the run as they
    begin: COUNTDOWN, CALIBRATING, CHECKING_SIDES. has_deadlines: as of `LivePerformer`. Raises InputError: no data,
    sensors missing, not still, no rest pose, sides swapped; ConfigError, UsageError: the person's file. Each names the
    next step.
    """
    person = None
    if options.person is not None:
        check_person_place(options.person)
        person = None if options.recalibrate else read_person(options.person)
    if person is not None:
        stream.roles = stream.roles.shifted(person.offset(stream.roles.convention, stream.roles.sensors))
    refuse_unmeasurable(stream.roles, where=where)
    wait_for_data(stream, options, clock, where=where)
    refuse_version(stream, clock.now())
    known = None if person is None else person.dimensions
    calibrated = measure(stream, options, known, clock=clock, where=where, notify=notify, enter=enter)
    first = live_sample(stream.roles.sensors, stream.read(clock.now()), calibrated.alignment, mirror=options.mirror)
    ticks = FOR_EVER if options.duration is None else max(round(options.duration * rate_hz), 1)
    if options.check_sides:
        enter(RunState.CHECKING_SIDES)
        check_sides(stream, calibrated, clock=clock, where=where, notify=notify)
    if options.person is not None and person is None:
        _keep(options.person, calibrated, stream.roles.convention, notify)
    performer = LivePerformer(
        stream,
        calibrated.alignment,
        first,
        clock=clock,
        rate_hz=rate_hz,
        ticks=ticks,
        kept=min(ticks, round(KEPT_S * rate_hz), MAX_TICKS),
        mirror=options.mirror,
        optional=calibrated.missing if stream.roles.partial else (),
        has_deadlines=has_deadlines,
        notify=notify,
    )
    notes = tuple(f"{name} is not worn, or was not fresh: it takes no part until it is" for name in calibrated.missing)
    size = calibrated.dimensions
    return Performance(performer, mirrored_dimensions(size) if options.mirror else size, notes, INTAKE)


def _keep(name: str, calibrated: Calibrated, convention: str, notify: Notify) -> None:
    """Write the person's file."""
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


def wait_for_data(stream: LiveStream, options: LiveOptions, clock: Clock, *, where: str) -> None:
    """Wait until every needed sensor is fresh, and the stream has every sensor that the performer's file lists.

    Raises InputError after `options.patience` s.
    """
    deadline = clock.now() + options.patience
    while True:
        stream.poll(clock.now(), moving=False)
        missing = missing_sensors(stream, clock.now())
        if not missing:
            return
        if clock.now() >= deadline:
            raise unusable(stream, missing, options.patience, where=where, now=clock.now())
        clock.sleep_until(clock.now() + POLL_S)
