"""Errors say what, where, found, allowed and what to do; all problems of one file at once."""

from hardware.errors import RetargetError
from messages import refuses
from retarget.errors import MAX_SHOWN, ConfigError, InputError, Problem, UsageError, nearest, suggest


def test_one_problem_reads_as_one_line() -> None:
    error = InputError("no frame time", where="walk.bvh:3", found=0, allowed="above 0", next_step="Export it again")
    assert str(error) == "walk.bvh:3: no frame time; found 0; allowed: above 0. Export it again."


def test_empty_parts_leave_no_trace() -> None:
    assert str(UsageError("no source given")) == "no source given."


def test_every_kind_is_a_retarget_error() -> None:
    for kind in (InputError, ConfigError, UsageError):
        assert issubclass(kind, RetargetError)


def test_several_problems_stand_in_the_order_of_the_file() -> None:
    late, early = Problem("late", "f:9", line=9), Problem("early", "f:2", line=2)
    error = ConfigError.from_problems([late, early], title="f: 2 problems")
    assert str(error).splitlines() == ["f: 2 problems", "  f:2: early.", "  f:9: late."]
    assert error.problems == (early, late)


def test_a_flood_of_problems_is_counted_not_printed() -> None:
    error = ConfigError.from_problems([Problem(f"p{i}", line=i) for i in range(MAX_SHOWN + 5)])
    assert len(str(error).splitlines()) == MAX_SHOWN + 2
    assert str(error).endswith("... and 5 more.")
    assert len(error.problems) == MAX_SHOWN + 5


def test_an_error_needs_a_problem() -> None:
    with refuses(ValueError):
        ConfigError.from_problems([])


def test_nearest_names_ignore_case_and_come_best_first() -> None:
    assert nearest("L_Knee", ["r_knee", "l_knee", "head"])[0] == "l_knee"
    assert nearest("zzzz", ["l_knee"]) == ()


def test_suggestion_is_a_question_or_nothing() -> None:
    assert suggest("haed", ["head", "pelvis"]) == "Did you mean head?"
    assert suggest("qqqq", ["head"]) == ""
