"""The pictures of the documentation: drawings are well-formed, say what a command printed, and fit into their pages."""

from xml.etree import ElementTree

from benchmarks.drawings import COLUMNS, axes, terminal
from benchmarks.pictures import MOST_BYTES, pictures


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
    assert sum(path.stat().st_size for path in pictures()) <= MOST_BYTES
    drawings = [path for path in pictures() if path.suffix == ".svg"]
    assert drawings
    for path in drawings:
        drawing = path.read_text(encoding="utf-8")
        assert ElementTree.fromstring(drawing).tag.endswith("svg") and "href" not in drawing, "nothing from elsewhere"
