"""The troubleshooting page quotes what the tool prints: every message of its first columns is in the sources."""

import ast
import re
from functools import cache
from itertools import pairwise
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent
PAGE = (ROOT / "docs/troubleshooting.md").read_text(encoding="utf-8")
COMMAND = re.compile(r"retarget |-|[A-Z_]+$|Ctrl|[\w./]+\.(?:png|py)$")
"""What stands in backquotes and is typed, named or pressed, not said."""
VARIABLE = re.compile(
    r"^(?:fix|note|ok) [\w ]+:|\b[A-Z]{2,}\b|\.\.\.|[;:()\"]|, allowed|\bfound\b|\d[\w.]*|'[^']*'|\w+_\w+|/\S+"
)
"""What differs from message to message: names, numbers, paths, and the heads of a doctor's lines."""
WINDOW = 3
"""Words in a row that must be found together; names and numbers between them differ."""


@cache
def said() -> str:
    """Every text of the sources, with one blank between words; a formatted part is a blank too."""
    texts = []
    for folder in ("retarget", "hardware", "sim"):
        for path in sorted((ROOT / folder).rglob("*.py")):
            for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
                if isinstance(node, ast.JoinedStr):
                    texts.append(
                        "".join(str(one.value) if isinstance(one, ast.Constant) else " " for one in node.values)
                    )
                elif isinstance(node, ast.Constant) and isinstance(node.value, str):
                    texts.append(node.value)
    table = (ROOT / "retarget/setup/doctor.yaml").read_text(encoding="utf-8")
    texts += [re.sub(r"\{[^}]*\}", " ", line) for line in re.findall(r'"([^"]+)"', table)]
    return "\n".join(" ".join(re.findall(r"[\w'-]+", text.lower())) for text in texts)


def quoted() -> list[str]:
    """The messages of the first columns, and of the bold lines, without those that are typed."""
    found = []
    for line in PAGE.splitlines():
        cell = line.split(" | ")[0] if line.startswith("| ") else line.split("**")[1] if line.startswith("**") else ""
        found += [text for text in re.findall(r"`([^`]+)`", cell) if not COMMAND.match(text)]
    return found


def parts(message: str) -> list[list[str]]:
    """The words of a message, parted where something else may stand."""
    pieces = VARIABLE.split(message)
    return [words for piece in pieces if len(words := re.findall(r"[\w'-]+", piece.lower())) >= WINDOW]


@pytest.mark.parametrize("message", quoted())
def test_what_is_quoted_is_said(message: str) -> None:
    for words in parts(message):
        windows = [" ".join(words[i : i + WINDOW]) for i in range(len(words) - WINDOW + 1)]
        found = sum(window in said() for window in windows)
        assert 2 * found >= len(windows), " ".join(words)


def test_enough_is_quoted_for_this_to_be_a_check() -> None:
    assert sum(bool(parts(message)) for message in quoted()) > 55
    assert "nothing arrives waited" in said() and "nothing ever arrived here" not in said()


def test_every_section_is_in_the_table_of_symptoms() -> None:
    table = PAGE.split("\n## ")[0]
    for heading in re.findall(r"^## (.+)$", PAGE, re.MULTILINE):
        anchor = re.sub(r"[^\w -]", "", heading.lower()).replace(" ", "-")
        assert f"](#{anchor})" in table, heading


def test_rows_have_as_many_cells_as_their_table() -> None:
    for above, below in pairwise(PAGE.splitlines()):
        if above.startswith("|") and below.startswith("|"):
            assert above.replace("\\|", "").count("|") == below.replace("\\|", "").count("|"), below
