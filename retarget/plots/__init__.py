"""`--plots DIR`: pictures of a run, for a person who wants to see what happened. Matplotlib is imported only here."""

from collections.abc import Mapping
from pathlib import Path

import matplotlib
from matplotlib.figure import Figure

from retarget.errors import UsageError
from retarget.outputs import make_folder
from retarget.plots.angles import plot_angles
from retarget.plots.balance import plot_balance
from retarget.plots.poses import plot_poses
from retarget.plots.pressure import plot_pressure
from retarget.plots.style import save_figure
from retarget.plots.tracking import plot_tracking
from retarget.run_result import RunResult

__all__ = ["PICTURES", "figures_of", "write_plots"]

PICTURES = {
    "tracking": plot_tracking,
    "angles": plot_angles,
    "balance": plot_balance,
    "pressure": plot_pressure,
    "poses": plot_poses,
}
"""File name without suffix -> what draws it; None instead of a figure: there is nothing to show."""


def figures_of(run: RunResult) -> dict[str, Figure]:
    """Every picture that has something to show, by its name."""
    with matplotlib.rc_context({"text.parse_math": False}):  # a name with dollar signs is a name, not a formula
        drawn = {name: draw(run) for name, draw in PICTURES.items()}
    return {name: figure for name, figure in drawn.items() if figure is not None}


def write_plots(run: RunResult, folder: Path, *, figures: Mapping[str, Figure] | None = None) -> list[Path]:
    """Write every picture that has something to show, as PNG files in `folder`, made if need be.

    figures: those of `figures_of`, where they are drawn already. Raises UsageError if they cannot be written.
    """
    written = []
    make_folder(folder, option="--plots")
    try:
        for name, figure in (figures_of(run) if figures is None else figures).items():
            path = folder / f"{name}.png"
            save_figure(figure, path)
            written.append(path)
    except OSError as error:
        raise UsageError("cannot write pictures", where="--plots", found=f"{folder}: {error.strerror}") from error
    return written
