"""The summary of a run on the terminal: the numbers that show whether it went well."""

import math
from collections.abc import Iterable

from rich.console import Console
from rich.table import Table

from retarget.live.stream_report import LiveReport
from retarget.report.motion_metrics import PhysicsReport
from retarget.report.report import Percentiles, Report, Spread

# The simulated mechanics in the summary: one row for each question.


def physics_facts(physics: PhysicsReport | None) -> Iterable[tuple[str, str]]:
    """Question and answer; an empty answer is left out, and everything where nothing has mass."""
    if physics is None:
        return
    yield "physics", _standing_line(physics)
    yield "at rest", "" if physics.toppled is None else f"it did not stay: {physics.toppled}"
    yield "pressure", _pressure(physics)
    yield "torque", _torque(physics)
    yield "heat", _heat(physics)
    yield "contacts", _contacts(physics)
    yield "speed", "" if physics.realtime_factor is None else f"{physics.realtime_factor:.1f} x real time"


def _standing_line(physics: PhysicsReport) -> str:
    differs = (
        f" (perturbations: {', '.join(physics.perturbations)}; seed {physics.seed})" if physics.perturbations else ""
    )
    if physics.fallen:
        return f"fallen at {physics.fallen_at_s or 0.0:.2f} s: {physics.how}{differs}"
    return {"floor": "did not fall", "stand": "on a stand", "gantry": "hangs on a gantry"}[physics.mount] + differs


def _pressure(physics: PhysicsReport) -> str:
    margin = physics.min_zmp_margin_mm
    if margin is None:
        return ""
    return (
        f"never nearer to the edge of the soles than {margin:z.1f} mm; {physics.foot_slip_mm['total']:.1f} mm slipped, "
        f"tipped by {physics.sole_tilt_max_deg:.1f} degrees"
    )


def _torque(physics: PhysicsReport) -> str:
    torque = physics.torque_nm
    if not torque:
        return ""
    most = max(torque, key=lambda joint: torque[joint].max)
    return f"{torque[most].max:.2f} N m at most, 95 % below {torque[most].p95:.2f} ({most})"


def _heat(physics: PhysicsReport) -> str:
    known = {joint: heat for joint, heat in physics.temperature_c.items() if heat == heat}
    if not known:
        return ""
    hottest = max(known, key=lambda joint: known[joint])
    return f"{known[hottest]:.1f} degrees Celsius at most ({hottest}), by a model {physics.heat_model}"


def _contacts(physics: PhysicsReport) -> str:
    counts = {"itself": physics.self_contacts, "fixtures or the floor": physics.fixture_contacts}
    return ", ".join(f"touches {what} in {ticks} ticks" for what, ticks in counts.items() if ticks)


# The stream of a live run in the summary: one line.

MOST = 3
"""Reasons and sensors that the line names; the report has all of them."""


def stream_line(live: LiveReport | None) -> str:
    """ "" for a file."""
    if live is None:
        return ""
    parts = [f"{live.frames} frames in {live.datagrams} datagrams, played {live.playout_delay_ms:.0f} ms late"]
    if live.dropped:
        reasons = [*live.dropped.items()][:MOST]
        parts.append("not used: " + ", ".join(f"{reason} ({count})" for reason, count in reasons))
    if live.lost_s:
        longest = sorted(live.lost_s.items(), key=lambda item: -item[1])[:MOST]
        parts.append("lost: " + ", ".join(f"{name} {seconds:.1f} s" for name, seconds in longest))
    if live.holds.count:
        parts.append(f"held {live.holds.count} times, {live.holds.s:.1f} s")
    if live.refused:
        parts.append(f"refused senders: {', '.join(live.refused[:MOST])}")
    return "; ".join(parts)


def show_summary(report: Report, console: Console) -> None:
    """Print the report of a run as two tables: who followed how well, and what was kept."""
    what = "human" if report.robot == "human" else report.robot
    console.print(
        f"{report.source} on {what}: {report.frames} frames, {report.duration_s:.1f} s at {report.rate_hz:g} Hz"
        + (f", speed {report.speed:g}" if report.speed != 1.0 else ""),
        markup=False,
        highlight=False,
        soft_wrap=True,
    )
    console.print()
    console.print(_tracking_table(report))
    console.print()
    console.print(_facts_table(report))
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


def _facts_table(report: Report) -> Table:
    """One row for each question that was asked of the run; questions without an answer are left out."""
    table = Table("", "", box=None, pad_edge=False, show_header=False)
    for question, answer in _facts(report):
        if answer:
            table.add_row(question, answer)
    return table


