"""The page as a whole: one file, nothing from elsewhere, and no script but our own is allowed to run."""

import base64
import hashlib
from collections.abc import Mapping
from importlib.resources import files
from pathlib import Path

from matplotlib.figure import Figure

from retarget.outputs import write_atomic
from retarget.plots import figures_of
from retarget.report import Report
from retarget.report_page.animation import animation_of
from retarget.report_page.markup import Markup, element, joined, safe
from retarget.report_page.moments import moments
from retarget.report_page.pictures import drawn
from retarget.report_page.player_section import player_section
from retarget.report_page.sections import (
    head_section,
    moment_section,
    notes_section,
    numbers_section,
    tracking_section,
    verdict_section,
)
from retarget.report_page.verdicts import verdicts
from retarget.run_result import RunResult

__all__ = ["page_html", "write_page"]

ORDER = ("poses", "tracking", "balance", "pressure", "angles")
"""Of the pictures."""
SCRIPTS = ("motion.js", "bodies.js", "ground.js", "player.js")
HEADINGS = {
    "poses": "Poses",
    "tracking": "Asked and reached",
    "balance": "Balance",
    "pressure": "Pressure under the soles",
    "angles": "Joint angles",
}


def write_page(run: RunResult, report: Report, path: Path, *, figures: Mapping[str, Figure] | None = None) -> None:
    """Write the page of a run, whole or not at all. Raises UsageError if the file cannot be written."""
    write_atomic(path, page_html(run, report, figures=figures).encode(), option="--report")


def page_html(run: RunResult, report: Report, *, figures: Mapping[str, Figure] | None = None) -> str:
    """The page of a run. Every text of the run in it is escaped. figures: of the run, where they are drawn already."""
    shown = figures_of(run) if figures is None else figures
    found, drawings = verdicts(run, report), {name: drawn(figure, name) for name, figure in shown.items()}
    body = element(
        "main",
        head_section(report, found),
        *(moment_section(moment) for moment in moments(run)),
        verdict_section(found),
        player_section(animation_of(run)),
        *(_picture(name, drawings[name]) for name in ORDER[:1] if name in drawings),
        tracking_section(report),
        *(_picture(name, drawings[name]) for name in ORDER[1:] if name in drawings),
        notes_section(report.notes),
        numbers_section(report),
    )
    script, style = _script(), _own("page.css")
    digest = base64.b64encode(hashlib.sha256(script.encode()).digest()).decode("ascii")
    policy = f"default-src 'none'; style-src 'unsafe-inline'; script-src 'sha256-{digest}'"
    head = element(
        "head",
        element("meta", charset="utf-8"),
        element("meta", http_equiv="Content-Security-Policy", content=policy),
        element("meta", name="viewport", content="width=device-width, initial-scale=1"),
        element("meta", name="color-scheme", content="light dark"),
        element("title", safe(f"{report.robot}: {Path(report.source).name}")),
        element("style", style),
    )
    page = element("html", head, element("body", joined([body, element("script", script)])), lang="en")
    return f"<!DOCTYPE html>\n{page}\n"


def _picture(name: str, drawing: Markup) -> Markup:
    # Wide pictures scroll on a narrow screen: what is shrunk cannot be read.
    return element("section", element("h2", safe(HEADINGS[name])), element("div", drawing, class_=f"drawing {name}"))


def _script() -> Markup:
    """The player, whose parts share one scope that nobody else sees."""
    return Markup("\n".join(['"use strict";', "(() => {", *(_own(name) for name in SCRIPTS), "})();"]))


def _own(name: str) -> Markup:
    """One of our own files beside this one."""
    return Markup(files("retarget.report_page").joinpath(name).read_text(encoding="utf-8"))
