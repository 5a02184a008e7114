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


@pytest.mark.parametrize(("typed", "answer"), [("\n", False), ("  \n", False), ("y\n", True), ("what\n\n", False)])
def test_enter_is_no_where_something_would_be_changed(
    typed: str, answer: bool, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("sys.stdin", io.StringIO(typed))
    assert ask("Go on?", enter=False) is answer
    assert capsys.readouterr().out == "Go on? [y/N] " * typed.count("\n")


def test_nobody_there(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.setattr("sys.stdin", io.StringIO(""))
    with pytest.raises(UsageError) as refused:
        ask("Go on?", where="servo home")
    said = "servo home: nobody answers the question: the input has ended. Run it in a terminal."
    assert str(refused.value) == said
    assert capsys.readouterr().out == "Go on? [Y/n] \n"
