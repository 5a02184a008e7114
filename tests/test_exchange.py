"""Two sensors have changed places, or two hands have met."""

import numpy as np

from retarget.live.exchange import exchanged, taken_over

DT, LEAST = 0.01, 0.08
LEFT, RIGHT = [0.0, 0.12, 0.1], [0.0, -0.12, 0.1]
_Point = list[float]


def test_those_who_stand_where_the_other_stood_have() -> None:
    was = (LEFT, RIGHT)
    assert exchanged(was, was, (RIGHT, LEFT), DT, LEAST)
    assert not exchanged(was, was, was, DT, LEAST)


def test_both_must_have() -> None:
    was = (LEFT, RIGHT)
    assert not exchanged(was, was, (RIGHT, RIGHT), DT, LEAST)
    assert not exchanged(was, was, (LEFT, LEFT), DT, LEAST)
    assert not exchanged(was, was, (RIGHT, [0.5, 0.12, 0.1]), DT, LEAST)


def test_those_who_are_too_near_are_not_told_apart() -> None:
    was = ([0.0, 0.03, 1.0], [0.0, -0.03, 1.0])
    assert not exchanged(was, was, (was[1], was[0]), DT, LEAST)


def test_hands_that_clap_and_rebound_have_not() -> None:
    """At 5 m/s each, told at 60 Hz: due behind each other, they are back on their own sides."""
    was = ([0.0, 0.02, 1.0], [0.0, -0.02, 1.0])
    due = ([0.0, -0.063, 1.0], [0.0, 0.063, 1.0])
    for back in (0.0, 0.02, 0.05, 0.08):
        now = ([0.0, 0.02 + back, 1.0], [0.0, -0.02 - back, 1.0])
        assert not exchanged(was, due, now, 1.0 / 60.0, LEAST)


def test_after_a_gap_more_is_allowed() -> None:
    was = ([0.0, 0.1, 1.0], [0.0, -0.1, 1.0])
    assert exchanged(was, was, (was[1], was[0]), 0.01, LEAST)
    assert not exchanged(was, was, (was[1], was[0]), 0.1, LEAST)
    far = ([0.0, 0.3, 1.0], [0.0, -0.3, 1.0])
    assert exchanged(far, far, (far[1], far[0]), 1.0, LEAST)


def test_it_does_not_matter_where_in_the_room() -> None:
    random = np.random.default_rng(0)
    for _ in range(50):
        turn, _ = np.linalg.qr(random.normal(size=(3, 3)))
        one, other = (list(turn @ point + 3.0) for point in (np.array(LEFT), np.array(RIGHT)))
        assert exchanged((one, other), (one, other), (other, one), DT, LEAST)


def test_one_that_goes_on_where_the_other_was_took_its_place() -> None:
    took = [taken_over((LEFT, RIGHT), [0.0, y, 0.1], (0.1, DT), least=LEAST, calm=0.06) for y in (-0.12, -0.15, 0.0)]
    assert took == [False] * 3  # a hard movement would do
    far = ([0.0, 0.3, 1.0], [0.0, -0.3, 1.0])
    at = {y: taken_over(far, [0.0, y, 1.0], (0.1, DT), least=LEAST, calm=0.06) for y in (-0.3, -0.26, -0.2, 0.3)}
    assert at == {-0.3: True, -0.26: True, -0.2: False, 0.3: False}
    assert taken_over(far, [0.0, -0.2, 1.0], (0.1, 0.1), least=LEAST, calm=0.06)  # told seldom
