"""What both pages have in their panel: what the robot does in large letters, and what of the scene is shown."""

from html import escape
from typing import TYPE_CHECKING

import numpy as np

from retarget.viewer.drawing import Drawing
from retarget.viewer.legend import legend
from retarget.viewer.moment import Moment
from retarget.viewer.palette import LEGEND

if TYPE_CHECKING:
    import viser

__all__ = ["WAITING", "add_parts", "headline"]

COLOURS = {"following": "#1b7f4b", "stopping": "#b3261e", "stopped": "#b3261e", "ended": "#5f6368"}
OTHERWISE = "#b26a00"
LARGE = "font-size:2em;font-weight:700;line-height:1.1;overflow-wrap:anywhere"
BOX = "padding:0.3em 0.8em"
WAITING = f'<div style="{BOX}"><div style="{LARGE};color:{OTHERWISE}">WAITING</div>nothing has moved yet</div>'


def headline(moment: Moment, note: str = "") -> str:
    """What the robot does, in letters that are read from across a room. note: a line below."""
    colour = COLOURS.get(moment.state, OTHERWISE)
    lines = [f'<span style="font-variant-numeric:tabular-nums">{moment.time:.2f} s</span>']
    if not np.isnan(moment.off):
        lines.append(f"servos at most {np.degrees(moment.off):.1f} degrees off their goals")
    lines += [escape(note)] if note else []
    return (
        f'<div style="{BOX}"><div style="{LARGE};color:{colour}">{escape(moment.state.upper())}</div>'
        f"<div>{escape(moment.why)}</div>"
        + "".join(f'<div style="opacity:0.75">{line}</div>' for line in lines)
        + "</div>"
    )


def add_parts(server: "viser.ViserServer", drawing: Drawing) -> None:
    """A box for everything that can be hidden, what limbs are coloured by, and what the colours mean."""
    gui = server.gui
    with gui.add_folder("what is shown"):
        for part in drawing.parts:
            _add_box(server, drawing, part)
        choices = drawing.colourings
        chosen = gui.add_dropdown("limbs by", choices, initial_value=choices[0]) if len(choices) > 1 else None
    with gui.add_folder("what it means", expand_by_default=False):
        meaning = gui.add_html(legend(drawing.parts, drawing.scale))
    if chosen is not None:
        picked = chosen

        def colour(_: object) -> None:
            drawing.colour_by(picked.value)
            meaning.content = legend(drawing.parts, drawing.scale)

        picked.on_update(colour)


def _add_box(server: "viser.ViserServer", drawing: Drawing, part: str) -> None:
    entry = LEGEND[part]
    box = server.gui.add_checkbox(entry.box, entry.at_first)
    drawing.see(part, visible=entry.at_first)
    box.on_update(lambda _: drawing.see(part, visible=bool(box.value)))
