"""What was bad must be good for long enough."""

from retarget.live.lasting import Lasting


def test_what_was_bad_must_be_good_for_so_long_without_a_gap() -> None:
    lasting = Lasting(0.5)
    assert [lasting.step(t, good=True) for t in (0.0, 0.3, 0.5, 0.6)] == [False, False, True, True]
    assert [lasting.step(t, good=good) for t, good in ((0.7, False), (0.8, True), (1.2, False), (1.6, True))] == [
        False
    ] * 4
    assert lasting.step(2.1, good=True)
    lasting.restart()
    assert not lasting.step(2.2, good=True)


def test_what_was_good_until_now_needs_no_time() -> None:
    lasting = Lasting(0.5, good=True)
    assert lasting.step(0.0, good=True) and not lasting.step(0.1, good=False) and not lasting.step(0.2, good=True)
