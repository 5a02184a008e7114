"""The HTML page of a run: one file, nothing from elsewhere, and no script but our own is allowed to run."""

import base64
import hashlib
import io
import re
from collections.abc import Iterable, Mapping
from html import escape
from importlib.resources import files
from pathlib import Path
from string import Template
from typing import NewType

import matplotlib
from matplotlib.figure import Figure

from retarget.live.stream_report import LiveReport
from retarget.report.animation import Animation, animation_of
from retarget.report.plot_style import ASKED, LEFT, LIMIT, MIDDLE, REACHED, SERVOS
from retarget.report.plots import figures_of
from retarget.report.report import Report, Spread
from retarget.report.verdicts import Moment, Outcome, Verdict, moments, verdicts
from retarget.run.run_result import RunResult
from retarget.schema.files import write_atomic

# HTML from untrusted text: whatever is not `Markup` already is escaped.

Markup = NewType("Markup", str)
"""HTML that is as it should be: made here, or from our own files."""


def safe(content: object) -> Markup:
    """Text, escaped; nothing for None."""
    return Markup("" if content is None else escape(str(content), quote=True))


def element(tag: str, *children: Markup, **attributes: str | None) -> Markup:
    """An element. A child that is a plain str does not pass the type check: it goes through `safe` first.

    attributes: `class_` for class, _ for -; None is left out; values are escaped.
    """
    said = "".join(
        f' {name.rstrip("_").replace("_", "-")}="{escape(value, quote=True)}"'
        for name, value in attributes.items()
        if value is not None
    )
    return Markup(f"<{tag}{said}>{''.join(children)}</{tag}>")


def joined(parts: Iterable[Markup]) -> Markup:
    """Several in a row."""
    return Markup("".join(parts))


# The parts of the page that are words and numbers: head, verdicts, tables.

SIGNS = {Outcome.PASS: "✓", Outcome.FAIL: "✗"}
LEAST_BAR = 1.0
"""mm of a full bar at least: less cannot be seen."""


def head_section(report: Report, found: tuple[Verdict, ...]) -> Markup:
    """What ran, how it ended, and the numbers that say most."""
    failed = sum(verdict.outcome is Outcome.FAIL for verdict in found)
    kept = sum(verdict.outcome is Outcome.PASS for verdict in found)
    words = f"all {kept} limits kept" if not failed else f"{failed} of {failed + kept} limits not kept"
    badge = element(
        "p", safe(f"{SIGNS[Outcome.FAIL if failed else Outcome.PASS]} {words}"), class_=f"badge {_tone(failed)}"
    )
    what = "A performer, reconstructed" if report.robot == "human" else f"{report.robot} follows a performer"
    facts = [
        ("source", report.source),
        ("length", f"{report.duration_s:.2f} s, {report.frames} frames, {report.ticks} ticks at {report.rate_hz:g} Hz"),
        ("performer", report.performer),
        ("priorities", ", ".join(report.priorities)),
        *([("speed", f"{report.speed:g}")] if report.speed != 1.0 else []),
        *([("stream", _stream(report.live))] if report.live is not None else []),
    ]
    about = joined(joined([element("dt", safe(name)), element("dd", safe(value))]) for name, value in facts)
    tiles = joined(
        element("div", element("b", safe(value)), element("span", safe(name)), class_="tile")
        for name, value in _tiles(report)
    )
    return element(
        "header",
        element("h1", safe(what)),
        badge,
        element("dl", about, class_="facts"),
        element("div", tiles, class_="tiles"),
    )


def _tone(failed: int) -> str:
    return "fail" if failed else "pass"


def _stream(live: LiveReport) -> str:
    """What came of a live stream."""
    unused = sum(live.dropped.values())
    held = f"; held {live.holds.count} times, {live.holds.s:.1f} s in all" if live.holds.count else ""
    return f"{live.frames} frames in {live.datagrams} datagrams, {unused} poses or datagrams not used{held}"


def _tiles(report: Report) -> list[tuple[str, str]]:
    hands = (report.reachable_hands_mm or {}).get("mean")
    sensors = [spread.mean for spread in report.sensors_mm.values()]
    own = report.min_clearance_mm.self
    tiles = [
        ("hands, where within reach, are off by", None if hands is None else f"{hands:.1f} mm"),
        ("sensors are met to", f"{max(sensors):.2f} mm" if sensors and report.robot == "human" else None),
        ("lag", None if report.lag_s is None else f"{1e3 * report.lag_s:.0f} ms"),
        ("of the hands' path was covered", None if report.hand_path_ratio is None else f"{report.hand_path_ratio:.0%}"),
        ("nearest of its own links", None if own is None else f"{own:.1f} mm"),
        ("from the edge of balance", None if report.com_margin_mm is None else f"{report.com_margin_mm:.1f} mm"),
        (
            "goals changed by the gate",
            None if report.gated_frames is None else f"{report.gated_frames} of {report.ticks}",
        ),
        ("joints without sensor are off by", _off(report)),
    ]
    return [(name, value) for name, value in tiles if value is not None]


