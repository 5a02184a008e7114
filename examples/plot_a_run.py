"""Pictures of a run for a notebook: `figures["tracking"]` in a cell shows one; here they are written to a folder.

python examples/plot_a_run.py [DIR]
"""

import sys
from pathlib import Path
from tempfile import TemporaryDirectory

from hardware.clock import VirtualClock
from retarget import RunOptions, measure
from retarget.pictures.plots import figures_of
from retarget.run.prepare import prepare
from sim.mock_bus import mock_bus
from sim.performer import synthetic_performer


def main(folder: str) -> None:
    """Run, draw, write."""
    frames = synthetic_performer().cut(0.0, 2.0)
    with prepare(lambda: frames, RunOptions(robot="op3"), clock=VirtualClock(), make_bus=mock_bus) as prepared:
        run = prepared.run()
    figures = figures_of(run)
    Path(folder).mkdir(parents=True, exist_ok=True)
    for name, figure in figures.items():
        figure.savefig(Path(folder, f"{name}.png"))
    print(f"{', '.join(figures)} in {folder}")
    print(f"l_hand: {measure(run).tracking_mm['l_hand'].mean:.1f} mm off on average")


if __name__ == "__main__":
    if sys.argv[1:]:
        main(sys.argv[1])
    else:
        with TemporaryDirectory() as made:
            main(made)
