"""Questions to a person."""

import io

import pytest

from retarget.cli.ask import ask
from retarget.errors import UsageError


@pytest.mark.parametrize(
    ("typed", "answer"),
    [
        ("\n", True),
        ("y\n", True),
        (" YES \n", True),
        ("n\n", False),
        ("No\n", False),
        ("maybe\n\n", True),
        ("n", False),
    ],
)
def test_enter_is_yes_and_anything_strange_is_asked_again(
    typed: str, answer: bool, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("sys.stdin", io.StringIO(typed))
    assert ask("Go on?") is answer
    assert capsys.readouterr().out == "Go on? [Y/n] " * max(1, typed.count("\n"))


def test_nobody_there(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("sys.stdin", io.StringIO(""))
    with pytest.raises(UsageError, match=r"nobody answers.*Go on\?"):
        ask("Go on?")
