"""How all pictures look: sizes, colours that colour-blind readers can distinguish, and how a figure becomes a file."""

from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from numpy.typing import NDArray

# Okabe and Ito's palette.
ASKED = "#7a7a7a"
REACHED = "#0072b2"
SERVOS = "#e69f00"
LEFT, RIGHT, MIDDLE = "#d55e00", "#0072b2", "#333333"
LIMIT = "#cc79a7"
WARNING = "#d55e00"
DPI = 130
MOST_POINTS = 2500
"""A line is drawn through at most about so many points."""


def new_figure(width: float, height: float, title: str) -> Figure:
    """A figure of this size in inches that lays itself out, with one title over all of it."""
    figure = Figure(figsize=(width, height), layout="constrained")
    FigureCanvasAgg(figure)
    figure.suptitle(title, fontsize=12, x=0.01, ha="left")
    return figure


def plain(axes: Axes) -> None:
    """Less ink: light grid, no box."""
    axes.grid(visible=True, color="#e6e6e6", linewidth=0.6)
    axes.set_axisbelow(True)
    axes.tick_params(labelsize=8, length=2)
    for side in ("top", "right"):
        axes.spines[side].set_visible(False)


def side_colour(name: str) -> str:
    """The colour of a body part: left, right, or between."""
    return {"l_": LEFT, "r_": RIGHT}.get(name[:2], MIDDLE)


def thinned(rows: int) -> NDArray[Any]:
    """Choose row numbers, evenly spaced, few enough to draw."""
    return np.arange(0, rows, max(1, rows // MOST_POINTS))


def save_figure(figure: Figure, path: Path) -> None:
    """Write a figure as PNG. Raises OSError."""
    figure.savefig(path, dpi=DPI, facecolor="white")
