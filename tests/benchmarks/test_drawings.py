"""The pictures of the documentation: drawings are well-formed, say what a command printed, and fit into their pages."""

from pathlib import Path
from xml.etree import ElementTree

from benchmarks.drawings import COLUMNS, axes, terminal

IMAGES = Path(__file__).parents[2] / "docs" / "images"
MOST_BYTES = 1_200_000


def texts(drawing: bytes) -> list[str]:
    return [text for part in ElementTree.fromstring(drawing) if (text := part.text) and part.tag.endswith("text")]


def test_a_terminal_shows_every_word_that_was_printed() -> None:
    printed = f"<{'word ' * 40}&>\nlast"
    shown = texts(terminal({"run --robot op3": printed}))
    assert shown[0] == "$ retarget run --robot op3" and max(map(len, shown)) <= COLUMNS
    assert " ".join(shown[1:]).split() == printed.split()


def test_axes_are_named_as_the_world_has_them() -> None:
    shown = texts(axes())
    assert {"x forward", "y left", "z up", "head", "l_wrist", "r_ankle"} <= {*shown}


def test_pictures_are_small_enough_for_a_page() -> None:
    names = ("report-page", "live-page", "web-page", "view-page", "import", "observer")
    paths = [IMAGES / f"{name}.webp" for name in names] + [
        IMAGES / f"{name}.svg" for name in ("terminal", "wiring", "axes")
    ]
    assert sum(path.stat().st_size for path in paths) <= MOST_BYTES
    for path in paths[len(names) :]:
        drawing = path.read_text(encoding="utf-8")
        assert ElementTree.fromstring(drawing).tag.endswith("svg") and "href" not in drawing, "nothing from elsewhere"
