"""Your own robot from a URDF or MJCF file: draft its profile, then let it follow; without a file, Wolfgang's body."""

import sys
from pathlib import Path
from tempfile import TemporaryDirectory

from hardware.clock import VirtualClock
from retarget import RunOptions, load_robot, measure
from retarget.run.prepare import prepare
from retarget.setup.import_robot import import_robot
from sim.mock_bus import mock_bus
from sim.performer import synthetic_performer


def main(path: str | None = None) -> None:
    """Print what was found, and how well it follows."""
    body = Path(path) if path else load_robot("wolfgang").profile.body_path
    with TemporaryDirectory() as folder:
        made = import_robot(body, Path(folder, "robot"))
        print(f"{made.drafts} lines to look at; problems: {'; '.join(made.problems) or 'none'}")
        options = RunOptions(robot=str(made.folder / "robot.yaml"))
        frames = synthetic_performer().cut(0.0, 2.0)
        with prepare(lambda: frames, options, clock=VirtualClock(), make_bus=mock_bus) as prepared:
            report = measure(prepared.run())
    for name in ("l_hand", "r_hand"):
        print(f"{name}: {report.tracking_mm[name].mean:.1f} mm off on average")


if __name__ == "__main__":
    main(*sys.argv[1:2])
