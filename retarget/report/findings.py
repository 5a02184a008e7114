"""What is known of a run, in words: a table of figures with their bounds and sentences, which terminal, page and
`judge` show."""

import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import Any, Generic, TypeVar

import numpy as np

from hardware.errors import counted
from hardware.guard_state import StopCause
from retarget.live.stream_report import LiveReport
from retarget.report.motion_metrics import CONTACT_M, LimitUse, Nearest, PhysicsReport, limit_use
from retarget.report.report import Report
from retarget.report.unfollowed import INSTEAD
from retarget.report.verdict import Verdict, to_follow, verdict_of
from retarget.run.record import Phase
from retarget.run.run_result import RunResult
from retarget.types import MM


@dataclass(frozen=True)
class Finding:
    """What was measured, in words, with units. allowed: the limit, in words, if it needs any; kept: whether it was
    kept, None without a limit."""

    name: str
    measured: str
    allowed: str = ""
    kept: bool | None = None


Seen = TypeVar("Seen")


@dataclass(frozen=True)
class Line(Generic[Seen]):
    """A row of a table of findings. figure: what the sentence is of, one value or a tuple of them; None: not known, so
    there is no line. bound: what is allowed, in words; kept: whether it was, without which there is no bound."""

    name: str
    figure: Callable[[Seen], Any]
    sentence: str = "{}"
    bound: str | Callable[[Seen], str] = ""
    kept: Callable[[Seen], bool | None] | None = None


def found(lines: Iterable[Line[Seen]], seen: Seen) -> tuple[Finding, ...]:
    """The findings of those lines whose figures are known and not empty."""
    findings = []
    for line in lines:
        figure = line.figure(seen)
        if figure is None or figure == "":
            continue
        measured = line.sentence.format(*(figure if isinstance(figure, tuple) else (figure,)))
        allowed = line.bound if isinstance(line.bound, str) else line.bound(seen)
        findings.append(Finding(line.name, measured, allowed, None if line.kept is None else line.kept(seen)))
    return tuple(findings)


TIPS_MM = 0.05
"""Nearer to the edge of the soles than this, a robot begins to tip."""
ROUND_OFF = 1e-4
"""Nearer to its limit than this, rad, a joint is at it."""
MOST = 3
"""Reasons for data that were not used that the line names, those of which there were most; and times of a posture that
was not followed, the first ones."""
FOLLOWING, NOT_FOLLOWED = "following", "not followed"
STAGES = {"page": "from picture to page", "network": "from page to run", "goal": "from run to goals"}
"""Words for the stages of `LiveReport.latency_ms`."""
SIDES = {"l_": "left ", "r_": "right "}


class RunFindings:
    """A run and its report, as the lines need them."""

    def __init__(self, run: RunResult, report: Report) -> None:
        self.run, self.report, self.robot = run, report, run.robot

    @cached_property
    def verdict(self) -> Verdict | None:
        """Whether the robot follows."""
        return verdict_of(self.run, self.report)

    @cached_property
    def use(self) -> LimitUse:
        """The use of joint limits."""
        return limit_use(self.run)

    @property
    def deep(self) -> bool:
        """Whether anything was in anything else."""
        return bool(self.report.penetrating_frames)


def words_of(name: str) -> str:
    """The name of a body part in words."""
    return (SIDES.get(name[:2], "") + name[2:] if name[:2] in SIDES else name).replace("_", " ")


def _times(what: str, seen: RunFindings) -> str:
    """When the performer did what the robot cannot."""
    times = [f"from {one.from_s:.1f} to {one.to_s:.1f} s" for one in seen.report.unfollowed or () if one.what == what]
    more = [counted(len(times) - MOST, "more time")] if len(times) > MOST else []
    return ", ".join([*times[:MOST], *more])


