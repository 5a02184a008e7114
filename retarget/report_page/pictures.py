"""Our own pictures as drawings inside a page: they follow its light and dark, and stay sharp in print."""

import io
import re

import matplotlib
from matplotlib.figure import Figure

from retarget.plots.style import ASKED, LEFT, LIMIT, MIDDLE, REACHED, SERVOS
from retarget.report_page.markup import Markup

__all__ = ["drawn"]

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
    return Markup(_TAG.sub(lambda tag: _own(tag.group(), name), text).strip())


def _own(tag: str, name: str) -> str:
    """A tag with the page's colours, with ids of its own, and no more digits than can be seen."""
    tag = _PLACES.sub(lambda places: _NUMBER.sub(r"\1", places.group()), tag)
    tag = _COLOUR.sub(lambda found: f"var({COLOURS[found.group().lower()]})", tag)
    return _NAME.sub(rf"\g<1>{name}-", tag)
