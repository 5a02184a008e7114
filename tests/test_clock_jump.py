"""How many odd datagrams make a leap."""

from math import inf

from retarget.live.clock_jump import OddRun

PATIENCE = 0.25


def believed_after(arrivals: list[float], stamps: list[float]) -> int | None:
    """How many it took."""
    run = OddRun()
    for i, (arrival, stamp) in enumerate(zip(arrivals, stamps, strict=True), 1):
        run.note(arrival, stamp, 0.0)
        if run.is_believed(arrival, patience=PATIENCE):
            return i
    return None


def test_three_that_agree_over_ten_ms() -> None:
    assert believed_after([1.0, 1.01, 1.02, 1.03], [5.0, 5.01, 5.02, 5.03]) == 3
    assert believed_after([1.0, 1.004, 1.008, 1.012], [5.0, 5.004, 5.008, 5.012]) == 4


def test_a_backlog_and_a_repeated_frame_tell_nothing() -> None:
    assert believed_after([1.0] * 50, [5.0 + 0.001 * i for i in range(50)]) is None
    assert believed_after([1.0, 1.01, 1.02, 1.03], [5.0] * 4) is None


def test_disagreement_takes_patience() -> None:
    stamps = [5.0 + (-1) ** i * i for i in range(60)]
    assert believed_after([1.0 + 0.01 * i for i in range(60)], stamps) == 26


def test_a_good_one_between_starts_again() -> None:
    run = OddRun()
    for i in range(2):
        run.note(1.0 + 0.01 * i, 5.0 + 0.01 * i, 0.0)
    assert run.least == -4.0
    run.clear()
    assert run.least == inf
    run.note(1.02, 5.02, 0.0)
    assert not run.is_believed(1.02, patience=PATIENCE)
