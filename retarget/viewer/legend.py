"""What the colours of the scene mean, as HTML for the panel of the page."""

from collections.abc import Iterable
from html import escape

from retarget.viewer.limb_colours import Scale
from retarget.viewer.palette import COLD, HOT, LEGEND, Colour, web

__all__ = ["legend"]


def legend(parts: Iterable[str], scale: Scale | None) -> str:
    """Of these parts of the scene, and of the limbs where they are coloured."""
    rows = [_row(colour, words) for part in parts for colour, words in LEGEND[part].keys]
    if scale is not None:
        rows.append(_bar(scale))
    return f"<div style='padding:0 0.8em;font-size:0.8em;line-height:1.6'>{''.join(rows)}</div>"


def _row(colour: Colour, words: str) -> str:
    style = f"display:inline-block;width:0.8em;height:0.8em;border-radius:50%;background:{web(colour)}"
    return f"<div><span style='{style}'></span> {escape(words)}</div>"


def _bar(scale: Scale) -> str:
    """A bar from one colour to the other, with the numbers at its ends."""
    fade = f"background:linear-gradient(90deg,{web(COLD)},{web(HOT)})"
    low, high = (f"{value:g} {scale.unit}" for value in (scale.low, scale.high))
    return (
        f"<div style='margin-top:0.4em'>{escape(scale.words)}</div>"
        f"<div style='display:flex;gap:0.5em;align-items:center'><span>{low}</span>"
        f"<span style='flex:1;height:0.7em;border-radius:0.3em;{fade}'></span><span>{high}</span></div>"
    )
