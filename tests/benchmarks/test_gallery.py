"""The gallery: the performer and each robot side by side, animated; the one that is shown is small enough."""

import pytest
from PIL import Image, ImageSequence

from benchmarks import gallery
from benchmarks.docs_tables import ROBOTS
from retarget.pictures.solid import FPS, pictures
from sim.performer import synthetic_performer

BODIES = 1 + len(ROBOTS)


@pytest.mark.parametrize(("name", "seconds"), [("gallery", gallery.SECONDS), ("walking", gallery.WALK_SECONDS)])
def test_the_picture_that_is_shown_moves_and_is_small(name: str, seconds: float) -> None:
    path = gallery.IMAGES / f"{name}.webp"
    with Image.open(path) as image:
        lasts = 0  # ms; pictures that are the same are one, which is shown for longer
        for frame in ImageSequence.Iterator(image):
            frame.load()
            lasts += frame.info["duration"]
        assert lasts == pytest.approx(1e3 * seconds, abs=2e3 / FPS)
        assert getattr(image, "n_frames", 1) > 0.9 * seconds * FPS, "it moves"
        assert image.width == gallery.WIDTH
    assert path.stat().st_size <= 2e6


@pytest.mark.long
def test_the_performer_and_each_robot_stand_side_by_side() -> None:
    shown = gallery.postures(ROBOTS, lambda: synthetic_performer().cut(0.0, 0.5), 0.3)
    assert len(shown) == BODIES
    first, *others = pictures(shown, width=gallery.WIDTH)
    assert len(others) == 5
    # Columns of pixels below the names: some with a body, and white ones between the bodies.
    floor = (
        first.crop((0, first.height // 4, first.width, first.height))
        .convert("L")
        .point(lambda grey: 255 * (grey < 200))
    )
    filled = [bool(floor.crop((x, 0, x + 1, floor.height)).getbbox()) for x in range(floor.width)]
    assert sum(after and not before for before, after in zip([False, *filled], filled, strict=False)) == BODIES
