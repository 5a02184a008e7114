"""Performer files: the shipped sensor sets, and what is refused."""

from pathlib import Path

import pytest

from messages import refuses
from retarget.errors import ConfigError
from retarget.frames import SENSORS
from retarget.schema.catalogue import Kind, entries
from retarget.schema.performer import Performer, load_performer

GOOD = "name: mine\ndescription: two\nsensors:\n  head: {joint: head, orientation: true}\n  pelvis: {joint: pelvis}\n"


def load(text: str, folder: Path) -> Performer:
    path = folder / "mine.yaml"
    path.write_text(text, encoding="utf-8")
    return load_performer(path)


def test_five_is_the_default_set() -> None:
    performer = load_performer("five")
    assert tuple(performer.sensors) == SENSORS[:5]
    assert performer.oriented == ()


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


def test_each_shipped_file_bears_its_name() -> None:
    for entry in entries(Kind.PERFORMER):
        if entry.shipped:
            assert load_performer(entry.path).name == entry.name


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
