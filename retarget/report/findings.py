"""What a person reads of a run, on the terminal and on its page: what was measured, what was allowed, whether it was
kept, and what went wrong."""

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from rich.console import Console
from rich.table import Table
from rich.text import Text

from hardware.errors import counted
from hardware.guard_state import StopCause
from retarget.live.stream_report import LiveReport
from retarget.report.likeness import ARMS, LEAN, LEG_AWAY_DEG, LIMBS
from retarget.report.motion_metrics import CONTACT_M, PhysicsReport, moved_joints
from retarget.report.report import BusReport, Report, Spread
from retarget.report.tracking import AWAY_M
from retarget.report.unfollowed import INSTEAD
from retarget.run.record import Phase
from retarget.run.run_result import RunResult
from retarget.schema.priorities import LimbTask
from retarget.types import MM, FloatArray

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
    """The use of limits by the goals that were sent (of a human: by its postures), by finite differences."""
    moved, sent = moved_joints(run), run.record.robot
    names, limits, dt = moved.names, moved.limits, moved.dt
    positions = moved.positions if sent is None else np.vstack([sent.start, sent.goals])
    if len(positions) < 3 or not names:
        return LimitUse(None, None, None)
    room, fastest, hardest = np.zeros((3, len(names)))
    for joint, track in enumerate(positions.T):  # one by one: of a long run each step of this is as large as it
        step = np.diff(track)
        room[joint] = np.minimum(track - limits.lower[joint], limits.upper[joint] - track).min()
        fastest[joint], hardest[joint] = np.abs(step).max() / dt, np.abs(np.diff(step)).max() / dt**2
    near = int(np.argmin(room))
    return LimitUse(
        room=(names[near], float(room[near])) if np.isfinite(room[near]) else None,
        velocity=_nearest(names, fastest, limits.max_velocity),
        acceleration=_nearest(names, hardest, limits.max_acceleration),
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
class Finding:
    """What was measured, in words, with units. allowed: the limit, in words, if it needs any; kept: whether it was
    kept, None without a limit."""

    name: str
    measured: str
    allowed: str = ""
    kept: bool | None = None


def findings(run: RunResult, report: Report) -> tuple[Finding, ...]:
    """Everything that is known of a run; what it has not (no feet, no scene, no bus) is left out."""
    found = (*_following(run, report), *_joints(report, limit_use(run)), *_body(report), *_observers(report))
    found = (*found, Finding("stream", stream_line(report.live)), *physics_findings(report.physics))
    found = (*found, *_machine(run, report))
    return tuple(finding for finding in found if finding.measured)


NOT_FOLLOWED = "not followed"

# Whether the robot follows, in one sentence: by what a person sees who looks from the performer to the robot.


@dataclass(frozen=True)
class DifferenceLimits:
    """From where on a person sees it that robot and performer differ, and from where on it is another motion."""

    difference: float
    lost: float = math.inf


LIMB_DEG = DifferenceLimits(20.0, LEG_AWAY_DEG)
"""Degrees, on average. The hands of a clock are 30 apart from hour to hour, so 20 are seen at a glance; limbs that have
nothing to do with each other are 90 apart, and 45 is half of that."""
LEG_AWAY_S = DifferenceLimits(0.3)
"""Longest time, s, that a thigh or shank is more than `LEG_AWAY_DEG` off: as for a hand. A robot that bears itself on
both feet is not another motion because the performer lifts one."""
LEAN_DEG = DifferenceLimits(15.0, 45.0)
"""Degrees, in all but a twentieth of the time. A trunk 15 off looks tired, one that is 45 off is folded over."""
HAND_SHARE = DifferenceLimits(0.2, 0.5)
"""Of the length of the arm, on average, within reach: 0.2 is a hand's length, 0.5 is from the chin to the belt."""
HAND_AWAY_S = DifferenceLimits(0.3, 2.0)
"""Longest time, s, that a hand is more than `AWAY_M` off, within reach: a gesture takes two seconds."""
SQUAT_SHARE = DifferenceLimits(0.15, 0.4)
"""Of the length of the leg, in all but a twentieth of the time: a squat with level thighs goes down by a half. 0.15 off
is seen beside the performer; with 0.4 off it is missed."""
RATIO = DifferenceLimits(0.3, 0.75)
"""Of what was asked is missing, or of what was done too much: a third is seen, a quarter of a motion is another one."""
TRAVEL_M, TURN_DEG = DifferenceLimits(0.5), DifferenceLimits(60.0)
"""A performer's step, and more than a planted robot turns: by so much performers go away who seemed to be followed."""


def _verdict(run: RunResult, report: Report) -> Iterator[Finding]:
    """Whether the robot followed, and what differs."""
    if run.robot is None or not run.ticks_followed:
        return
    differs = [(words, value, seen) for words, value, seen in _differences(run, report) if value >= seen.difference]
    lost = [words for words, value, seen in differs if value >= seen.lost]
    verdict, kept = "follows", False if lost else None if differs else True
    if differs:
        shown = lost or [words for words, _, _ in differs]
        verdict = f"{'does not follow' if lost else 'follows in part'}: {', '.join(shown)}"
    whose = "reconstructed" if report.likeness_recorded_deg is None else "recorded"
    allowed = (
        f"limbs within {LIMB_DEG.difference:g}° of the {whose} performer's (in part: {LIMB_DEG.lost:g}°), "
        + f"no leg more than {LEG_AWAY_DEG:g}° off for {LEG_AWAY_S.difference:g} s, "
        + f"trunk within {LEAN_DEG.difference:g}° (in part: {LEAN_DEG.lost:g}°), "
        + f"pelvis within {SQUAT_SHARE.difference:.0%} of the leg (in part: {SQUAT_SHARE.lost:.0%}), "
        + f"hands on their way, none more than {MM * AWAY_M:.0f} mm off for {HAND_AWAY_S.difference:g} s "
        + f"(in part: {HAND_AWAY_S.lost:g} s)"
    )
    yield Finding("following", verdict, allowed, kept)


def _differences(run: RunResult, report: Report) -> Iterator[tuple[str, float, DifferenceLimits]]:
    """What may differ between robot and performer, in words; by how much; and what is seen of that."""
    assert run.robot is not None, "a robot follows"
    if report.fallen:
        yield "it fell", math.inf, DifferenceLimits(0.0, 0.0)
    limbs, best = report.likeness_recorded_deg, dict[str, Spread]()
    if limbs is None:  # the best is known of the reconstructed body alone
        lean = {} if report.trunk_lean_deg is None else {LEAN: report.trunk_lean_deg}
        limbs, best = (report.likeness_deg or {}) | lean, report.best_likeness_deg or {}
    # Where a level asks for hands and not for forearms, these are as like as the hands leave them.
    levels = run.setup.priorities[-1].levels if run.setup.priorities else ()
    asked = [{name for task in level.tasks if isinstance(task, LimbTask) for name in task.of} for level in levels]
    hands_first = any("l_hand" in names and "l_forearm" not in names for names in asked)
    arms = DifferenceLimits(LIMB_DEG.difference) if hands_first else LIMB_DEG
    for limb in (limb for limb in LIMBS if limb in limbs):
        at_best = f" ({best[limb].mean:.0f}° at best)" if limb in best else ""
        words = f"{limb.replace('_', ' ')} {limbs[limb].mean:.0f}° off on average{at_best}"
        yield words, limbs[limb].mean, arms if limb in ARMS else LIMB_DEG
    for part, seconds in _longest(report.legs_away_s):
        yield f"{part} more than {LEG_AWAY_DEG:g}° off for {seconds:.1f} s", seconds, LEG_AWAY_S
    if LEAN in limbs:
        yield f"its trunk {limbs[LEAN].p95:.0f}° off (p95)", limbs[LEAN].p95, LEAN_DEG
    if report.reachable_hands_mm:
        off, arm = report.reachable_hands_mm["worse"], MM * run.robot.profile.landmarks["l_hand"].robot_length
        yield f"a hand {off:.0f} mm off on average", off / arm, HAND_SHARE
    away = max((report.hands_away_s or {}).values(), default=0.0)
    yield f"a hand more than {MM * AWAY_M:.0f} mm off for {away:.1f} s", away, HAND_AWAY_S
    if report.pelvis_height_mm is not None:
        off, leg = report.pelvis_height_mm.p95, MM * run.robot.profile.landmarks["pelvis"].robot_length
        yield f"its pelvis {off:.0f} mm too high or low (p95)", off / leg, SQUAT_SHARE
    ratio = report.hand_path_ratio
    if ratio is not None:
        yield f"hands on {ratio:.0%} of their way", 1.0 - min(ratio, 1.0 / max(ratio, 1e-9)), RATIO
    travel, turn = report.travelled_m, report.turned_deg
    if travel.performer is not None and (report.foot_path_ratio or 0.0) < 1.0 - RATIO.difference:
        yield f"feet that stay (the performer travels {travel.performer:.1f} m)", travel.performer, TRAVEL_M
    if turn.performer is not None and turn.robot is not None:
        words = f"{turn.robot:.0f}° turned of the performer's {turn.performer:.0f}°"
        yield words, turn.performer - turn.robot, TURN_DEG


def _longest(away: dict[str, float] | None) -> Iterator[tuple[str, float]]:
    """The part, in words, that was away for the longest time, s; nothing where none is known."""
    if away:
        name = max(away, key=lambda name: away[name])
        side, part = name.split("_")
        yield f"its {'left' if side == 'l' else 'right'} {part}", away[name]


def _like(report: Report) -> str:
    """How far the limbs and the trunk are off, in words."""
    parts = []
    for angles, words in (
        (dict(report.likeness_deg or {}, trunk_lean=report.trunk_lean_deg), "{} off on average"),
        (report.likeness_recorded_deg or {}, "from the recorded body {}"),
        (report.best_likeness_deg or {}, "its joints allow {}"),
    ):
        known = [f"{name.replace('_', ' ')} {off.mean:.0f}°" for name, off in angles.items() if off is not None]
        parts += [words.format(", ".join(known))] if known else []
    return "; ".join(parts)


def _travel(report: Report) -> str:
    """How far performer and robot got and turned, in words."""
    way, turn = report.travelled_m, report.turned_deg
    both = (("performer", way.performer, turn.performer), ("robot", way.robot, turn.robot))
    known = [(who, far, turned) for who, far, turned in both if far is not None and turned is not None]
    return "; ".join(f"{who} {far:.2f} m, turned {turned:.0f}°" for who, far, turned in known)


def _following(run: RunResult, report: Report) -> Iterator[Finding]:
    yield from _verdict(run, report)
    for what, instead in INSTEAD.items():
        times = [f"from {one.from_s:.1f} to {one.to_s:.1f} s" for one in report.unfollowed or () if one.what == what]
        if times:
            shown = [*times[:MOST], *([counted(len(times) - MOST, "more time")] if len(times) > MOST else [])]
            yield Finding(NOT_FOLLOWED, f"the performer {what} {', '.join(shown)}: the robot {instead} instead")
    yield Finding("likeness", _like(report))
    hands = report.reachable_hands_mm or {}
    within = [
        f"{name} in {share:.0%} of ticks, then {hands[name]:.1f} mm off" if name in hands else f"{name} never"
        for name, share in (report.reachable_share or {}).items()
    ]
    if run.ticks_followed:
        yield Finding("hands within reach", "; ".join(within))
    if run.robot is not None:
        yield Finding("lag", _number(report.lag_s, "ms from what is asked to what is sent", scale=1e3))
        yield Finding("latency", latency_line(report))
    yield Finding("hand path", _number(report.hand_path_ratio, "% of what was asked", scale=100.0))
    height = report.pelvis_height_mm
    if height is not None:
        yield Finding("pelvis height", f"{height.mean:.0f} mm off, {height.p95:.0f} at p95, {height.max:.0f} at most")
    if report.foot_path_ratio == 0.0:
        yield Finding("foot path", "none: the performer's feet move, its own stay planted")
    else:
        yield Finding("foot path", _number(report.foot_path_ratio, "% of the performer's", scale=100.0))
    yield Finding("over the ground", _travel(report))
    yield Finding("joints without sensor", _number((report.unsensed_mm or {}).get("mean"), "mm off on average"))
    missed = _number(report.priority_violation_max, "mm, or mrad of a turn, at most", digits=3)
    yield Finding("highest priority", f"missed by {missed}" if missed else "")
    servos = report.servo_error_deg
    if servos and run.robot is not None:
        worst = max(servos, key=lambda name: servos[name].max)
        mean = sum(spread.mean for spread in servos.values()) / len(servos)
        measured = f"{mean:.1f} degrees behind what was sent on average, {servos[worst].max:.1f} at most ({worst})"
        allowed = f"{np.rad2deg(run.robot.profile.safety.following_error):.3g}° from the trajectory to its goal"
        stopped = run.stop is not None and run.stop.cause is StopCause.FOLLOWING_ERROR
        yield Finding("servos", measured, allowed, not stopped)


def _number(value: float | None, unit: str, *, scale: float = 1.0, digits: int = 1) -> str:
    return "" if value is None else f"{scale * value:.{digits}f} {unit}"


def _joints(report: Report, use: LimitUse) -> Iterator[Finding]:
    broken = report.limit_violations
    measured = "no limit came near"
    if use.room is not None:
        joint, room = use.room
        measured = f"{joint} reached its limit"
        if abs(room) > ROUND_OFF:
            measured = f"nearest: {joint}, {abs(np.rad2deg(room)):.2f}° {'from' if room > 0.0 else 'beyond'} its limit"
    yield _limited("joint positions", measured, "within their limits", broken.position)
    for name, nearest, unit, count in (
        ("joint speeds", use.velocity, "rad/s", broken.velocity),
        ("joint accelerations", use.acceleration, "rad/s²", broken.acceleration),
    ):
        if nearest is not None:
            share = nearest.value / nearest.limit
            measured = f"nearest: {nearest.joint}, {nearest.value:.3g} {unit}, {share:.0%} of its limit"
            yield _limited(name, measured, f"{nearest.joint}: {nearest.limit:.3g} {unit}", count)


def _limited(name: str, measured: str, allowed: str, broken: int) -> Finding:
    return Finding(name, f"{measured}; {counted(broken, 'value')} beyond" if broken else measured, allowed, not broken)


def _body(report: Report) -> Iterator[Finding]:
    """The body in the postures that were sent: of a simulated robot, which may move otherwise, they are the plan."""
    planned = "" if report.physics is None else ", as planned"
    outside, margin = report.com_outside_support_frames, report.com_margin_mm
    if outside is not None:
        measured = "nothing touched the ground" if margin is None else f"never nearer to the edge than {margin:.1f} mm"
        if outside:
            by = "" if margin is None or margin > 0 else f", by up to {-margin:.1f} mm"
            measured = f"outside in {counted(outside, 'tick')}{by}"
        yield Finding("centre of mass" + planned, measured, "over the support polygon", outside == 0)
    if report.foot_slide_mm is not None:
        slid = f"{report.foot_slide_mm:.2f} mm slid"
        if report.soles is None:
            measured = f"at most {slid} within {MM * CONTACT_M:.0f} mm of the ground"
        else:
            height, tilt = (
                f"{report.soles.height_mm:.2f} mm off the ground",
                f"{report.soles.tilt_deg:.2f} degrees tilted",
            )
            measured = f"at most {height}, {tilt}, {slid}"
        yield Finding("soles" + planned, measured)
    deep = (report.penetrating_frames or 0) > 0
    clearance = report.min_clearance_mm
    for name, allowed, mm, pair in (
        ("its own links", "do not meet", clearance.self, report.closest_links),
        ("obstacles", "are not touched", clearance.scene, report.deep.obstacle),
        ("the floor", "is touched by soles alone", clearance.ground, report.deep.ground),
    ):
        if mm is not None:
            gap = f"never closer than {mm:.1f} mm" if mm >= 0.0 else f"{-mm:.1f} mm inside each other"
            named = f" ({' and '.join(pair)})" if pair else ""
            yield Finding(name + planned, gap + named, allowed, not deep or mm >= 0.0)
    if deep:
        yield Finding(
            "penetration" + planned,
            f"in {counted(report.penetrating_frames or 0, 'tick')}, by more than 1 mm in {report.deep.frames}",
        )


def _observers(report: Report) -> Iterator[Finding]:
    switches, steps = report.mode_switches_per_s, report.steps
    if switches is not None:
        worst = f", {switches.worst:.1f} of {switches.name}" if switches.name else ""
        share = report.observers.reactive_share if report.observers else 0.0
        contact = f"; in contact in {share:.1%} of ticks" if share else ""
        yield Finding("observers", f"{switches.mean:.1f} changes of mode a second on average{worst}{contact}")
    if report.gated_frames is not None:
        alone = (
            f"; no goal in {counted(report.no_command_frames, 'tick')}: joints braked"
            if report.no_command_frames
            else ""
        )
        yield Finding("gate", f"changed {report.gated_frames} of {report.ticks} goals{alone}")
    if steps is not None:
        late = f"{steps.declined} declined, for it could not be in time"
        yield Finding("steps", f"{steps.made} made of {steps.asked} asked; {late}")


MOST = 3
"""Reasons for data that were not used that the line names, those of which there were most; and times of a posture that
was not followed, the first ones."""


STAGES = {"page": "from picture to page", "network": "from page to run", "goal": "from run to goals"}
"""Words for the stages of `LiveReport.latency_ms`."""


def latency_line(report: Report) -> str:
    """The way from the performer's hand to the robot's shafts, and the stages that take a millisecond; "" where nothing
    is known."""
    whole, stages = report.hand_to_shaft_ms, report.latency_ms or {}
    taken = ", ".join(f"{stage} {time.p50:.0f}" for stage, time in stages.items() if time.p50 >= 1.0)
    if whole is None:
        return taken and f"{taken} ms; from hand to shaft it is not known"
    return f"{whole.p50:.0f} ms from hand to shaft (p99 {whole.p99:.0f}): {taken}"


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


def physics_findings(seen: PhysicsReport | None) -> Iterator[Finding]:
    """The simulated mechanics of a run; nothing where nothing has mass."""
    if seen is None:
        return
    how = {"floor": "did not fall", "stand": "on a stand", "gantry": "hangs on a gantry"}[seen.mount]
    if seen.fallen:
        how = f"fallen at {seen.fallen_at_s or 0.0:.2f} s: {seen.how}"
    if seen.perturbations:
        how += f" (perturbations: {', '.join(seen.perturbations)}; seed {seen.seed})"
    yield Finding("physics", how, "it does not fall", not seen.fallen)
    yield Finding("at rest", "" if seen.toppled is None else f"it did not stay: {seen.toppled}")
    margin = seen.min_zmp_margin_mm
    if margin is not None:
        near = f"never nearer to the edge of the soles than {margin:z.2f} mm"
        slipped = f"{seen.foot_slip_mm['total']:.1f} mm slipped, tipped by {seen.sole_tilt_max_deg:.1f} degrees"
        yield Finding("pressure", f"{near}; {slipped}", f"more than {TIPS_MM:g} mm inside the soles", margin > TIPS_MM)
    torque, heat = seen.torque_nm, {joint: heat for joint, heat in seen.temperature_c.items() if heat == heat}
    if torque:
        most = max(torque, key=lambda joint: torque[joint].max)
        yield Finding("torque", f"{torque[most].max:.2f} N m at most, 95 % below {torque[most].p95:.2f} ({most})")
    if heat:
        most = max(heat, key=lambda joint: heat[joint])
        warm = f"{heat[most]:.1f} degrees Celsius at most ({most}), by a model {seen.heat_model}"
        yield Finding("heat", warm)
    counts = {"itself": seen.self_contacts, "fixtures or the floor": seen.fixture_contacts}
    touches = ", ".join(f"touches {what} in {counted(ticks, 'tick')}" for what, ticks in counts.items() if ticks)
    yield Finding("contacts", touches or "none", "none but the soles", not touches)
    yield Finding("simulation", _number(seen.realtime_factor, "times as fast as real time"))


def _machine(run: RunResult, report: Report) -> Iterator[Finding]:
    if report.bus is not None and run.robot is not None:
        yield from _bus(run, report.bus, report.ticks)
    costs = {"human": report.reconstruct_us, "robot": report.retarget_us}
    ran = {stage: cost for stage, cost in costs.items() if cost and math.isfinite(cost.p50)}
    known = [f"{stage} {cost.p50:.0f} us (p99 {cost.p99:.0f})" for stage, cost in ran.items()]
    speed = f"{counted(round(report.frames_per_s), 'frame')}/s"
    yield Finding("cost per tick", f"{', '.join(known)}; {speed}" if known else "")
    reason = report.stop.reason
    ended = "to its end" if reason is None else ": ".join(part for part in (report.stop.state, reason) if part)
    yield Finding("end", ended, kept=reason is None)


def _bus(run: RunResult, bus: BusReport, ticks: int) -> Iterator[Finding]:
    assert run.robot is not None, "a bus is a robot's"
    safety, faults = run.robot.profile.safety, bus.faults
    seen = counted(faults, "fault") if faults else "none"
    yield Finding("faults", seen, "all servos answer, none is alarmed", not faults)
    if bus.missed_ticks is not None and run.setup.real_time:
        missed = f"{bus.missed_ticks} of {ticks + bus.missed_ticks}" if bus.missed_ticks else "none"
        longest = "" if bus.longest_period_ms is None else f"; the longest took {bus.longest_period_ms:.1f} ms"
        advice = ", see retarget doctor" if bus.missed_ticks else ""
        allowed = f"none, {1e3 * run.clip.dt:.3g} ms each"
        yield Finding("ticks missed", missed + longest + advice, allowed, not bus.missed_ticks)
    if bus.hottest is not None:
        kept = bus.hottest.value < safety.temperature_c
        measured = f"{bus.hottest.value:.0f} °C ({bus.hottest.joint})"
        yield Finding("temperature", measured, f"below {safety.temperature_c:g} °C", kept)
    if bus.lowest_voltage is not None:
        low, high = safety.voltage
        kept = low <= bus.lowest_voltage.value <= high
        measured = f"lowest {bus.lowest_voltage.value:.1f} V ({bus.lowest_voltage.joint})"
        yield Finding("voltage", measured, f"{low:g} to {high:g} V", kept)


# The summary on the terminal: who followed how well, and what was measured.


def show_summary(run: RunResult, report: Report, console: Console) -> None:
    """Print the report of a run as two tables."""
    what = "human" if report.robot == "human" else report.robot
    lasted = f", {report.duration_s:.1f} s from the first to the end" if report.frames else ""
    by = " and ".join(report.priorities)
    console.print(
        f"{report.source} on {what} by {by}: {counted(report.frames, 'frame')} followed{lasted}, "
        + f"at {report.rate_hz:g} Hz"
        + (f", speed {report.speed:g}" if report.speed != 1.0 else ""),
        markup=False,
        highlight=False,
        soft_wrap=True,
    )
    console.print()
    if report.tracking_mm:
        console.print(_tracking_table(report))
        console.print()
    facts = Table("", "", box=None, pad_edge=False, show_header=False)
    for finding in findings(run, report):
        broken = f" [allowed: {finding.allowed}]" if finding.allowed and not finding.kept else ""
        facts.add_row(finding.name, Text(finding.measured + broken))
    console.print(facts)
    for note in report.notes:
        console.print(f"note: {note}", markup=False, highlight=False, soft_wrap=True)


def _tracking_table(report: Report) -> Table:
    """Errors of everything that was followed, mm: as it was sent and, where there are servos, as they were."""
    table = Table(box=None, pad_edge=False)
    servos = report.servo_tracking_mm
    table.add_column("tracking, mm" if servos is None else "tracking, mm: sent")
    for heading in ("mean", "p95", "max", *(() if servos is None else ("servos: mean", "p95", "max"))):
        table.add_column(heading, justify="right", min_width=7)
    for name, spread in report.tracking_mm.items():
        table.add_row(name, *_spread(spread), *_spread((servos or {}).get(name)))
    if report.robot != "human":
        for name, spread in report.sensors_mm.items():
            table.add_row("human " + name, *_spread(spread))
    return table


def _spread(spread: Spread | None) -> list[str]:
    return [] if spread is None else [f"{value:.1f}" for value in (spread.mean, spread.p95, spread.max)]


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
