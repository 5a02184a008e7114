"""No test pins the wording of a message: it asserts kind and facts (`messages`), the snapshot has the words."""

import ast
import re
from collections.abc import Iterator
from pathlib import Path

TESTS = Path(__file__).resolve().parent
LEFT = TESTS / "support" / "wording_left.txt"
"""Phrases that tests still assert: of third parties, of pages and files that are looked into. It may only shrink."""
MOST = 14

WORDS = re.compile(r"[A-Za-z]{2,}[,;:]?(?:\\?[ ])[A-Za-z]{2,}")
"""Two English words in a row."""


def text_of(node: ast.expr) -> str:
    """A literal text, with {} for what is filled in; "" for anything else."""
    if isinstance(node, ast.Constant) and isinstance(node.value, str):
        return node.value
    if isinstance(node, ast.JoinedStr):
        return "".join(part.value if isinstance(part, ast.Constant) else "{}" for part in node.values)  # type: ignore[misc]
    return ""


def phrases(source: str) -> Iterator[str]:
    """Every phrase in a `match=`, and in an `assert ... in ...`."""
    for node in ast.walk(ast.parse(source)):
        texts: list[str] = []
        if isinstance(node, ast.Call):
            texts = [text_of(keyword.value) for keyword in node.keywords if keyword.arg == "match"]
        elif isinstance(node, ast.Assert):
            texts = [
                text_of(part.left)
                for part in ast.walk(node)
                if isinstance(part, ast.Compare) and isinstance(part.ops[0], ast.In | ast.NotIn)
            ]
        yield from (text for text in texts if WORDS.search(text))


def test_no_new_wording_in_tests() -> None:
    allowed = LEFT.read_text(encoding="utf-8").splitlines()
    found = {
        phrase.replace("\n", "\\n"): path.name
        for path in sorted(TESTS.rglob("*.py"))
        if path != Path(__file__).resolve()
        for phrase in phrases(path.read_text(encoding="utf-8"))
    }
    new = {phrase: name for phrase, name in found.items() if phrase not in allowed}
    assert not new, "assert the kind and the facts, with messages"
    gone = [phrase for phrase in allowed if phrase not in found]
    assert not gone, "take them off the list, and lower MOST"
    assert len(allowed) <= MOST, "the list may only shrink"
