"""The beginning of a live run: wait for data, calibrate a performer who stands still, check the sides, and begin
there.
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
from retarget.live.rest_capture import (
    CAPTURE_S,
    KNOWN_CAPTURE_S,
    Alignment,
    Calibrated,
    RestCapture,
    frozen_as_fresh,
    stream_skeleton,
)
from retarget.live.smoothing import LIGHT
from retarget.live.stream import LiveStream
from retarget.live.stream_report import StreamProblems, refuse_version, unusable
from retarget.model.human_dimensions import HumanDimensions, mirrored_dimensions
from retarget.model.robot import RobotBody
from retarget.types import FloatArray

__all__ = [
    "BACK_M",
    "FRONT_M",
    "LONGEST_COUNTDOWN_S",
    "RISE_M",
    "LiveOptions",
    "SideCheck",
    "begin_live",
    "live_rate_hz",
    "measure",
]


# How a live run begins and is reading.

LONGEST_COUNTDOWN_S = 600.0


@dataclass(frozen=True)
class LiveOptions:
    """How a live run begins. patience: s of waiting for data. countdown: s to get into the pose. duration: s of the
    run, None: until it is stopped. mirror: left and right exchanged. mass: kg of the performer, if known. smoothing:
    of `smoothing.SMOOTHINGS`. latest: the newest poses count, without a playout buffer. person: name under which the
    size is kept, None: it is not. recalibrate: measure also whoever was measured before. check_sides: the left arm is
    to be raised first. Raises UsageError: a countdown that is none."""

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
                "this is no time to get into the pose",
                where="--countdown",
                found=f"{self.countdown:g}",
                allowed=f"0 to {LONGEST_COUNTDOWN_S:g} s",
                next_step="Leave it out, or give some seconds",
            )


# Measuring a live performer: a countdown, and then a moment of standing still, as soon as there is one.

POLL_S = 0.01
"""Between two looks at the stream while nothing moves."""
SETTLE_S = 0.3
"""So long what is smoothed takes to be where a corrected sensor is."""
MOST_POLLS = 64
"""Times that a backlog is listened to at once: a fit takes a while on a busy machine, and one listening is bounded."""
TRY_S = 0.1
"""Between two looks at whether the performer stands still by now."""


def measure(
    stream: LiveStream,
    options: LiveOptions,
    known: HumanDimensions | None,
    *,
    clock: Clock,
    where: str,
    notify: Callable[[str], object],
) -> Calibrated:
    """Floor, heading, and the size: as `known`, else as the stream's skeleton tells, else from the rest pose.

    Raises InputError: no fresh data, not still, no rest pose, or not of the known size.
    """
    pose = "Stand upright and still, facing where the robot faces, arms hanging or straight out to the sides"
    notify(f"{pose}: {options.countdown:g} s")
    _listen(stream, clock, options.countdown, measured=False)
    stream.validity.keep_sides()  # before, whoever wears trackers may have put their names right
    size = known or _told_size(stream, options, where=where, notify=notify)
    lasts = CAPTURE_S if known is None else KNOWN_CAPTURE_S
    capture = RestCapture(where=where, lasts=lasts, loose=stream.roles.loose, needed=needed(stream.roles))
    found = _captured(stream, options, capture, size, clock=clock, where=where, notify=notify)
    height = f"{found.dimensions.stature:.2f} m tall"
    notify(f"measured: {height}" if size is None else f"known: {height} ({size.origin})")
    if found.offset.any():
        stream.roles = stream.roles.shifted(found.offset)
        off = np.linalg.norm(found.offset, axis=1)
        told = [f"{name} {100 * by:.0f} cm" for name, by in zip(found.sensors, off, strict=True) if by > 0.0]
        notify(f"beside their joints: {', '.join(told)}")
        _listen(stream, clock, SETTLE_S, measured=True)
    return found


def _listen(stream: LiveStream, clock: Clock, seconds: float, *, measured: bool) -> None:
    """Nothing else for so long. measured: somebody was, and nobody else takes over the stream."""
    end = clock.now() + seconds
    while clock.now() < end:
        clock.sleep_until(clock.now() + POLL_S)
        stream.poll(clock.now(), moving=measured)
        stream.read(clock.now())


def _told_size(
    stream: LiveStream, options: LiveOptions, *, where: str, notify: Callable[[str], object]
) -> HumanDimensions | None:
    """The size by the skeleton that the sender has told; None where it has none that is a human's."""
    skeleton = stream_skeleton(stream.decoder, stream.roles.names)
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
    notify: Callable[[str], object],
) -> Calibrated:
    """The first moment of standing still. A stream that falls silent is told at once, and is then why there is none."""
    trouble = StreamProblems(stream)
    end, look = clock.now() + options.patience + CAPTURE_S, 0.0
    tries, refused = Counter[str](), dict[str, InputError]()  # by what was in the way
    names = stream.roles.sensors
    everybody = np.ones(len(names), dtype=bool)
    while True:
        clock.sleep_until(clock.now() + POLL_S)
        now = clock.now()
        _catch_up(stream, now)
        capture.take(now, live_sample(names, frozen_as_fresh(stream.read(now)), Alignment(), believed=everybody))
        if message := trouble.look(now):
            notify(message)
        if now >= end or (capture.done and now >= look):
            look = now + TRY_S
            try:
                found = capture.result(mass=options.mass, size=size)
            except InputError as error:
                tries[error.problems[0].what] += 1
                refused[error.problems[0].what] = error
                if now >= end and (why := trouble.why(now)):
                    raise InputError(why, where=f"{where}, calibration") from None
                if now >= end:
                    raise refused[tries.most_common(1)[0][0]] from None
                continue
            if now < end and any(stream.has_sent(name) for name in found.missing):  # it may be fresh soon
                continue
            return found


