"""The beginning of a live run: wait for data, let the performer stand still on a countdown, and begin there."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from hardware.clock import Clock
from retarget.clip import MAX_TICKS
from retarget.errors import InputError
from retarget.live.alignment import Alignment
from retarget.live.performer import INTAKE, LivePerformer, live_sample
from retarget.live.rest_capture import CAPTURE_S, Calibrated, RestCapture
from retarget.live.smoothing import LIGHT
from retarget.live.stream import LiveStream
from retarget.live.trust_state import TrustState
from retarget.rest_pose import REQUIRED
from retarget.samples import Performance

__all__ = ["LiveOptions", "begin_live"]

LISTEN_S = 0.01
"""Between two looks at the stream while nothing moves."""
TRY_S = 0.1
"""Between two looks at whether the performer stands still by now."""
KEPT_S = 600.0
"""So long a run is remembered for its report; a longer one goes on without."""
FOR_EVER = 10**9


@dataclass(frozen=True)
class LiveOptions:
    """How a live run begins. patience: s of waiting for data. countdown: s to get into the pose. duration: s of the
    run, None: until it is stopped. mirror: left and right exchanged. mass: kg of the performer, if known. smoothing:
    of `smoothing.SMOOTHINGS`. latest: the newest poses count, without a playout buffer."""

    patience: float = 10.0
    countdown: float = 3.0
    duration: float | None = None
    mirror: bool = False
    mass: float | None = None
    smoothing: str = LIGHT
    latest: bool = False


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
    still, no rest pose; with what to do.
    """
    _wait(stream, options, clock, where=where)
    calibrated = _calibrate(stream, options, clock, where=where, tell=tell)
    heard = stream.read(clock.now())
    everybody = np.ones(len(heard.states), dtype=bool)
    names = stream.roles.sensors
    first = live_sample(names, heard, calibrated.alignment, believed=everybody, mirror=options.mirror)
    ticks = FOR_EVER if options.duration is None else max(round(options.duration * rate_hz), 1)
    performer = LivePerformer(
        stream,
        calibrated.alignment,
        first,
        clock=clock,
        rate_hz=rate_hz,
        ticks=ticks,
        kept=min(ticks, round(KEPT_S * rate_hz), MAX_TICKS),
        mirror=options.mirror,
        tell=tell,
    )
    notes = tuple(f"{name} is not worn, or was not fresh: it takes no part until it is" for name in calibrated.missing)
    return Performance(performer, calibrated.dimensions, notes, INTAKE)


def _wait(stream: LiveStream, options: LiveOptions, clock: Clock, *, where: str) -> None:
    """Until every sensor without which nobody can be measured is fresh."""
    names = stream.roles.sensors
    deadline = clock.now() + options.patience
    while True:
        stream.listen(clock.now(), moving=False)
        fresh = stream.read(clock.now()).fresh
        missing = [name for name, ok in zip(names, fresh, strict=True) if not ok and name in REQUIRED]
        if not missing:
            return
        if clock.now() >= deadline:
            raise _nothing(stream, missing, options.patience, where=where)
        clock.sleep_until(clock.now() + LISTEN_S)


def _nothing(stream: LiveStream, missing: list[str], waited: float, *, where: str) -> InputError:
    """Why nobody can be followed, as far as the stream tells."""
    if stream.arrived == 0:
        return InputError(
            f"nothing arrives, waited {waited:g} s",
            where=where,
            next_step="Start the sender, let it send to this address and port, and see that no firewall is between",
        )
    refused = stream.admission.refused.reasons | stream.decoder.dropped.reasons | stream.trust.refused.reasons
    reasons = "; ".join(f"{reason} ({count})" for reason, count in refused.most_common(3))
    if stream.frames == 0:
        return InputError(
            "what arrives cannot be used",
            where=where,
            found=f"{stream.arrived} datagrams: {reasons or 'no poses in them'}",
            next_step="See that the sender speaks the protocol of this address",
        )
    wanted = {name: stream.roles.places[stream.roles.sensors.index(name)].position for name in missing}
    return InputError(
        "sensors are missing in the stream",
        where=where,
        found=", ".join(f"no {name} ({told})" for name, told in wanted.items())
        + (f"; refused: {reasons}" if reasons else ""),
        allowed=", ".join(list(stream.names)[:40]),
        next_step="Wear and switch on these, or choose another --performer",
    )


def _calibrate(
    stream: LiveStream, options: LiveOptions, clock: Clock, *, where: str, tell: Callable[[str], object]
) -> Calibrated:
    """A countdown, then a second of standing still, as soon as there is one."""
    pose = "Stand upright and still, facing where the robot faces, arms hanging or straight out to the sides"
    tell(f"{pose}: {options.countdown:g} s")
    end = clock.now() + options.countdown
    while clock.now() < end:
        clock.sleep_until(clock.now() + LISTEN_S)
        stream.listen(clock.now(), moving=False)
    capture, end, look = RestCapture(where=where), clock.now() + options.patience + CAPTURE_S, 0.0
    names = stream.roles.sensors
    while True:
        clock.sleep_until(clock.now() + LISTEN_S)
        now = clock.now()
        stream.listen(now, moving=False)
        heard = stream.read(now)
        # Nothing that is worn by somebody who stands still has to move.
        still = np.where(heard.states == TrustState.FROZEN, TrustState.FRESH, heard.states).astype(np.uint8)
        everybody = np.ones(len(still), dtype=bool)
        capture.take(now, live_sample(names, replace(heard, states=still), Alignment(), believed=everybody))
        if now >= end or (capture.done and now >= look):
            look = now + TRY_S
            try:
                found = capture.result(mass=options.mass)
            except InputError:
                if now >= end:
                    raise
                continue
            if found.missing and now < end:  # it may be fresh soon
                continue
            tell(f"measured: {found.dimensions.stature:.2f} m tall")
            return found
