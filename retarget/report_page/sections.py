"""The parts of the page that are words and numbers: head, verdicts, tables."""

from retarget.live.account import LiveReport
from retarget.report import Report, Spread
from retarget.report_page.markup import Markup, element, joined, safe
from retarget.report_page.moments import Moment
from retarget.report_page.verdicts import Outcome, Verdict

__all__ = ["head_section", "moment_section", "notes_section", "numbers_section", "tracking_section", "verdict_section"]

SIGNS = {Outcome.PASS: "✓", Outcome.FAIL: "✗"}
LEAST_BAR = 1.0
"""mm of a full bar at least: nobody sees what is less."""


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
    return f"{live.frames} frames in {live.datagrams} datagrams, {unused} things in them not used{held}"


def _tiles(report: Report) -> list[tuple[str, str]]:
    hands = (report.reachable_hands_mm or {}).get("mean")
    sensors = [spread.mean for spread in report.sensors_mm.values()]
    own = report.min_clearance_mm.self
    tiles = [
        ("hands, where within reach, are off by", None if hands is None else f"{hands:.1f} mm"),
        ("sensors are met to", f"{max(sensors):.2f} mm" if sensors and report.robot == "human" else None),
        ("lag", None if report.lag_s is None else f"{1e3 * report.lag_s:.0f} ms"),
        ("of the hands' way was gone", None if report.hand_path_ratio is None else f"{report.hand_path_ratio:.0%}"),
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
    """What the run had to say of its source."""
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
