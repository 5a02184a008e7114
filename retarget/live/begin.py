"""The beginning of a live run: wait for data, let the performer stand still on a countdown, and begin there."""

from collections.abc import Callable

import numpy as np

from hardware.clock import Clock, today
from retarget.clip import MAX_TICKS
from retarget.human_dimensions import mirrored_dimensions
from retarget.live.live_options import LiveOptions
from retarget.live.measuring import LISTEN_S, measure
from retarget.live.needed import missing_sensors, refuse_unmeasurable
from retarget.live.performer import INTAKE, LivePerformer, live_sample
from retarget.live.person_file import check_person_place, person_of, read_person, write_person
from retarget.live.rest_capture import Calibrated
from retarget.live.side_check import check_sides
from retarget.live.stream import LiveStream
from retarget.live.stream_trouble import refuse_version, unusable
from retarget.robot_body import RobotBody
from retarget.samples import Performance

__all__ = ["LiveOptions", "begin_live", "live_rate_hz"]

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
    tell: Callable[[str], object],
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
    calibrated = measure(stream, options, known, clock=clock, where=where, tell=tell)
    heard = stream.read(clock.now())
    everybody = np.ones(len(heard.states), dtype=bool)
    names = stream.roles.sensors
    first = live_sample(names, heard, calibrated.alignment, believed=everybody, mirror=options.mirror)
    ticks = FOR_EVER if options.duration is None else max(round(options.duration * rate_hz), 1)
    if options.check_sides:
        check_sides(stream, calibrated, clock=clock, where=where, tell=tell)
    if options.person is not None and person is None:
        _keep(options.person, calibrated, stream.roles.convention, tell)
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
        tell=tell,
    )
    notes = tuple(f"{name} is not worn, or was not fresh: it takes no part until it is" for name in calibrated.missing)
    size = calibrated.dimensions
    return Performance(performer, mirrored_dimensions(size) if options.mirror else size, notes, INTAKE)


def _keep(name: str, calibrated: Calibrated, convention: str, tell: Callable[[str], object]) -> None:
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
    tell(f"kept for --person {name}: {path}")


def _wait(stream: LiveStream, options: LiveOptions, clock: Clock, *, where: str) -> None:
    """Until every sensor that is needed is fresh, and none is listed that the stream does not have."""
    deadline = clock.now() + options.patience
    while True:
        stream.listen(clock.now(), moving=False)
        missing = missing_sensors(stream, clock.now())
        if not missing:
            return
        if clock.now() >= deadline:
            raise unusable(stream, missing, options.patience, where=where, now=clock.now())
        clock.sleep_until(clock.now() + LISTEN_S)
