"""Measuring a live performer: a countdown, and then a moment of standing still, as soon as there is one."""

from collections import Counter
from collections.abc import Callable

import numpy as np

from hardware.clock import Clock
from retarget.calibration import dimensions_from_skeleton
from retarget.errors import InputError
from retarget.human_dimensions import HumanDimensions
from retarget.live.alignment import Alignment
from retarget.live.live_options import LiveOptions
from retarget.live.needed import needed
from retarget.live.performer import live_sample
from retarget.live.rest_capture import CAPTURE_S, KNOWN_CAPTURE_S, Calibrated, RestCapture, believing_still
from retarget.live.stream import LiveStream
from retarget.live.stream_trouble import StreamTrouble
from retarget.live.told_skeleton import told_skeleton

__all__ = ["LISTEN_S", "measure"]

LISTEN_S = 0.01
"""Between two looks at the stream while nothing moves."""
SETTLE_S = 0.3
"""So long what is smoothed takes to be where a corrected sensor is."""
MOST_LISTENED = 64
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
    tell: Callable[[str], object],
) -> Calibrated:
    """Floor, heading, and the size: as `known`, else as the stream's skeleton tells, else from the rest pose.

    Raises InputError: no fresh data, not still, no rest pose, or not of the known size.
    """
    pose = "Stand upright and still, facing where the robot faces, arms hanging or straight out to the sides"
    tell(f"{pose}: {options.countdown:g} s")
    _listen(stream, clock, options.countdown, measured=False)
    stream.trust.keep_sides()  # before, whoever wears trackers may have put their names right
    size = known or _told_size(stream, options, where=where, tell=tell)
    lasts = CAPTURE_S if known is None else KNOWN_CAPTURE_S
    capture = RestCapture(where=where, lasts=lasts, loose=stream.roles.loose, needed=needed(stream.roles))
    found = _captured(stream, options, capture, size, clock=clock, where=where, tell=tell)
    height = f"{found.dimensions.stature:.2f} m tall"
    tell(f"measured: {height}" if size is None else f"known: {height} ({size.origin})")
    if found.offset.any():
        stream.roles = stream.roles.shifted(found.offset)
        off = np.linalg.norm(found.offset, axis=1)
        told = [f"{name} {100 * by:.0f} cm" for name, by in zip(found.sensors, off, strict=True) if by > 0.0]
        tell(f"beside their joints: {', '.join(told)}")
        _listen(stream, clock, SETTLE_S, measured=True)
    return found


def _listen(stream: LiveStream, clock: Clock, seconds: float, *, measured: bool) -> None:
    """Nothing else for so long. measured: somebody was, and nobody else takes over the stream."""
    end = clock.now() + seconds
    while clock.now() < end:
        clock.sleep_until(clock.now() + LISTEN_S)
        stream.listen(clock.now(), moving=measured)
        stream.read(clock.now())


def _told_size(
    stream: LiveStream, options: LiveOptions, *, where: str, tell: Callable[[str], object]
) -> HumanDimensions | None:
    """The size by the skeleton that the sender has told; None where it has none that is a human's."""
    skeleton = told_skeleton(stream.decoder, stream.roles.names)
    if skeleton is None:
        return None
    try:
        return dimensions_from_skeleton(skeleton, mass=options.mass, source=where)
    except InputError as error:
        tell(f"the stream's skeleton is not used: {error}")
        return None


def _captured(
    stream: LiveStream,
    options: LiveOptions,
    capture: RestCapture,
    size: HumanDimensions | None,
    *,
    clock: Clock,
    where: str,
    tell: Callable[[str], object],
) -> Calibrated:
    """The first moment of standing still. A stream that falls silent is told at once, and is then why there is none."""
    trouble = StreamTrouble(stream)
    end, look = clock.now() + options.patience + CAPTURE_S, 0.0
    tries, refused = Counter[str](), dict[str, InputError]()  # by what was in the way
    names = stream.roles.sensors
    everybody = np.ones(len(names), dtype=bool)
    while True:
        clock.sleep_until(clock.now() + LISTEN_S)
        now = clock.now()
        _catch_up(stream, now)
        capture.take(now, live_sample(names, believing_still(stream.read(now)), Alignment(), believed=everybody))
        if message := trouble.look(now):
            tell(message)
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
            if now < end and any(stream.tells(name) for name in found.missing):  # it may be fresh soon
                continue
            return found


def _catch_up(stream: LiveStream, now: float) -> None:
    """Take in all that has arrived. The size may be that of the sender's skeleton: it stays this sender."""
    for _ in range(MOST_LISTENED):
        before = stream.arrived
        stream.listen(now, moving=True)
        if stream.arrived == before:
            return
