"""Findings as lines."""

from retarget.doctor.finding import Level, mend, mend_all, note, ok
from retarget.errors import Problem


def test_a_line_for_each() -> None:
    assert ok("rate", "100 frames/s").render() == "ok   rate: 100 frames/s"
    assert note("clock", "coarse").render() == "note clock: coarse"
    assert mend("port", "taken", "Stop it").render() == "mend port: taken. Stop it."
    assert mend("port", "taken", "Who?").render().endswith("Who?")


def test_a_senders_words_cannot_move_the_cursor() -> None:
    assert mend("sensors", "tells \x1b[2Jx\n\r", "No").render() == "mend sensors: tells ?[2Jx??. No."


def test_problems_of_a_refusal() -> None:
    found = mend_all("port", [Problem("taken", next_step="Stop it"), Problem("also")])
    assert [finding.level for finding in found] == [Level.MEND, Level.MEND]
    assert found[0].what == "taken. Stop it."
