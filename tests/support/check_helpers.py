"""Robot files with a change."""

import shutil
from pathlib import Path

from retarget.schema.catalogue import shipped_folder

OP3 = shipped_folder() / "robots" / "op3"


def copy_of_op3(folder: Path, *replacements: tuple[str, str]) -> Path:
    folder.mkdir(parents=True, exist_ok=True)
    text = (OP3 / "robot.yaml").read_text(encoding="utf-8")
    for old, new in replacements:
        assert old in text
        text = text.replace(old, new, 1)
    (folder / "robot.yaml").write_text(text, encoding="utf-8")
    shutil.copy(OP3 / "body.xml", folder)
    return folder / "robot.yaml"
