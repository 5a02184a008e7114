"""A question that fails is answered by no, is not asked again, and its failure is not lost."""

from retarget.unfailing import Unfailing
from support.messages import refuses


def test_the_answer_is_that_of_the_question() -> None:
    answers = iter((False, True))
    asked = Unfailing(lambda: next(answers))
    assert (asked(), asked()) == (False, True)
    asked.settle()


def test_from_its_failure_on_it_is_no_and_the_failure_is_raised_in_the_end() -> None:
    count = 0

    def question() -> bool:
        nonlocal count
        count += 1
        if count == 2:
            raise OSError("no such drive")
        return True

    asked = Unfailing(question)
    assert [asked() for _ in range(4)] == [True, False, False, False] and count == 2
    with refuses(OSError):
        asked.settle()
