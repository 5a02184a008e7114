"""`python -m benchmarks.gallery` (`make gallery`): one motion on every shipped robot, and a walk, beside the performer,
animated.

Synthetic performers move; each robot follows on a mock bus, as `retarget run` would. What is drawn are the shapes of
the bodies in the postures that were sent.
"""

from collections.abc import Callable, Iterable
from typing import Any

from benchmarks.docs_tables import ROBOTS
from benchmarks.table import ROOT
from hardware.clock import VirtualClock
from retarget.frames import SensorFrames
from retarget.pictures.solid import DrawnPostures, moving, pictures, webp
from retarget.run.options import RunOptions
from retarget.run.prepare import prepare
from retarget.run.run_result import RunResult
from sim.mock_bus import mock_bus
from sim.performer import strolling_performer, synthetic_performer

IMAGES = ROOT / "docs" / "images"
SECONDS, WALK_SECONDS = 11.0, 8.0
"""Of the animations: as long as the performer does each thing once, and walks."""
WALKERS = ("op3",)
"""Robots that walk with mass."""
WIDTH, QUALITIES = 1080, range(40, 4, -2)
"""Pixels across, and qualities of the compression in percent: the first is taken whose animation is small enough."""
MOST_BYTES = 2_000_000
"""Size of the animation, so that a page with it is there at once."""


def followed(robot: str, performer: Callable[[], SensorFrames], **options: Any) -> RunResult:
    """The run of a robot that follows a performer."""
    with prepare(performer, RunOptions(robot=robot, **options), clock=VirtualClock(), make_bus=mock_bus) as prepared:
        return prepared.run()


def postures(
    robots: Iterable[str], performer: Callable[[], SensorFrames], seconds: float, **options: Any
) -> dict[str, DrawnPostures]:
    """The performer and each robot."""
    shown: dict[str, DrawnPostures] = {}
    for name in robots:
        human, robot = moving(followed(name, performer, **options), seconds=seconds).values()
        shown = (shown or {"performer": human}) | {ROBOTS[name]: robot}
    return shown


def write(name: str, shown: dict[str, DrawnPostures]) -> None:
    """Write an animation. Raises SystemExit where it is too large at every quality."""
    frames, path = list(pictures(shown, width=WIDTH)), IMAGES / name
    for quality in QUALITIES:
        made = webp(frames, len(frames), quality=quality)
        if len(made) <= MOST_BYTES:
            break
    else:
        raise SystemExit(f"the animation has {len(made)} bytes, allowed: {MOST_BYTES}. Make it shorter")
    path.write_bytes(made)
    print(f"{path.relative_to(ROOT)}: {len(frames)} pictures, quality {quality}, {len(made) / 1e6:.2f} MB")


def main() -> None:
    """Write the animations."""
    write("gallery.webp", postures(ROBOTS, synthetic_performer, SECONDS))
    write("walking.webp", postures(WALKERS, strolling_performer, WALK_SECONDS, steps="walk"))


if __name__ == "__main__":
    main()
