"""What a run says when it is over: one sentence, and the few lines that matter before it."""

from collections.abc import Iterable, Sequence

from hardware.errors import counted
from retarget.report.findings import (
    FOLLOWING,
    NOT_FOLLOWED,
    Finding,
    Line,
    RunFindings,
    findings,
    found,
    moments,
    refused_words,
)
from retarget.report.report import Report
from retarget.run.run_result import RunResult

MOST_REMARKS = 7
"""With the first line, the files, the state of torque and the sentence, a run then prints at most 12 lines."""
MOST_DIFFERENCES = 2
"""Differences that the sentence names, the first ones."""


def heading(report: Report) -> str:
    """The line that says what was played on whom."""
    lasted = f", {report.duration_s:.1f} s from the first to the end" if report.frames else ""
    speed = f", speed {report.speed:g}" if report.speed != 1.0 else ""
    played = f"{counted(report.frames, 'frame')} followed{lasted}, at {report.rate_hz:g} Hz{speed}"
    return f"{report.source} on {report.robot} by {' and '.join(report.priorities)}: {played}"


def remarks(run: RunResult, report: Report, notes: Sequence[str]) -> list[str]:
    """The lines that matter, at most `MOST_REMARKS`: limits that were not kept, what was not followed, the pair that
    the gate refused most, and notes."""
    lines = [f"not kept: {_bounded(one)}" for one in lost(findings(run, report))]
    lines += [f"note: {one.measured}" for one in findings(run, report) if one.name == NOT_FOLLOWED]
    if report.gated_frames and report.refused_pair is not None:
        lines.append(f"note: the gate changed {report.gated_frames} of {report.ticks} goals, {refused_words(report)}")
    lines += [f"note: {text}" for text in notes]
    more = len(lines) - MOST_REMARKS
    return [*lines[: MOST_REMARKS - 1], f"and {more + 1} more lines: --verbose"] if more > 0 else lines


def lost(of: Iterable[Finding]) -> list[Finding]:
    """The limits that were not kept, but for the verdict and the end, which the sentence says."""
    return [one for one in of if one.kept is False and one.name not in (FOLLOWING, "end")]


def _bounded(one: Finding) -> str:
    return f"{one.name}: {one.measured} [allowed: {one.allowed}]"


def sentence(run: RunResult, report: Report) -> str:
    """How the run went, in one sentence without a full stop."""
    seen = RunFindings(run, report)
    verdict, figures = seen.verdict, ", ".join(one.measured for one in found(SAID, seen))
    whose = "the performer" if seen.robot is None else report.robot
    words = "is reconstructed" if seen.robot is None else "did not follow"
    if verdict is not None:
        differs = [*verdict.differs[:MOST_DIFFERENCES]]
        more = len(verdict.differs) - len(differs)
        differs += [f"{more} more"] if more > 0 else []
        words = verdict.words + (f" ({', '.join(differs)})" if differs else "")
    if report.stop.reason is not None:
        at = "".join(f" at {moment.time:.2f} s" for moment in moments(run) if moment.what == "Stopped")
        stopped = f"{whose} stopped{at} ({report.stop.reason})"
        if not run.ticks_followed:
            return f"{stopped} before it followed"
        whose = f"{stopped}; until then it"
    return f"{whose} {words}: {figures}" if figures and run.ticks_followed else f"{whose} {words}"


def _touched(seen: RunFindings) -> str | None:
    physics, report = seen.report.physics, seen.report
    if physics is not None:
        ticks = physics.self_contacts + physics.fixture_contacts
    elif report.penetrating_frames is None:
        return None
    else:
        ticks = report.penetrating_frames
    return f"something touched in {counted(ticks, 'tick')}" if ticks else "nothing touched"


def _near_falling(seen: RunFindings) -> str | None:
    """The least distance, mm, of the centre of pressure from the edge of the soles; without mass, of the centre of
    mass."""
    report = seen.report
    if report.physics is not None and report.physics.fallen:
        return f"it fell at {report.physics.fallen_at_s or 0.0:.2f} s"
    margin = report.com_margin_mm if report.physics is None else report.physics.min_zmp_margin_mm
    if margin is None or seen.robot is None or not seen.robot.stands:
        return None
    return f"never nearer to falling than {margin:.0f} mm" if margin >= 0.5 else "at the edge of falling"


def _sensors(seen: RunFindings) -> float | None:
    known = [spread.mean for spread in seen.report.sensors_mm.values()] if seen.robot is None else []
    return sum(known) / len(known) if known else None


def _unsensed(seen: RunFindings) -> float | None:
    return (seen.report.unsensed_mm or {}).get("mean") if seen.robot is None else None


SAID: tuple[Line[RunFindings], ...] = (
    Line("sensors", _sensors, "sensors {:.0f} mm off"),
    Line("joints without sensor", _unsensed, "joints without a sensor {:.0f} mm off"),
    Line("hands", lambda seen: (seen.report.reachable_hands_mm or {}).get("mean"), "hands {:.0f} mm off"),
    Line("touched", _touched),
    Line("falling", _near_falling),
)
"""The figures of the sentence."""
