"""Lines from a pipe, in whatever pieces they come; a file or nothing at all is not waited for."""

import os
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from retarget.cli.typed_lines import TypedLines


@pytest.fixture
def pipe(monkeypatch: pytest.MonkeyPatch) -> Iterator[int]:
    """The end that somebody types into."""
    out, into = os.pipe()
    with os.fdopen(out) as stdin:
        monkeypatch.setattr(sys, "stdin", stdin)
        yield into


def test_lines_come_whole(pipe: int) -> None:
    heard: list[str] = []
    typed = TypedLines(heard.append)
    for piece in (b"miss", b"ing 5\ncle", b"ar\n\xff\n", b"rest"):
        os.write(pipe, piece)
        assert typed.read()
    assert heard == ["missing 5", "clear", "\ufffd"]
    os.close(pipe)
    assert not typed.read()
    assert heard[3:] == ["rest"]


def test_an_endless_line_costs_no_memory(pipe: int) -> None:
    typed = TypedLines(lambda line: None)
    for _ in range(50):
        os.write(pipe, b"x" * 4096)
        typed.read()
    assert len(typed._pending) <= 4096
    os.close(pipe)


def test_only_a_pipe_or_a_terminal_is_waited_for(pipe: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    os.close(pipe)
    assert TypedLines.descriptor() is not None
    path = tmp_path / "lines"
    path.write_text("missing 5\n")
    with path.open() as stream:
        monkeypatch.setattr(sys, "stdin", stream)
        assert TypedLines.descriptor() is None
    monkeypatch.setattr(sys, "stdin", None)
    assert TypedLines.descriptor() is None