def _likeness(seen: RunFindings) -> str:
    """How far the limbs and the trunk are off."""
    parts, report = [], seen.report
    for angles, words in (
        (dict(report.likeness_deg or {}, trunk_lean=report.trunk_lean_deg), "{} off on average"),
        (report.likeness_recorded_deg or {}, "from the recorded body {}"),
        (report.best_likeness_deg or {}, "its joints allow {}"),
    ):
        known = [f"{name.replace('_', ' ')} {off.mean:.0f}°" for name, off in angles.items() if off is not None]
        parts += [words.format(", ".join(known))] if known else []
    return "; ".join(parts)


def _hands(seen: RunFindings) -> str:
    hands = seen.report.reachable_hands_mm or {}
    return "; ".join(
        f"{words_of(name)} {hands[name]:.1f} mm off where it gets there ({share:.0%} of ticks)"
        if name in hands
        else f"{words_of(name)} never gets there"
        for name, share in (seen.report.reachable_share or {}).items()
        if seen.run.ticks_followed
    )


def latency_line(report: Report) -> str:
    """The path from the performer's hand to the robot's shafts, and the stages that take a millisecond; "" where
    nothing is known."""
    whole, stages = report.hand_to_shaft_ms, report.latency_ms or {}
    taken = ", ".join(f"{stage} {time.p50:.0f}" for stage, time in stages.items() if time.p50 >= 1.0)
    if whole is None:
        return taken and f"{taken} ms; from hand to shaft it is not known"
    return f"{whole.p50:.0f} ms from hand to shaft (p99 {whole.p99:.0f}): {taken}"


def _foot_path(seen: RunFindings) -> str:
    ratio = seen.report.foot_path_ratio
    if ratio is None:
        return ""
    return f"{ratio:.1%} of the performer's" if ratio else "none: the performer's feet move, its own stay planted"


def _travel(seen: RunFindings) -> str:
    """How far performer and robot got and turned."""
    path, turn = seen.report.travelled_m, seen.report.turned_deg
    both = (("performer", path.performer, turn.performer), ("robot", path.robot, turn.robot))
    known = [(whose, far, turned) for whose, far, turned in both if far is not None and turned is not None]
    return "; ".join(f"{whose} {far:.2f} m, turned {turned:.0f}°" for whose, far, turned in known)


def _servos(seen: RunFindings) -> tuple[float, float, str] | None:
    servos = seen.report.servo_error_deg
    if not servos or seen.robot is None:
        return None
    worst = max(servos, key=lambda name: servos[name].max)
    return sum(spread.mean for spread in servos.values()) / len(servos), servos[worst].max, worst


def _room(seen: RunFindings) -> str:
    if seen.use.room is None:
        return "no limit came near"
    joint, room = seen.use.room
    if abs(room) <= ROUND_OFF:
        return f"{joint} reached its limit"
    return f"nearest: {joint}, {abs(np.rad2deg(room)):.2f}° {'from' if room > 0.0 else 'beyond'} its limit"


def _joint_line(name: str, kind: str, figure: Callable[[RunFindings], str], bound: Any) -> Line[RunFindings]:
    """A line of joint limits. kind: of `LimitViolations`."""

    def beyond(seen: RunFindings) -> int:
        return int(getattr(seen.report.limit_violations, kind))

    def measured(seen: RunFindings) -> str:
        words, count = figure(seen), beyond(seen)
        return f"{words}; {counted(count, 'value')} beyond" if words and count else words

    return Line(name, measured, "{}", bound, lambda seen: not beyond(seen))


def _rate_line(name: str, kind: str, unit: str) -> Line[RunFindings]:
    """A line of the joint that used most of a limit of velocity or acceleration."""

    def figure(seen: RunFindings) -> str:
        use: Nearest | None = getattr(seen.use, kind)
        share = "" if use is None else f"{use.value / use.limit:.0%} of its limit"
        return share and f"nearest: {use.joint}, {use.value:.3g} {unit}, {share}"  # type: ignore[union-attr]

    def bound(seen: RunFindings) -> str:
        use: Nearest = getattr(seen.use, kind)
        return f"{use.joint}: {use.limit:.3g} {unit}"

    return _joint_line(name, kind, figure, bound)


