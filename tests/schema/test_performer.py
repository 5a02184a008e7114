"""Performer files: the shipped sensor sets, and what is refused."""

from pathlib import Path

import pytest

from messages import refuses
from retarget.errors import ConfigError
from retarget.frames import SENSORS
from retarget.schema.performer import Performer, load_performer

GOOD = "name: mine\ndescription: two\nsensors:\n  head: {joint: head, orientation: true}\n  pelvis: {joint: pelvis}\n"


def load(text: str, folder: Path) -> Performer:
    path = folder / "mine.yaml"
    path.write_text(text, encoding="utf-8")
    return load_performer(path)


@pytest.mark.parametrize(
    ("name", "count", "oriented"),
    [
        ("three", 3, ("head", "l_wrist", "r_wrist")),
        ("five_head", 5, ("head",)),
        ("six", 6, ()),
        ("ten", 10, ()),
        ("all", len(SENSORS), ()),
    ],
)
def test_shipped_sets(name: str, count: int, oriented: tuple[str, ...]) -> None:
    performer = load_performer(name)
    assert len(performer.sensors) == count
    assert performer.oriented == oriented


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("  pelvis:", "  pelvic:"),
        ("joint: pelvis", "joint: pelvic"),
        ("joint: pelvis", "joint: head"),
        ("orientation: true", "orientation: on"),
        ("orientation:", "oriented:"),
        ("name: mine", "name: my own"),
        ("description: two\n", ""),
        (GOOD[GOOD.index("sensors:") :], "sensors: {}\n"),
    ],
)
def test_refused_with_its_place(tmp_path: Path, old: str, new: str) -> None:
    assert load(GOOD, tmp_path).oriented == ("head",)
    with refuses(ConfigError, "mine.yaml"):
        load(GOOD.replace(old, new, 1), tmp_path)