def _catch_up(stream: LiveStream, now: float) -> None:
    """Take in all that has arrived. The size may be that of the sender's skeleton: it stays this sender."""
    for _ in range(MOST_POLLS):
        before = stream.arrived
        stream.poll(now, moving=True)
        if stream.arrived == before:
            return


# Raise your left arm to the front: the one motion that proves which side is which, that up is up, and that the world
# is not mirrored: its calibration turns it until left is left, and what was the front is then the back.

RISE_M = 0.3
"""So far the left wrist rises; a wrist that sinks so far tells an axis that is upside down."""
FRONT_M = 0.25
"""So far it comes forward meanwhile: less is an arm to the side, which looks the same in a mirror."""
BACK_M = 0.15
"""An arm that has risen is no farther back than this: shoulders do not turn that way."""
STILL_M = 0.15
"""The other wrist rises less than this meanwhile."""
STAYS_M = 0.25
"""And goes less far on the floor: whoever turns around shows nothing."""
SURE_S = 0.2
"""So long it must be so: a single leap proves nothing."""
WAIT_S = 10.0

SIDES = ("left", "right")
ASIDE = "left rose aside"
_SWAP = "Swap the roles of the left and right trackers, or their names in the performer's file"


class SideCheck:
    """Where both wrists went since they hung: `take` it; `passed`, or `refused` with what is wrong."""

    def __init__(self, rest: FloatArray) -> None:
        """rest (2, 3) m: the left and the right wrist at rest; x forward, z up."""
        self.passed = False
        self.refused: tuple[str, str] | None = None
        """What is wrong, and what to do."""
        self.aside = False
        """Whether the left arm was raised to the side."""
        self.highest = np.zeros(2)
        """m above rest, the farthest so far."""
        self.forward = 0.0
        """m by which the left wrist was before its rest when it was highest."""
        self._rest = np.array(rest, dtype=float)
        self._seen: str = ""
        self._since = 0.0

    def take(self, time: float, position: FloatArray) -> None:
        """Both wrists (2, 3) m at `time`, s; NaN where it is not known."""
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
    "right rose": ("the right wrist rose: left and right are exchanged", _SWAP),
    "left rose behind": (
        "the left wrist went back: the axes are mirrored",
        "One level axis of what is sent has the wrong sign, whichever: see that the convention of roles, or the axes "
        "that the sender names, are the sender's, and that it mirrors nothing",
    ),
    "left sank": (
        "the left wrist went down: up is down",
        "See that the convention of roles is that of the sender, and reset the trackers",
    ),
    "right sank": (
        "the right wrist went down: left and right are exchanged, and up is down",
        "See that the convention of roles is that of the sender, and which tracker is worn where",
    ),
}


def _what_moved(moved: FloatArray) -> str:
    """One wrist, alone; "" for anything else. moved (2, 3) m, since they hung."""
    for side, row in zip(SIDES, (0, 1), strict=True):
        other = moved[1 - row]
        if not (abs(other[2]) < STILL_M and np.hypot(other[0], other[1]) < STAYS_M):  # nor NaN
            continue
        if moved[row, 2] < -RISE_M:
            return f"{side} sank"
        if moved[row, 2] > RISE_M:
            return f"{side} rose{_whereto(moved[row, 0]) if side == 'left' else ''}"
    return ""


def _whereto(forward: float) -> str:
    if forward < -BACK_M:
        return " behind"
    return "" if forward > FRONT_M else " aside"