def _mass(seen: RunFindings) -> str | None:
    outside, margin = seen.report.com_outside_support_frames, seen.report.com_margin_mm
    if outside:
        by = "" if margin is None or margin > 0 else f", by up to {-margin:.1f} mm"
        return f"outside in {counted(outside, 'tick')}{by}"
    nearest = "nothing touched the ground" if margin is None else f"never nearer to the edge than {margin:.1f} mm"
    return None if outside is None else nearest


def _soles(seen: RunFindings) -> str | None:
    soles, slid = seen.report.soles, seen.report.foot_slide_mm
    if slid is None:
        return None
    if soles is None:
        return f"at most {slid:.2f} mm slid within {MM * CONTACT_M:.0f} mm of the ground"
    raised = f"{soles.height_mm:.2f} mm off the ground, {soles.tilt_deg:.2f} degrees tilted"
    return f"at most {raised}, {slid:.2f} mm slid"


def gap_words(mm: float, pair: tuple[str, str] | None, *, inside: str = "inside each other") -> str:
    """A distance of two things, mm, negative inside, in words."""
    gap = f"never closer than {mm:.1f} mm" if mm >= 0.0 else f"{-mm:.1f} mm {inside}"
    return gap + (f" ({' and '.join(pair)})" if pair else "")


def _gap_line(name: str, kind: str, bound: str, pair: Callable[[Report], Any]) -> Line[RunFindings]:
    """A line of a clearance. kind: of `Clearances`."""

    def distance(seen: RunFindings) -> float | None:
        mm: float | None = getattr(seen.report.min_clearance_mm, kind)
        return mm

    def figure(seen: RunFindings) -> str | None:
        mm = distance(seen)
        return None if mm is None else gap_words(mm, pair(seen.report))

    return Line(name, figure, "{}", bound, lambda seen: not seen.deep or (distance(seen) or 0.0) >= 0.0)


def _observers(seen: RunFindings) -> str | None:
    switches, observers = seen.report.mode_switches_per_s, seen.report.observers
    if switches is None:
        return None
    worst = f", {switches.worst:.1f} of {switches.name}" if switches.name else ""
    share = observers.reactive_share if observers else 0.0
    contact = f"; in contact in {share:.1%} of ticks" if share else ""
    return f"switched on or off {switches.mean:.1f} times a second on average{worst}{contact}"


def _gate(seen: RunFindings) -> str | None:
    """How often the gate refused a goal, and what to do about the pair for which it did so most often."""
    report = seen.report
    if report.gated_frames is None:
        return None
    parts = [f"changed {report.gated_frames} of {report.ticks} goals"]
    if report.no_command_frames:
        parts.append(f"no goal in {counted(report.no_command_frames, 'tick')}: joints braked")
    if report.gated_frames and report.refused_pair is not None:
        parts.append(refused_words(report))
    return "; ".join(parts)


def refused_words(report: Report) -> str:
    """The pair for which the gate refused most goals, and what to do; "" without one."""
    pair = report.refused_pair
    if pair is None:
        return ""
    words = f"refused for {pair.first} - {pair.second} in {counted(pair.ticks, 'tick')}"
    if pair.obstacle:
        return words
    step = "fit their observers closer (retarget fit-observers), or if they cannot meet put them into ignore_pairs"
    return f"{words}: {step}"


def _stream(seen: RunFindings) -> str:
    return stream_line(seen.report.live)


def stream_line(live: LiveReport | None) -> str:
    """The stream of a live run; "" for a file."""
    if live is None:
        return ""
    came = f"{counted(live.frames, 'frame')} in {counted(live.datagrams, 'datagram')}"
    parts = [f"{came}, played {live.playout_delay_ms:.0f} ms late"]
    parts += [f"{STAGES[stage]} {taken.p50:.0f} ms (p99 {taken.p99:.0f})" for stage, taken in live.latency_ms.items()]
    if live.dropped:
        reasons = [*live.dropped.items()][:MOST]
        parts.append("not used: " + ", ".join(f"{reason} ({count})" for reason, count in reasons))
    if live.lost_s:
        longest = sorted(live.lost_s.items(), key=lambda item: -item[1])[:MOST]
        parts.append("lost: " + ", ".join(f"{name} {seconds:.1f} s" for name, seconds in longest))
    if live.holds.count:
        parts.append(f"held {counted(live.holds.count, 'time')}, {live.holds.s:.1f} s")
    if live.refused:
        parts.append(f"refused senders: {', '.join(live.refused[:MOST])}")
    return "; ".join(parts)


