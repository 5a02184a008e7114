"""The command line in this process: its exit code, and what it says."""

import shutil
from collections.abc import Callable
from pathlib import Path

import pytest

from retarget.cli import main
from retarget.schema.catalogue import shipped_folder

Typed = Callable[..., str]
"""Takes the words of a command line; what is printed."""


def code_of(*words: object) -> int:
    """The exit code of `retarget WORDS`."""
    with pytest.raises(SystemExit) as left:
        main([str(word) for word in words])
    assert isinstance(left.value.code, int | None)
    return left.value.code or 0


def said_by(capsys: pytest.CaptureFixture[str], *words: object) -> tuple[int, str, str]:
    """Exit code, stdout and stderr of `retarget WORDS`."""
    capsys.readouterr()
    code = code_of(*words)
    out, err = capsys.readouterr()
    return code, out, err


# Robot files with a change.

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
