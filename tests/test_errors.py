"""Errors say what, where, found, allowed and what to do; all problems of one file at once."""

from hardware import errors
from retarget.errors import MAX_SHOWN, ConfigError, InputError, Problem, nearest


def test_one_problem_reads_as_one_line() -> None:
    error = InputError("no frame time", where="walk.bvh:3", found=0, allowed="above 0", next_step="Export it again")
    assert str(error) == "walk.bvh:3: no frame time; found 0; allowed: above 0. Export it again."


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


def test_nearest_names_ignore_case_and_come_best_first() -> None:
    assert nearest("L_Knee", ["r_knee", "l_knee", "head"])[0] == "l_knee"
    assert nearest("zzzz", ["l_knee"]) == ()


# The root of the error tree and its message.


def test_a_message_says_what_where_found_allowed_and_what_next() -> None:
    text = errors.describe(
        what="id out of range", where="robot.yaml:7", found=300, allowed="0 to 252", then="Scan the bus"
    )
    assert text == "robot.yaml:7: id out of range; found 300; allowed: 0 to 252. Scan the bus."


def test_empty_parts_are_left_out() -> None:
    assert errors.describe(what="no servo answers") == "no servo answers."


def test_no_name_acts_on_a_terminal_or_begins_a_line() -> None:
    assert errors.printable("a\x1b[31m\u202eb\r\x9b\udcff é°½\u00a0x\n\tc") == (
        "a\\x1b[31m\\u202eb\\r\\x9b\\udcff é°½\u00a0x\n\tc"
    )
    error = InputError("not a file", where="a\nerror: forged\x1b[2J", found="\x07\t", next_step="Check the path")
    assert str(error) == r"a\nerror: forged\x1b[2J: not a file; found \x07\t. Check the path."