def check_sides(
    stream: LiveStream, rest: Calibrated, *, clock: Clock, where: str, notify: Callable[[str], object]
) -> None:
    """Ask for the left arm to the front, and see it come; once more if it goes to the side.

    rest: where the wrists were when the performer was measured. Raises InputError with what rose instead, and what to
    do about it.
    """
    names = stream.roles.sensors
    rows = [names.index("l_wrist"), names.index("r_wrist")]
    everybody = np.ones(len(names), dtype=bool)
    check, asked_again, trouble = SideCheck(rest.position[rows]), False, StreamProblems(stream)
    notify(f"Raise your left arm forward, to the front, and only that: {WAIT_S:g} s")
    end = clock.now() + WAIT_S
    while not check.passed:
        clock.sleep_until(clock.now() + POLL_S)
        now = clock.now()
        stream.poll(now, moving=True)  # who was measured keeps the stream: nobody else has this size
        reading = frozen_as_fresh(stream.read(now))
        sample = live_sample(names, reading, rest.alignment, believed=everybody)
        check.take(now, np.where(sample.valid[rows, None], sample.position[rows], np.nan))
        if message := trouble.look(now):
            notify(message)
        if check.refused is not None:
            what, step = check.refused
            raise InputError(what, where=f"{where}, raise your left arm", found=_found(check), next_step=step)
        if check.aside and not asked_again:
            asked_again, end = True, now + WAIT_S
            notify(f"To the front, not to the side, which looks the same in a mirrored world: {WAIT_S:g} s")
        if now >= end and not check.passed:
            lost = [names[row] for row in rows if not reading.fresh[row]]
            raise _not_heard(trouble.why(now), lost, where) or _not_seen(check, where)
    notify("left is left, up is up, and the front is in front: lower the arm")


def _not_heard(why: str, lost: list[str], where: str) -> InputError | None:
    """What is wrong with the data, where that is why nothing was seen: then the check is not what to leave out. why: of
    the stream, "" where it is well; lost: wrists that are not fresh."""
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
        what = "the left arm rose to the side only, which does not tell whether the axes are mirrored"
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
"""So long a run is remembered for its report; a longer one goes on without."""
FOR_EVER = 10**9
HUMAN_RATE_HZ = 100.0
"""Ticks per second where there is no robot whose profile says it."""


def live_rate_hz(robot: RobotBody | None) -> float:
    """Ticks per second of a live run of this robot; None: of the human alone."""
    return HUMAN_RATE_HZ if robot is None else robot.profile.safety.rate_hz


def begin_live(
    stream: LiveStream,
    options: LiveOptions,
    *,
    clock: Clock,
    rate_hz: float,
    where: str,
    notify: Callable[[str], object],
) -> Performance:
    """Wait for the stream, calibrate, and return who performs.

    tell: hears what the performer is to do, and later what changes. Raises InputError: no data, sensors missing, not
    still, no rest pose, sides exchanged; ConfigError, UsageError: the person's file; with what to do.
    """
    person = None
    if options.person is not None:
        check_person_place(options.person)
        person = None if options.recalibrate else read_person(options.person)
    if person is not None:
        stream.roles = stream.roles.shifted(person.offset(stream.roles.convention, stream.roles.sensors))
    refuse_unmeasurable(stream.roles, where=where)
    _wait(stream, options, clock, where=where)
    refuse_version(stream, clock.now())
    known = None if person is None else person.dimensions
    calibrated = measure(stream, options, known, clock=clock, where=where, notify=notify)
    reading = stream.read(clock.now())
    everybody = np.ones(len(reading.states), dtype=bool)
    names = stream.roles.sensors
    first = live_sample(names, reading, calibrated.alignment, believed=everybody, mirror=options.mirror)
    ticks = FOR_EVER if options.duration is None else max(round(options.duration * rate_hz), 1)
    if options.check_sides:
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
        lacking=calibrated.missing if stream.roles.partial else (),
        notify=notify,
    )
    notes = tuple(f"{name} is not worn, or was not fresh: it takes no part until it is" for name in calibrated.missing)
    size = calibrated.dimensions
    return Performance(performer, mirrored_dimensions(size) if options.mirror else size, notes, INTAKE)


def _keep(name: str, calibrated: Calibrated, convention: str, notify: Callable[[str], object]) -> None:
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


def _wait(stream: LiveStream, options: LiveOptions, clock: Clock, *, where: str) -> None:
    """Until every sensor that is needed is fresh, and none is listed that the stream does not have."""
    deadline = clock.now() + options.patience
    while True:
        stream.poll(clock.now(), moving=False)
        missing = missing_sensors(stream, clock.now())
        if not missing:
            return
        if clock.now() >= deadline:
            raise unusable(stream, missing, options.patience, where=where, now=clock.now())
        clock.sleep_until(clock.now() + POLL_S)
