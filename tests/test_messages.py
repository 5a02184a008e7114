"""Messages in tests: facts are found, wording is pinned, and what no test meets any more is reported."""

import re
from pathlib import Path

import pytest

from messages import (
    Book,
    difference,
    mentions,
    read_snapshot,
    refuses,
    shows,
    shows_lines,
    stale,
    stale_entries,
    write_all,
    write_snapshot,
)
from retarget.errors import InputError, Problem, UsageError

TWO = {"test_a::test_b[x y]": ["one", "two\n\n  lines"], "test_a::test_c": [""]}


def test_every_pinned_message_has_its_test() -> None:
    assert stale_entries() == [], "run pytest --update-messages"


def test_a_refusal_has_its_kind_and_its_facts() -> None:
    with refuses(InputError, "walk.bvh", 3, where="walk.bvh:3", found=("x", 30), allowed="y") as caught:
        raise InputError("no number", where="walk.bvh:3", found="x, 30", allowed="y")
    assert caught.value.problems[0].found == "x, 30"


@pytest.mark.parametrize("facts", [{"found": "z"}, {"found": "x", "allowed": "x"}, {"next_step": 4}])
def test_facts_are_those_of_one_problem(facts: dict[str, str | int]) -> None:
    two = InputError.from_problems([Problem("a", found="x", allowed="y"), Problem("b", found="y", allowed="x")])
    with pytest.raises(AssertionError), refuses(InputError, **facts):
        raise two


def test_another_kind_passes_through() -> None:
    with pytest.raises(UsageError), refuses(InputError):
        raise UsageError("x")


def test_no_error_is_a_failure() -> None:
    with pytest.raises(pytest.fail.Exception), refuses(InputError):
        pass


@pytest.mark.parametrize(
    ("text", "fact", "held"),
    [
        ("30 Hz", 3, False),
        ("3 Hz", 3, True),
        ("1.3", 3, False),
        ("3.1", 3, False),
        ("at 3.", 3, True),
        ("j3", 3, False),
        ("0.25 s", 0.25, True),
        ("4.0 rad", 4.0, True),
        ("4 rad", 4.0, True),
        ("-3", -3, True),
        ("l_wrist", "wrist", True),
        ("/a/b: x", Path("/a/b"), True),
        ("row 12", re.compile(r"row \d+"), True),
        ("row x", re.compile(r"row \d+"), False),
    ],
)
def test_facts(text: str, fact: str | int | float | Path | re.Pattern[str], held: bool) -> None:
    if held:
        mentions(text, (fact,), fact)
    else:
        with pytest.raises(AssertionError):
            mentions(text, fact)


def test_texts_and_lines_are_pinned() -> None:
    shows(["one", "two 2", "12.5 ms    1.25"], 2, 12.5)
    shows_lines("kept 1\nleft 0x7f0000000000\nkept 2", "kept")
    with pytest.raises(AssertionError):
        shows_lines("a 1\nb 2", "a", 2)


def test_what_differs_from_run_to_run_is_not_pinned(tmp_path: Path) -> None:
    shows(
        f"{tmp_path / 'a.bvh'}: a.b:40123, port 40124, port 39539, 0x7f00aa00bb00, 2026-01-31 12:00:01, 71 s", varies=71
    )


def test_a_snapshot_is_read_as_it_was_written() -> None:
    assert read_snapshot(write_snapshot(TWO)) == TWO


def test_what_differs_is_shown() -> None:
    assert difference(["a", "b c"], ["a", "b c"]) == ""
    assert difference(["a", "b c"], ["a", "b d"]).splitlines()[:2] == ["message 2:", "- b c"]
    assert "- b" in difference(["a", "b"], ["a"]) and "+ b" in difference(["a"], ["a", "b"])


def test_gone_tests_and_cases_are_stale() -> None:
    functions = {"test_a::test_b", "test_a::test_c"}
    assert stale(TWO, functions) == []
    assert stale(TWO, {"test_a::test_b"}) == ["test_a::test_c"]
    assert stale(TWO, functions, ["test_a::test_b[z]"]) == ["test_a::test_b[x y]"]


def test_the_update_replaces_what_ran_and_moves_what_moved(tmp_path: Path) -> None:
    pinned = {"old": dict(TWO), "gone": {"test_a::test_d": ["x"]}}
    write_all(
        pinned,
        {"new": {"test_a::test_c": ["three"]}, "old": {"test_e::test_f": []}},
        gone=["test_a::test_d"],
        folder=tmp_path,
    )
    read = {path.stem: read_snapshot(path.read_text()) for path in tmp_path.iterdir()}
    assert read == {"old": {"test_a::test_b[x y]": TWO["test_a::test_b[x y]"]}, "new": {"test_a::test_c": ["three"]}}


def test_a_moved_test_keeps_its_messages() -> None:
    book = Book(pinned={"old": dict(TWO)})
    assert book.pinned_for("new", "test_a::test_c") == [""]
    assert book.pinned_for("new", "test_a::test_x") == []