# The simulated mechanics of a run.


def _stands(seen: PhysicsReport) -> str:
    how = {"floor": "did not fall", "stand": "on a stand", "gantry": "hangs on a gantry"}[seen.mount]
    if seen.fallen:
        how = f"fallen at {seen.fallen_at_s or 0.0:.2f} s: {seen.how}"
    if seen.perturbations:
        how += f" (perturbations: {', '.join(seen.perturbations)}; seed {seen.seed})"
    return how


def _pressure(seen: PhysicsReport) -> tuple[float, float, float] | None:
    margin = seen.min_zmp_margin_mm
    return None if margin is None else (margin, seen.foot_slip_mm["total"], seen.sole_tilt_max_deg)


def _most(values: Mapping[str, Any], size: Callable[[Any], float]) -> str | None:
    """The joint with the largest of some values, of those that are known; None where there is none."""
    known = {joint: size(value) for joint, value in values.items() if not math.isnan(size(value))}
    return max(known, key=known.__getitem__) if known else None


def _torque(seen: PhysicsReport) -> tuple[float, float, str] | None:
    most = _most(seen.torque_nm, lambda torque: torque.max)
    return None if most is None else (seen.torque_nm[most].max, seen.torque_nm[most].p95, most)


def _heat(seen: PhysicsReport) -> tuple[float, str, str] | None:
    most = _most(seen.temperature_c, float)
    return None if most is None else (seen.temperature_c[most], most, seen.heat_model)


def _contacts(seen: PhysicsReport) -> str:
    counts = {"itself": seen.self_contacts, "fixtures or the floor": seen.fixture_contacts}
    touches = [f"touches {what} in {counted(ticks, 'tick')}" for what, ticks in counts.items() if ticks]
    return ", ".join(touches) or "none"


PHYSICS: tuple[Line[PhysicsReport], ...] = (
    Line("physics", _stands, "{}", "it does not fall", lambda seen: not seen.fallen),
    Line("at rest", lambda seen: seen.toppled, "it did not stay: {}", "it stays without torque", lambda seen: False),
    Line(
        "pressure",
        _pressure,
        "never nearer to the edge of the soles than {:z.2f} mm; {:.1f} mm slipped, tipped by {:.1f} degrees",
        f"more than {TIPS_MM:g} mm inside the soles",
        lambda seen: (seen.min_zmp_margin_mm or 0.0) > TIPS_MM,
    ),
    Line("torque", _torque, "{:.2f} N m at most, 95 % below {:.2f} ({})"),
    Line("heat", _heat, "{:.1f} degrees Celsius at most ({}), by a model {}"),
    Line("contacts", _contacts, "{}", "none but the soles", lambda seen: not seen.self_contacts + seen.fixture_contacts),
    Line("simulation", lambda seen: seen.realtime_factor, "{:.1f} times as fast as real time"),
)


# Bus, cost and end.


def _missed(seen: RunFindings) -> str | None:
    bus = seen.report.bus
    if bus is None or bus.missed_ticks is None or not seen.run.setup.real_time:
        return None
    missed = f"{bus.missed_ticks} of {seen.report.ticks + bus.missed_ticks}" if bus.missed_ticks else "none"
    longest = "" if bus.longest_period_ms is None else f"; the longest took {bus.longest_period_ms:.1f} ms"
    return missed + longest + (", see retarget doctor" if bus.missed_ticks else "")


def _of_bus(key: str) -> Callable[[RunFindings], Any]:
    """A value of the bus and its joint; None where it is not known."""

    def figure(seen: RunFindings) -> tuple[float, str] | None:
        found = None if seen.report.bus is None else getattr(seen.report.bus, key)
        return None if found is None or seen.robot is None else (found.value, found.joint)

    return figure


