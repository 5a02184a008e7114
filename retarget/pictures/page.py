"""The HTML page of a run: one file that loads nothing else and allows no foreign script."""

import base64
import hashlib
import io
import re
from collections.abc import Mapping
from pathlib import Path

import jinja2
import matplotlib
from matplotlib.figure import Figure

from hardware.errors import counted, printable
from retarget.pictures.animation import animation_of
from retarget.report.findings import FOLLOWING, NOT_FOLLOWED, findings, measured_words, moments
from retarget.report.report import Report, Spread
from retarget.run.run_result import RunResult
from retarget.schema.files import make_folder, write_atomic

# Figures as SVG inside the page: they stay sharp in print, and the style of the page makes them light or dark.

_TAG = re.compile(r"<[^<>]*>")
_PLACES = re.compile(r'\b(?:d|x|y)="[^"]*"')
_NUMBER = re.compile(r"(-?\d+\.\d{2})\d+")
_NAME = re.compile(r'(\bid="|xlink:href="#|url\(#)')
_OPENING = re.compile(r"<svg\b[^>]*?viewBox=\"([^\"]+)\"[^>]*>", re.DOTALL)
_LEFT_OUT = re.compile(r"<metadata>.*?</metadata>|<!--.*?-->|<\?xml.*?\?>|<!DOCTYPE.*?>", re.DOTALL)


def drawn(figure: Figure, name: str) -> str:
    """A figure as an SVG element. name: prefix of its ids. The figure keeps its layout, which takes most of the
    time. Matplotlib escapes the texts."""
    stream = io.StringIO()
    with matplotlib.rc_context({"svg.fonttype": "none", "svg.hashsalt": name, "path.simplify_threshold": 0.3}):
        figure.savefig(stream, format="svg", transparent=True)
    figure.set_layout_engine("none")
    text = _LEFT_OUT.sub("", printable(stream.getvalue()))
    text = _OPENING.sub(rf'<svg viewBox="\1" role="img" aria-label="{name}" class="picture">', text, count=1)

    def shortened(tag: re.Match[str]) -> str:
        """Prefix the ids of a tag, and drop digits that cannot be seen. The texts between tags stay as they are."""
        fewer = _PLACES.sub(lambda places: _NUMBER.sub(r"\1", places.group()), tag.group())
        return _NAME.sub(rf"\g<1>{name}-", fewer)

    return _TAG.sub(shortened, text).strip()


FOLDER = Path(__file__).parent
"""Folder of templates, styles and scripts."""
SCRIPTS = ("bodies.js", "figure.js", "plot.js", "motion.js", "ground.js", "player.js")
"""Parts of the player, which are joined into one module. Live pages load the first three, too."""
_IMPORT = re.compile(r"^import \{.*\n", re.MULTILINE)
LEAST_BAR = 1.0
"""Smallest full scale of a bar, mm."""
FOLLOWED = (NOT_FOLLOWED, "likeness", "over the ground", "foot path", "latency")
"""Findings in the head of the page: a person sees them in the motion."""


def write_page(run: RunResult, report: Report, path: Path, *, figures: Mapping[str, Figure]) -> None:
    """Write the page of a run, whole or not at all, and make its folder if needed. Raises UsageError."""
    make_folder(path.parent, option="--report")
    write_atomic(path, page_html(run, report, figures=figures).encode(), option="--report")


def player_script(tracks: str = "null") -> str:
    """The player as one module. tracks: an expression for the buffer of the tracks that are not in the page."""
    parts = [f"const tracks = {tracks};", *((FOLDER / name).read_text(encoding="utf-8") for name in SCRIPTS)]
    return _IMPORT.sub("", "\n".join(parts))


def template(name: str) -> jinja2.Template:
    """Load a template of this folder. It escapes every text."""
    pages = jinja2.Environment(
        loader=jinja2.FileSystemLoader(FOLDER),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        finalize=lambda value: printable(value) if type(value) is str else value,  # only our own text is marked safe
    )
    pages.policies["json.dumps_kwargs"] = {"separators": (",", ":"), "allow_nan": False}
    return pages.get_template(name)


def page_html(run: RunResult, report: Report, *, figures: Mapping[str, Figure]) -> str:
    """The page of a run. figures: of `plots.figures_of`."""
    found = findings(run, report)
    limits = [finding for finding in found if finding.kept is not None and finding.name != FOLLOWING]
    animation, tracking = animation_of(run), _tracking(report)
    script = player_script()
    return template("page.html").render(
        report=report,
        counted=counted,
        measured=measured_words(run, report),
        verdict=next((finding for finding in found if finding.name == FOLLOWING), None),
        followed=[finding for finding in found if finding.name in FOLLOWED],
        limits=limits,
        others=[one for one in found if one.kept is None and one.name not in (*FOLLOWED, FOLLOWING)],
        failed=sum(not limit.kept for limit in limits),
        moments=moments(run),
        animation=animation,
        drawings={name: drawn(figure, name) for name, figure in figures.items() if name != "poses"},
        tracking=tracking,
        longest_bar=max([LEAST_BAR, *(spread.p95 for block in tracking.values() for spread in block.values())]),
        style="".join((FOLDER / name).read_text(encoding="utf-8") for name in ("base.css", "page.css")),
        script=script,
        digest=base64.b64encode(hashlib.sha256(script.encode()).digest()).decode("ascii"),
    )


def _tracking(report: Report) -> dict[str, dict[str, Spread]]:
    if report.robot == "human":
        blocks = {"sensors": report.tracking_mm}
    else:
        blocks = {
            "landmarks, as sent": report.tracking_mm,
            "landmarks, where the servos were": report.servo_tracking_mm or {},
            "sensors of the human": report.sensors_mm,
        }
    return {title: block for title, block in blocks.items() if block}