def _off(report: Report) -> str | None:
    mean = (report.unsensed_mm or {}).get("mean")
    return None if mean is None else f"{mean:.0f} mm"


def moment_section(moment: Moment) -> Markup:
    """One moment at which a run went wrong."""
    return element(
        "section",
        element("h2", safe(f"{moment.what} at {moment.time:.2f} s")),
        element("p", safe(moment.text)),
        *(element("p", safe(line), class_="soft") for line in moment.more),
        element("button", safe("Show this moment"), type="button", data_time=f"{1e3 * moment.time:.0f}", class_="goto"),
        class_="moment",
    )


def verdict_section(found: tuple[Verdict, ...]) -> Markup:
    """A line for every limit."""
    rows = joined(
        element(
            "tr",
            element("th", safe(verdict.limit), scope="row"),
            element("td", safe(verdict.allowed), data_label="allowed"),
            element("td", safe(verdict.measured), data_label="measured"),
            element(
                "td",
                element(
                    "span", safe(f"{SIGNS[verdict.outcome]} {verdict.outcome.value}"), class_=verdict.outcome.value
                ),
                data_label="verdict",
            ),
        )
        for verdict in found
    )
    head = joined(element("th", safe(name), scope="col") for name in ("limit", "allowed", "measured", "verdict"))
    table = element("table", element("thead", element("tr", head)), element("tbody", rows), class_="verdicts")
    return element("section", element("h2", safe("Limits")), table)


def tracking_section(report: Report) -> Markup:
    """How far everything that was followed was off."""
    human = report.robot == "human"
    blocks = [("sensors" if human else "landmarks, as sent", report.tracking_mm)]
    if report.servo_tracking_mm:
        blocks.append(("landmarks, where the servos were", report.servo_tracking_mm))
    if not human:
        blocks.append(("sensors of the human", report.sensors_mm))
    most = max((spread.p95 for _, block in blocks for spread in block.values()), default=0.0)
    most = max(most, LEAST_BAR)
    tables = joined(_spreads(title, block, most) for title, block in blocks if block)
    said = "Distance from asked to reached at the same tick, lag included, in mm; the bar is the 95th percentile."
    if not any(block for _, block in blocks):
        said = "Nothing was followed."
    return element("section", element("h2", safe("Tracking")), element("p", safe(said), class_="soft"), tables)


def _spreads(title: str, block: dict[str, Spread], most: float) -> Markup:
    head = joined(element("th", safe(name), scope="col") for name in (title, "mean", "p95", "max", ""))
    rows = joined(
        element(
            "tr",
            element("th", safe(name.replace("_", " ")), scope="row"),
            *(element("td", safe(f"{value:.1f}"), class_="number") for value in (spread.mean, spread.p95, spread.max)),
            element("td", _bar(spread.p95 / most), class_="bar"),
        )
        for name, spread in block.items()
    )
    return element("table", element("thead", element("tr", head)), element("tbody", rows), class_="spreads")


def _bar(share: float) -> Markup:
    width = f"{100.0 * min(share, 1.0):.1f}"
    return element(
        "svg",
        element("rect", width=width, height="10", rx="2"),
        viewBox="0 0 100 10",
        preserveAspectRatio="none",
        aria_hidden="true",
    )


def notes_section(notes: tuple[str, ...]) -> Markup:
    """The notes of the run on its source."""
    if not notes:
        return Markup("")
    items = joined(element("li", safe(note)) for note in notes)
    return element("section", element("h2", safe("Notes")), element("ul", items))


def numbers_section(report: Report) -> Markup:
    """The report itself, as its JSON file has it."""
    return element(
        "section",
        element(
            "details", element("summary", safe("All numbers (report.json)")), element("pre", safe(report.as_json()))
        ),
    )


# Our own pictures as drawings inside a page: they follow its light and dark, and stay sharp in print.

COLOURS = {
    "#000000": "--ink",
    "#ffffff": "--paper",
    MIDDLE: "--ink",
    "#262626": "--ink",
    "#555555": "--soft",
    "#999999": "--line",
    "#a0a0a0": "--line",
    "#c9c9c9": "--trunk",
    "#d5d5d5": "--grid",
    "#dddddd": "--grid",
    "#e6e6e6": "--grid",
    "#eeeeee": "--grid",
    ASKED: "--asked",
    REACHED: "--right",
    SERVOS: "--servos",
    LEFT: "--left",
    LIMIT: "--limit",
}
"""Colours of the pictures, and the page's own that stand for them."""
_COLOUR = re.compile("|".join(COLOURS), re.IGNORECASE)
_TAG = re.compile(r"<[^<>]*>")
_PLACES = re.compile(r'\b(?:d|x|y)="[^"]*"')
_NUMBER = re.compile(r"(-?\d+\.\d{2})\d+")
_NAME = re.compile(r'(\bid="|xlink:href="#|url\(#)')
_OPENING = re.compile(r"<svg\b[^>]*?viewBox=\"([^\"]+)\"[^>]*>", re.DOTALL)
_LEFT_OUT = re.compile(r"<metadata>.*?</metadata>|<!--.*?-->|<\?xml.*?\?>|<!DOCTYPE.*?>", re.DOTALL)


