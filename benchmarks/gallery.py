"""`python -m benchmarks.gallery` (`make gallery`): one motion on every shipped robot, beside the performer, animated.

The synthetic performer of the demo moves; each robot follows on a mock bus, as `retarget run` would. What is drawn are
the shapes of the bodies in the postures that were sent.
"""

from benchmarks.docs_tables import ROBOTS
from benchmarks.table import ROOT
from hardware.clock import VirtualClock
from retarget.pictures.solid import DrawnPostures, moving, pictures, webp
from retarget.run.options import RunOptions
from retarget.run.prepare import prepare
from retarget.run.run_result import RunResult
from sim.mock_bus import mock_bus
from sim.performer import synthetic_performer

IMAGE = ROOT / "docs" / "images" / "gallery.webp"
SECONDS = 11.0
"""Of the animation: as long as the performer does each thing once."""
WIDTH, QUALITIES = 1080, range(40, 4, -2)
"""Pixels across, and qualities of the compression in percent: the first is taken whose animation is small enough."""
MOST_BYTES = 2_000_000
"""Size of the animation, so that a page with it is there at once."""


def followed(robot: str) -> RunResult:
    """The run of a robot that follows the synthetic performer."""
    with prepare(synthetic_performer, RunOptions(robot=robot), clock=VirtualClock(), make_bus=mock_bus) as prepared:
        return prepared.run()


def postures() -> dict[str, DrawnPostures]:
    """The performer and each robot."""
    shown: dict[str, DrawnPostures] = {}
    for name, title in ROBOTS.items():
        performer, robot = moving(followed(name), seconds=SECONDS).values()
        shown = (shown or {"performer": performer}) | {title: robot}
    return shown


def main() -> None:
    """Write the animation. Raises SystemExit where it is too large at every quality."""
    frames = list(pictures(postures(), width=WIDTH))
    for quality in QUALITIES:
        made = webp(frames, len(frames), quality=quality)
        if len(made) <= MOST_BYTES:
            break
    else:
        raise SystemExit(f"the animation has {len(made)} bytes, allowed: {MOST_BYTES}. Make it shorter")
    IMAGE.write_bytes(made)
    print(f"{IMAGE.relative_to(ROOT)}: {len(frames)} pictures, quality {quality}, {len(made) / 1e6:.2f} MB")


if __name__ == "__main__":
    main()
