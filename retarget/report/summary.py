"""What a run says when it is over: one sentence, and the few lines that matter before it."""

from collections.abc import Sequence

from hardware.errors import counted
from retarget.report.findings import FOLLOWING, NOT_FOLLOWED, RunFigures, findings, moments
from retarget.report.lines import lines_of
from retarget.report.report import Report
from retarget.run.run_result import RunResult

MOST_REMARKS = 7
"""With the first line, the files, the state of torque and the sentence, a run prints at most 12 lines."""
CHANGED = 0.05
"""Share of the goals that the gate may change before that is said: the verdict allows a twentieth of the time, too."""
MOST_DIFFERENCES = 2
"""Differences that the sentence names, the first ones."""


def heading(report: Report) -> str:
    """The line that says what was played on which robot."""
    lasted = f", {report.duration_s:.1f} s from the first to the end" if report.frames else ""
    speed = f", speed {report.speed:g}" if report.speed != 1.0 else ""
    played = f"{counted(report.frames, 'frame')} followed{lasted}, at {report.rate_hz:g} Hz{speed}"
    return f"{report.source} on {report.robot} by {' and '.join(report.priorities)}: {played}"


def remarks(run: RunResult, report: Report, notes: Sequence[str]) -> list[str]:
    """The lines that matter, at most `MOST_REMARKS`: limits that were not kept, but for what the sentence says; what
    was not followed; the pair that the gate refused most; and notes."""
    known = findings(run, report)
    lost = [one for one in known if one.kept is False and one.name not in (FOLLOWING, "end")]
    lines = [f"not kept: {one.name}: {one.measured} [allowed: {one.allowed}]" for one in lost]
    said = [one.measured for one in known if one.name == NOT_FOLLOWED]
    refused = RunFigures(run, report).refused
    if refused and (report.gated_frames or 0) > CHANGED * report.ticks:
        said.append(f"the gate changed {report.gated_frames} of {report.ticks} goals, {refused}")
    lines += [f"note: {text}" for text in (*said, *notes)]
    more = len(lines) - MOST_REMARKS
    return [*lines[: MOST_REMARKS - 1], f"and {more + 1} more lines: --verbose"] if more > 0 else lines


def sentence(run: RunResult, report: Report) -> str:
    """How the run went, in one sentence without a full stop."""
    seen = RunFigures(run, report)
    verdict, figures = seen.verdict, ", ".join(one.measured for one in lines_of("sentence", seen))
    whose = "the performer" if run.robot is None else report.robot
    words = "is reconstructed" if run.robot is None else "did not follow"
    if verdict is not None:
        more = len(verdict.differs) - MOST_DIFFERENCES
        differs = [*verdict.differs[:MOST_DIFFERENCES], *([f"{more} more"] if more > 0 else [])]
        words = verdict.words + (f" ({', '.join(differs)})" if differs else "")
    if report.stop.reason is not None:
        at = "".join(f" at {moment.time:.2f} s" for moment in moments(run) if moment.what == "Stopped")
        stopped = f"{whose} stopped{at} ({report.stop.reason})"
        if not run.ticks_followed:
            return f"{stopped} before it followed"
        whose = f"{stopped}; until then it"
    return f"{whose} {words}" + (f": {figures}" if figures and run.ticks_followed else "")