def drawn(figure: Figure, name: str) -> Markup:
    """A figure as an SVG element. name: makes its ids its own. Matplotlib escapes what a figure says.

    The figure keeps the layout that it gets here: finding it is most of the work.
    """
    stream = io.StringIO()
    with matplotlib.rc_context({"svg.fonttype": "none", "svg.hashsalt": name, "path.simplify_threshold": 0.3}):
        figure.savefig(stream, format="svg", transparent=True)
    figure.set_layout_engine("none")
    text = _LEFT_OUT.sub("", stream.getvalue())
    text = _OPENING.sub(rf'<svg viewBox="\1" role="img" aria-label="{name}" class="picture">', text, count=1)
    # Only what stands in tags: the texts of a figure stay as they are.
    return Markup(_TAG.sub(lambda tag: _own_ids(tag.group(), name), text).strip())


def _own_ids(tag: str, name: str) -> str:
    """A tag with the page's colours, with ids of its own, and no more digits than can be seen."""
    tag = _PLACES.sub(lambda places: _NUMBER.sub(r"\1", places.group()), tag)
    tag = _COLOUR.sub(lambda found: f"var({COLOURS[found.group().lower()]})", tag)
    return _NAME.sub(rf"\g<1>{name}-", tag)


# The part of the page that moves: what the script fills and drives.


def player_section(animation: Animation | None) -> Markup:
    """Views, controls and the data; nothing for a run that followed nothing."""
    if animation is None:
        return Markup("")
    views = [_view("performer", "Performer", "dots: sensors as measured; lines: reconstructed")]
    if animation.robot is not None:
        sent = "as sent, not as simulated" if animation.simulated else "as sent"
        views.append(
            _view("robot", animation.robot.label, f"circles: landmarks asked; lines: {sent}{_obstacles(animation)}")
        )
    if animation.ground is not None:
        views.append(_view("above", "Balance, from above", "centre of mass over the support polygon; forward is up"))
    every = "every tick is shown" if animation.every == 1 else f"one tick in {animation.every} is shown"
    return element(
        "section",
        element("h2", safe("Motion")),
        element("div", joined(views), class_=f"views of{len(views)}"),
        _own("controls.html"),
        element("canvas", id="strip", aria_hidden="true"),
        _legend(animation),
        element("p", safe(f"Drag a body to turn it; {every}."), class_="soft screen"),
        element("script", Markup(animation.as_json()), type="application/json", id="motion"),
        id="player",
    )


def _obstacles(animation: Animation) -> str:
    return "" if animation.obstacles is None else "; thin: obstacles"


def _view(name: str, title: str, caption: str) -> Markup:
    canvas = element("canvas", id=f"view-{name}", role="img", aria_label=f"{title}, animated")
    caption_element = element("figcaption", element("b", safe(title)), element("span", safe(caption)))
    return element("figure", canvas, caption_element, class_=f"view {name}")


def _legend(animation: Animation) -> Markup:
    keys = [("approach", "approach"), ("follow", "following"), ("brake", "braking")]
    shown = [(name, words) for name, words in keys if name[0] in animation.phase]
    if "1" in animation.gated:
        shown.append(("gated", "the gate changed a goal"))
    if animation.ground is not None and "1" in animation.ground.outside:
        shown.append(("outside", "centre of mass outside"))
    if animation.moments:
        shown.append(("event", "stop or fall"))
    return element("ul", joined(element("li", safe(words), class_=name) for name, words in shown), class_="legend")


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
    script = _script()
    digest = base64.b64encode(hashlib.sha256(script.encode()).digest()).decode("ascii")
    title = safe(f"{report.robot}: {Path(report.source).name}")
    frame = Template(_own("page.html"))
    return frame.substitute(digest=digest, title=title, style=_own("page.css"), body=body, script=script)


def _picture(name: str, drawing: Markup) -> Markup:
    # Wide pictures scroll on a narrow screen: what is shrunk cannot be read.
    return element("section", element("h2", safe(HEADINGS[name])), element("div", drawing, class_=f"drawing {name}"))


def _script() -> Markup:
    """The player, whose parts share one scope of their own."""
    return Markup("\n".join(['"use strict";', "(() => {", *(_own(name) for name in SCRIPTS), "})();"]))


def _own(name: str) -> Markup:
    """One of our own files in this folder."""
    return Markup(files("retarget.report").joinpath(name).read_text(encoding="utf-8"))
