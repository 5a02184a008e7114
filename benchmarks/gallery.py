"""`python -m benchmarks.gallery` (`make gallery`): one motion on every shipped robot, beside the performer, animated.

The synthetic performer of the demo moves; each robot follows on a mock bus, as `retarget run` would. What is drawn are
the shapes of the bodies in the postures that were sent.
"""

from io import BytesIO

import numpy as np
from PIL import Image, ImageDraw

from benchmarks.docs_tables import ROBOTS
from benchmarks.table import ROOT
from hardware.clock import VirtualClock
from retarget.report.plots import DrawnPostures, performer_postures, robot_postures
from retarget.report.solid import lit
from retarget.run.options import RunOptions
from retarget.run.prepare import prepare
from retarget.run.run_result import RunResult
from sim.mock_bus import mock_bus
from sim.performer import synthetic_performer

IMAGE = ROOT / "docs" / "images" / "gallery.webp"
FPS, SECONDS = 10.0, 11.0
"""Of the animation: as long as the performer does each thing once."""
WIDTH, QUALITIES = 720, range(24, 4, -2)
"""Pixels across, and qualities of the compression in percent: the first is taken whose animation is small enough."""
MOST_BYTES = 1_000_000
"""Size of the animation, so that a page with it is there at once."""
SHARPER = 2
"""Pixels drawn to one shown."""
GAP, TITLE = 0.05, 0.15
"""Between bodies and above them, in heights."""


def followed(robot: str) -> RunResult:
    """The run of a robot that follows the synthetic performer."""
    with prepare(synthetic_performer, RunOptions(robot=robot), clock=VirtualClock(), make_bus=mock_bus) as prepared:
        return prepared.run()


def postures() -> dict[str, DrawnPostures]:
    """The performer and each robot, at FPS instants a second."""
    shown: dict[str, DrawnPostures] = {}
    for name, title in ROBOTS.items():
        run = followed(name)
        following = run.record.following
        time = run.record.time[following]
        wanted = time[0] + np.arange(round(SECONDS * FPS)) / FPS
        ticks = (following.start + np.searchsorted(time, wanted)).tolist()
        if not shown:
            shown["performer"] = performer_postures(run, ticks)
        shown[title] = robot_postures(run, ticks)
    return shown


def pictures(shown: dict[str, DrawnPostures]) -> list[Image.Image]:
    """One for each instant, with all bodies side by side on one floor."""
    count = min(len(body.corners) for body in shown.values())
    extents = np.array([[body.extent(pose) for pose in range(count)] for body in shown.values()])
    left, right = extents[..., 0].min(axis=1), extents[..., 1].max(axis=1)
    ends = np.cumsum(right - left + GAP)
    places, floor, top = ends - right, -float(extents[..., 2].min()), float(extents[..., 3].max()) + TITLE
    scale = SHARPER * WIDTH / float(ends[-1])  # pixels to a height
    size = SHARPER * WIDTH, round(scale * (floor + top))
    found = []
    for pose in range(count):
        picture = Image.new("RGB", size, "white")
        draw = ImageDraw.Draw(picture)
        for (title, body), place in zip(shown.items(), places.tolist(), strict=True):
            draw.text((scale * place, 0.0), title, "#555555", anchor="ma", font_size=0.6 * TITLE * scale)
            outlines, shades = lit(body.corners[pose], body.normal[pose], body.colour)
            pixels = scale * np.stack([place + outlines[..., 0], top - outlines[..., 1]], axis=-1)
            corners, colours = pixels.reshape(len(pixels), -1).tolist(), (255 * shades).astype(int).tolist()
            for outline, colour in zip(corners, colours, strict=True):
                draw.polygon(outline, tuple(colour))
        found.append(picture.resize((WIDTH, size[1] // SHARPER), Image.Resampling.LANCZOS))
    return found


def main() -> None:
    """Write the animation. Raises SystemExit where it is too large at every quality."""
    first, *others = pictures(postures())
    for quality in QUALITIES:
        made = BytesIO()
        timing = {"duration": round(1e3 / FPS), "loop": 0}
        first.save(made, "webp", save_all=True, append_images=others, quality=quality, **timing)
        if len(made.getvalue()) <= MOST_BYTES:
            break
    else:
        raise SystemExit(f"the animation has {len(made.getvalue())} bytes, allowed: {MOST_BYTES}. Make it shorter")
    IMAGE.write_bytes(made.getvalue())
    print(f"{IMAGE.relative_to(ROOT)}: {len(others) + 1} pictures, {IMAGE.stat().st_size / 1e6:.2f} MB")


if __name__ == "__main__":
    main()
