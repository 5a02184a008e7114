"""Messages in tests: facts are found, wording is pinned, and what no test meets any more is reported."""

from pathlib import Path

import pytest

from messages import (
    difference,
    read_snapshot,
    refuses,
    stale_entries,
    write_all,
)
from retarget.errors import InputError, Problem

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


def test_no_error_is_a_failure() -> None:
    with pytest.raises(pytest.fail.Exception), refuses(InputError):
        pass


def test_what_differs_is_shown() -> None:
    assert difference(["a", "b c"], ["a", "b c"]) == ""
    assert difference(["a", "b c"], ["a", "b d"]).splitlines()[:2] == ["message 2:", "- b c"]
    assert "- b" in difference(["a", "b"], ["a"]) and "+ b" in difference(["a"], ["a", "b"])


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
