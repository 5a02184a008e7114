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
    gui, parts = server.gui, drawing.parts
    with gui.add_folder("what is shown"):
        boxes = {part: gui.add_checkbox(LEGEND[part].box, LEGEND[part].at_first) for part in parts}
        choices = drawing.colourings
        chosen = gui.add_dropdown("limbs coloured by", choices, initial_value=choices[0]) if choices else None
        clear = gui.add_checkbox("see through bodies", False)
    with gui.add_folder("what it means"):
        meaning = gui.add_html("")

    def explain() -> None:
        meaning.content = legend((part for part, box in boxes.items() if box.value), drawing.scale)

    def see(part: str) -> None:
        drawing.see(part, visible=bool(boxes[part].value))
        explain()

    for part, box in boxes.items():
        see(part)
        box.on_update(lambda _, part=part: see(part))  # type: ignore[misc]
    clear.on_update(lambda _: drawing.see_through(bodies=bool(clear.value)))
    if chosen is not None:
        picked = chosen

        def colour(_: object) -> None:
            drawing.colour_by(picked.value)
            explain()

        picked.on_update(colour)