def _safety(seen: RunFindings) -> Any:
    assert seen.robot is not None, "a bus is a robot's"
    return seen.robot.profile.safety


def _faults(seen: RunFindings) -> str | None:
    bus = seen.report.bus
    return None if bus is None or seen.robot is None else counted(bus.faults, "fault") if bus.faults else "none"


def _voltage_kept(seen: RunFindings) -> bool:
    (low, high), (lowest, _) = _safety(seen).voltage, _of_bus("lowest_voltage")(seen)
    return bool(low <= lowest <= high)


def _cool(seen: RunFindings) -> bool:
    hottest, _ = _of_bus("hottest")(seen)
    return bool(hottest < _safety(seen).temperature_c)


def _cost(seen: RunFindings) -> str:
    report = seen.report
    costs = {"human": report.reconstruct_us, "robot": report.retarget_us}
    ran = {stage: cost for stage, cost in costs.items() if cost and math.isfinite(cost.p50)}
    known = [f"{stage} {cost.p50:.0f} us (p99 {cost.p99:.0f})" for stage, cost in ran.items()]
    return f"{', '.join(known)}; {counted(round(report.frames_per_s), 'frame')}/s" if known else ""


def _end(seen: RunFindings) -> str:
    stop = seen.report.stop
    return "to its end" if stop.reason is None else ": ".join(part for part in (stop.state, stop.reason) if part)


FOLLOWED: tuple[Line[RunFindings], ...] = (
    Line(
        FOLLOWING,
        lambda seen: seen.verdict and seen.verdict.sentence,
        "{}",
        lambda seen: to_follow(seen.report),
        lambda seen: seen.verdict and seen.verdict.kept,
    ),
    *(
        Line(NOT_FOLLOWED, partial(_times, what), f"the performer {what} {{}}: the robot {instead} instead")
        for what, instead in INSTEAD.items()
    ),
    Line("likeness", _likeness),
    Line("hands within reach", _hands),
    Line(
        "lag",
        lambda seen: None if seen.robot is None or seen.report.lag_s is None else 1e3 * seen.report.lag_s,
        "{:.1f} ms from what is asked to what is sent",
    ),
    Line("latency", lambda seen: latency_line(seen.report) if seen.robot is not None else None),
    Line("hand path", lambda seen: seen.report.hand_path_ratio, "{:.1%} of what was asked"),
    Line(
        "pelvis height",
        lambda seen: (height := seen.report.pelvis_height_mm) and (height.mean, height.p95, height.max),
        "{:.0f} mm off, {:.0f} at p95, {:.0f} at most",
    ),
    Line("foot path", _foot_path),
    Line("over the ground", _travel),
)
"""How the performer was followed."""
KEPT: tuple[Line[RunFindings], ...] = (
    Line(
        "joints without sensor",
        lambda seen: (seen.report.unsensed_mm or {}).get("mean"),
        "{:.1f} mm from the recorded ones on average",
    ),
    Line("highest priority", lambda seen: seen.report.priority_violation_max, "off by {:.3f} mm or mrad at most"),
    Line(
        "servos",
        _servos,
        "{:.1f} degrees behind what was sent on average, {:.1f} at most ({})",
        lambda seen: f"{np.rad2deg(_safety(seen).following_error):.3g}° from the trajectory to its goal",
        lambda seen: seen.run.stop is None or seen.run.stop.cause is not StopCause.FOLLOWING_ERROR,
    ),
    _joint_line("joint positions", "position", _room, "within their limits"),
    _rate_line("joint speeds", "velocity", "rad/s"),
    _rate_line("joint accelerations", "acceleration", "rad/s²"),
)
"""The human, servos and joints."""
PLANNED: tuple[Line[RunFindings], ...] = (
    Line(
        "centre of mass",
        _mass,
        "{}",
        "over the support polygon",
        lambda seen: not seen.report.com_outside_support_frames,
    ),
    Line("soles", _soles),
    _gap_line("its own links", "self", "do not meet", lambda report: report.closest_links),
    _gap_line("obstacles", "scene", "are not touched", lambda report: report.deep.obstacle),
    _gap_line("the floor", "ground", "is touched by soles alone", lambda report: report.deep.ground),
    Line(
        "penetration",
        lambda seen: (counted(seen.report.penetrating_frames or 0, "tick"), seen.report.deep.frames)
        if seen.deep
        else None,
        "in {}, by more than 1 mm in {}",
    ),
)
"""The body in the postures that were sent. A simulated robot may move otherwise: there they are the plan."""
CONTROL: tuple[Line[RunFindings], ...] = (
    Line("observers", _observers),
    Line("gate", _gate),
    Line(
        "steps",
        lambda seen: (steps := seen.report.steps) and (steps.made, steps.asked, steps.declined),
        "{} made of {} asked; {} declined, for it could not be in time",
    ),
    Line("stream", _stream),
)
"""What stood between the performer and the goals."""
MACHINE: tuple[Line[RunFindings], ...] = (
    Line(
        "faults",
        _faults,
        "{}",
        "all servos answer, none is alarmed",
        lambda seen: not (seen.report.bus and seen.report.bus.faults),
    ),
    Line(
        "ticks missed",
        _missed,
        "{}",
        lambda seen: f"none, {1e3 * seen.run.clip.dt:.3g} ms each",
        lambda seen: not (seen.report.bus and seen.report.bus.missed_ticks),
    ),
    Line(
        "temperature",
        _of_bus("hottest"),
        "{:.0f} °C ({})",
        lambda seen: f"below {_safety(seen).temperature_c:g} °C",
        _cool,
    ),
    Line(
        "voltage",
        _of_bus("lowest_voltage"),
        "lowest {:.1f} V ({})",
        lambda seen: "{:g} to {:g} V".format(*_safety(seen).voltage),
        _voltage_kept,
    ),
    Line("cost per tick", _cost),
    Line("end", _end, "{}", "", lambda seen: seen.report.stop.reason is None),
)
"""The bus, the computer, and the end."""