def _facts(report: Report) -> Iterable[tuple[str, str]]:
    limits = report.limit_violations
    yield "hands within reach", _hands(report)
    yield "servos", _servos(report)
    yield "lag", _number(report.lag_s, "ms", scale=1e3)
    yield "hand path", _number(report.hand_path_ratio, "% of what was asked", scale=100.0)
    yield "pelvis travel", _number(report.pelvis_excursion_ratio, "% of what was asked", scale=100.0)
    yield "joints without sensor", _number((report.unsensed_mm or {}).get("mean"), "mm off on average")
    yield "limits broken", f"position {limits.position}, velocity {limits.velocity}, acceleration {limits.acceleration}"
    yield "highest level", _number(report.priority_violation_max, "mm or mrad off at most", digits=3)
    yield "centre of mass", _standing(report)
    yield "soles", _soles(report)
    yield "self clearance", _between(report.min_clearance_mm.self, report.closest_links)
    yield "scene clearance", _between(report.min_clearance_mm.scene, report.deep.obstacle)
    yield "floor clearance", _between(report.min_clearance_mm.ground, report.deep.ground)
    yield "penetration", _penetration(report)
    yield "observers", _observers(report)
    yield "gate", _gate(report)
    yield "steps", _steps(report)
    yield "stream", stream_line(report.live)
    yield from physics_facts(report.physics)
    yield "cost per tick", _cost(report)
    yield "ticks missed", _missed(report)
    yield "end", ": ".join(part for part in (report.stop.state, report.stop.reason) if part)


def _steps(report: Report) -> str:
    steps = report.steps
    if steps is None:
        return ""
    return f"{steps.made} made of {steps.asked} asked; {steps.declined} declined, for it could not be in time"


def _number(value: float | None, unit: str, *, scale: float = 1.0, digits: int = 1) -> str:
    return "" if value is None else f"{scale * value:.{digits}f} {unit}"


def _hands(report: Report) -> str:
    errors = report.reachable_hands_mm or {}
    return ", ".join(
        f"{name} {errors[name]:.1f} mm off in {share:.0%} of ticks" if name in errors else f"{name} never"
        for name, share in (report.reachable_share or {}).items()
    )


def _servos(report: Report) -> str:
    """How far the servos were from what they were sent."""
    servos = report.servo_error_deg
    if not servos:
        return ""
    worst = max(servos, key=lambda name: servos[name].max)
    mean = sum(spread.mean for spread in servos.values()) / len(servos)
    return f"{mean:.1f} degrees behind what was sent on average, {servos[worst].max:.1f} at most ({worst})"


def _gate(report: Report) -> str:
    if report.gated_frames is None:
        return ""
    alone = f"; no goal in {report.no_command_frames} ticks: joints braked" if report.no_command_frames else ""
    return f"changed {report.gated_frames} of {report.ticks} goals{alone}"


def _standing(report: Report) -> str:
    outside, margin = report.com_outside_support_frames, report.com_margin_mm
    if outside is None:
        return ""
    inside = "" if margin is None else f", never nearer to its edge than {margin:.1f} mm"
    by = inside if margin is None or margin >= 0.0 else f", by up to {-margin:.1f} mm"
    return f"outside the support in {outside} ticks{by}"


def _soles(report: Report) -> str:
    if report.soles is None or report.foot_slide_mm is None:
        return ""
    slide, soles = report.foot_slide_mm, report.soles
    return f"at most {soles.height_mm:.2f} mm off the ground, {soles.tilt_deg:.2f} degrees tilted, {slide:.2f} mm slid"


def _between(clear: float | None, pair: tuple[str, str] | None) -> str:
    return "" if clear is None else f"{clear:.1f} mm" + (f" ({' and '.join(pair)})" if pair else "")


def _penetration(report: Report) -> str:
    if not report.penetrating_frames:
        return ""
    return f"in {report.penetrating_frames} ticks, by more than 1 mm in {report.deep.frames}"


def _observers(report: Report) -> str:
    switches = report.mode_switches_per_s
    if switches is None:
        return ""
    worst = f", {switches.worst:.1f} of {switches.name}" if switches.name else ""
    share = report.observers.reactive_share if report.observers else 0.0
    contact = f"; in contact in {share:.1%} of ticks" if share else ""
    return f"{switches.mean:.1f} changes of mode a second on average{worst}{contact}"


def _missed(report: Report) -> str:
    """Nothing where every tick came in time."""
    bus = report.bus
    if bus is None or not bus.missed_ticks:
        return ""
    return f"{bus.missed_ticks} of {report.ticks}; the longest took {bus.longest_period_ms:.0f} ms, see retarget doctor"


def _cost(report: Report) -> str:
    def both(cost: Percentiles) -> str:
        return f"{cost.p50:.0f} us (p99 {cost.p99:.0f})" if math.isfinite(cost.p50) else "not measured"

    robot = "" if report.retarget_us is None else f", robot {both(report.retarget_us)}"
    return f"human {both(report.reconstruct_us)}{robot}; {report.frames_per_s:.0f} frames/s"
