"""Every limit of a run, in words: what was allowed, what was measured, and whether it was kept; and what went wrong."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from hardware.guard_state import StopCause
from retarget.report.motion_metrics import moved_joints
from retarget.report.report import Report
from retarget.run.record import Phase
from retarget.run.run_result import RunResult
from retarget.types import FloatArray

# How much of each kind of joint limit a run used: the joint that came nearest to its own.


@dataclass(frozen=True)
class Nearest:
    """The joint that used most of its limit. value: what it did; limit: what it may do; rad, s (or m)."""

    joint: str
    value: float
    limit: float


@dataclass(frozen=True)
class LimitUse:
    """None where no joint has such a limit, or where too few ticks were sent. room: rad (or m) between a joint
    and the limit of its position that it came nearest to, and its joint; negative: beyond."""

    room: tuple[str, float] | None
    velocity: Nearest | None
    acceleration: Nearest | None


def limit_use(run: RunResult) -> LimitUse:
    """The use of limits by the postures that were sent (of a human: reconstructed), by finite differences."""
    moved, sent = moved_joints(run), run.record.robot
    names, limits, dt = moved.names, moved.limits, moved.dt
    positions = moved.positions if sent is None else np.vstack([sent.start, moved.positions])
    if len(positions) < 3 or not names:
        return LimitUse(None, None, None)
    step = np.diff(positions, axis=0)
    change = np.diff(step, axis=0)
    room = np.minimum(positions - limits.lower, limits.upper - positions).min(axis=0)
    near = int(np.argmin(room))
    return LimitUse(
        room=(names[near], float(room[near])) if np.isfinite(room[near]) else None,
        velocity=_nearest(names, np.abs(step).max(axis=0) / dt, limits.max_velocity),
        acceleration=_nearest(names, np.abs(change).max(axis=0) / dt**2, limits.max_acceleration),
    )


def _nearest(names: tuple[str, ...], values: FloatArray, limits: FloatArray) -> Nearest | None:
    share = values / np.where(limits > 0.0, limits, np.inf)
    joint = int(np.argmax(share))
    return Nearest(names[joint], float(values[joint]), float(limits[joint])) if np.isfinite(limits[joint]) else None


TIPS_MM = 0.05
"""Nearer to the edge of the soles than this, a robot begins to tip."""
ROUND_OFF = 1e-4
"""Nearer to its limit than this, rad, a joint is at it."""


@dataclass(frozen=True)
class Verdict:
    """One limit, and whether it was kept. allowed, measured: in words, with units."""

    limit: str
    allowed: str
    measured: str
    kept: bool


def verdicts(run: RunResult, report: Report) -> tuple[Verdict, ...]:
    """The verdicts on everything that this run could break; the others (no feet, no scene, no bus) are left out."""
    use = limit_use(run)
    found = [*_joints(report, use), *_body(report), *_servos(run, report), *_physics(report)]
    reason = report.stop.reason
    ended = "to its end" if reason is None else f"stopped: {reason}"
    return (*found, Verdict("The run", "to its end", ended, reason is None))


def _joints(report: Report, use: LimitUse) -> Iterator[Verdict]:
    broken = report.limit_violations
    measured = "no limit came near"
    if use.room is not None:
        joint, room = use.room
        measured = f"{joint} reached its limit"
        if abs(room) > ROUND_OFF:
            measured = f"nearest: {joint}, {abs(np.rad2deg(room)):.2f}° {'from' if room > 0.0 else 'beyond'} its limit"
    yield Verdict("Joint positions", "within their limits", _count(measured, broken.position), not broken.position)
    if use.velocity is not None:
        yield _of_joint("Joint speeds", use.velocity, "rad/s", broken.velocity)
    if use.acceleration is not None:
        yield _of_joint("Joint accelerations", use.acceleration, "rad/s²", broken.acceleration)


def _of_joint(limit: str, nearest: Nearest, unit: str, broken: int) -> Verdict:
    allowed = f"{nearest.joint}: {nearest.limit:.3g} {unit}"
    share = nearest.value / nearest.limit
    measured = f"{nearest.value:.3g} {unit}, {share:.0%} of it; no other joint came nearer"
    return Verdict(limit, allowed, _count(measured, broken), not broken)


def _count(text: str, broken: int) -> str:
    counted = f"{broken} values beyond" if broken else ""
    return "; ".join(part for part in (text, counted) if part) or "nothing beyond"


def _body(report: Report) -> Iterator[Verdict]:
    outside, margin = report.com_outside_support_frames, report.com_margin_mm
    if outside is not None:
        measured = "nothing touched the ground" if margin is None else f"never nearer to its edge than {margin:.1f} mm"
        if outside:
            measured = f"outside in {outside} ticks" + (
                "" if margin is None or margin > 0 else f", by up to {-margin:.1f} mm"
            )
        yield Verdict("Centre of mass", "over the support polygon", measured, outside == 0)
    deep = (report.penetrating_frames or 0) > 0
    clearance = report.min_clearance_mm
    for limit, allowed, mm, pair in (
        ("Its own links", "do not meet", clearance.self, report.closest_links),
        ("Obstacles", "are not touched", clearance.scene, report.deep.obstacle),
        ("The floor", "is touched by soles alone", clearance.ground, report.deep.ground),
    ):
        if mm is not None:
            named = f" ({' and '.join(pair)})" if pair else ""
            yield Verdict(limit, allowed, f"{_gap(mm)}{named}", not deep or mm >= 0.0)


def _gap(mm: float) -> str:
    return f"never closer than {mm:.1f} mm" if mm >= 0.0 else f"{-mm:.1f} mm inside each other"


def _servos(run: RunResult, report: Report) -> Iterator[Verdict]:
    bus = report.bus
    if bus is None or run.robot is None:
        return
    safety = run.robot.profile.safety
    yield Verdict(
        "Servos", "all answer, none is alarmed", _counted(bus.faults, "fault", "none failed"), bus.faults == 0
    )
    if bus.missed_ticks is not None:
        allowed = f"{1e3 * run.clip.dt:.3g} ms each, none missed"
        longest = "" if bus.longest_period_ms is None else f"; the longest took {bus.longest_period_ms:.1f} ms"
        measured = _counted(bus.missed_ticks, "tick missed", "none missed") + longest
        yield Verdict("Ticks", allowed, measured, bus.missed_ticks == 0)
    errors = report.servo_error_deg or {}
    if errors:
        worst = max(errors, key=lambda name: errors[name].max)
        allowed = f"{np.rad2deg(safety.following_error):.3g}° from the trajectory to its goal"
        measured = f"{errors[worst].max:.1f}° at most from its goal ({worst})"
        stopped = run.stop is not None and run.stop.cause is StopCause.FOLLOWING_ERROR
        yield Verdict("Servo against goal", allowed, measured, not stopped)
    if bus.hottest is not None:
        measured = f"{bus.hottest.value:.0f} °C ({bus.hottest.joint})"
        yield Verdict(
            "Temperature",
            f"below {safety.temperature_c:g} °C",
            measured,
            bus.hottest.value < safety.temperature_c,
        )
    if bus.lowest_voltage is not None:
        low, high = safety.voltage
        measured = f"lowest {bus.lowest_voltage.value:.1f} V ({bus.lowest_voltage.joint})"
        yield Verdict("Voltage", f"{low:g} to {high:g} V", measured, low <= bus.lowest_voltage.value <= high)


def _counted(count: int, what: str, none: str) -> str:
    return f"{count} {what}{'s' if count > 1 and what == 'fault' else ''}" if count else none


def _physics(report: Report) -> Iterator[Verdict]:
    seen = report.physics
    if seen is None:
        return
    at = "" if seen.fallen_at_s is None else f" at {seen.fallen_at_s:.2f} s"
    yield Verdict(
        "Balance", "it does not fall", f"fell{at}: {seen.how}" if seen.fallen else "it stood", not seen.fallen
    )
    if seen.min_zmp_margin_mm is not None:
        margin = seen.min_zmp_margin_mm
        measured = f"never nearer to their edge than {margin:.1f} mm" if margin > TIPS_MM else "reached their edge"
        yield Verdict("Centre of pressure", "within the soles", measured, margin > TIPS_MM)
    contacts = seen.self_contacts + seen.fixture_contacts
    measured = (
        f"{seen.self_contacts} ticks with itself, {seen.fixture_contacts} with fixtures or the floor"
        if contacts
        else "none"
    )
    yield Verdict("Contacts", "none but the soles", measured, contacts == 0)


# The moments at which a run went wrong, on the time of the run: what stopped it, and a fall.


@dataclass(frozen=True)
class Moment:
    """what: "Stopped" or "Fell". time: s on the run's time. text: why, in words. more: what else there is to say."""

    what: str
    time: float
    text: str
    more: tuple[str, ...] = ()


def moments(run: RunResult) -> tuple[Moment, ...]:
    """The moments of a run that are shown, in the order of their time; none of a run that went on to its end.

    A stop is at the first tick that braked, or at the last that was sent.
    """
    found = []
    if run.reason is not None and len(run.record):
        braking = np.flatnonzero(run.record.phase == Phase.BRAKE)
        row = int(braking[0]) if braking.size else len(run.record) - 1
        found.append(Moment("Stopped", float(run.record.time[row]), run.reason, _more(run)))
    fall = None if run.physics is None else run.physics.fall
    if fall is not None:
        found.append(Moment("Fell", fall.time, fall.how))
    return tuple(sorted(found, key=lambda moment: moment.time))


def _more(run: RunResult) -> tuple[str, ...]:
    stop = run.stop
    if stop is None:
        return ()
    said = [f"Cause, as the guard latched it: {stop.cause.value}."]
    if stop.then is not None:
        said.append(f"The braking was ended by: {stop.then.value}.")
    if stop.powered:
        said.append("Not every servo confirmed that its torque is off.")
    return tuple(said)