def findings(run: RunResult, report: Report) -> tuple[Finding, ...]:
    """Everything that is known of a run; what it has not (no feet, no scene, no bus) is left out."""
    seen, physics = RunFindings(run, report), report.physics
    planned = found(PLANNED, seen)
    if physics is not None:
        planned = tuple(replace(finding, name=f"{finding.name}, as planned") for finding in planned)
    simulated = () if physics is None else found(PHYSICS, physics)
    return (*found(FOLLOWED, seen), *found(KEPT, seen), *planned, *found(CONTROL, seen), *simulated, *found(MACHINE, seen))


# The moments at which a run went wrong, on the time of the run: what stopped it, and a fall.


@dataclass(frozen=True)
class Moment:
    """what: "Stopped" or "Fell". time: s on the run's time. text: why, in words. more: what else there is to say."""

    what: str
    time: float
    text: str
    more: tuple[str, ...] = ()


def moments(run: RunResult) -> tuple[Moment, ...]:
    """In the order of their time; none of a run that went on to its end.

    A stop is at the first tick that braked, or at the last that was sent.
    """
    found = []
    if run.reason is not None and len(run.record):
        braking = np.flatnonzero(run.record.phase == Phase.BRAKE)
        row = int(braking[0]) if braking.size else len(run.record) - 1
        said, stop = [], run.stop
        if stop is not None:
            said.append(f"Cause, as the guard latched it: {stop.cause.value}.")
            said += [f"The braking was ended by: {stop.then.value}."] if stop.then else []
            said += ["Not every servo confirmed that its torque is off."] if stop.powered else []
        found.append(Moment("Stopped", float(run.record.time[row]), run.reason, tuple(said)))
    fall = None if run.physics is None else run.physics.fall
    if fall is not None:
        found.append(Moment("Fell", fall.time, fall.how))
    return tuple(sorted(found, key=lambda moment: moment.time))
