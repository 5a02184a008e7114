"""docs/dynamixel.md: the models that it names are those that there are, with their protocols."""

import re
from pathlib import Path

from hardware.servo import SERVO_MODELS

PAGE = Path(__file__).resolve().parent.parent / "docs" / "dynamixel.md"


def test_every_model_stands_with_its_protocol() -> None:
    text = " ".join(PAGE.read_text(encoding="utf-8").split())
    start = text.index("Models by name")
    listed = text[start : text.index("Others can be scanned", start)]
    names = "|".join(map(re.escape, sorted(SERVO_MODELS, key=len, reverse=True)))
    parts = re.split(r"with (?:protocol )?(?=[12]\.0)", listed)[1:]
    found = {
        name: tuple(sorted(map(int, re.findall(r"\b([12])\.0", part))))
        for part in parts
        for name in re.findall(names, part)
    }
    assert found == {name: model.protocols for name, model in SERVO_MODELS.items()}
