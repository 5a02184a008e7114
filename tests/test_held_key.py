"""A key that is held, as its repeats tell."""

from hypothesis import given, settings
from hypothesis import strategies as st

from retarget.cli.held_key import LET_GO_S, NEEDED, HeldKey

DT = 0.01


def typed(times: list[float], until: float) -> list[bool]:
    """Whether it is held at every tick, of a key that comes at these times, s."""
    key, waiting = HeldKey("b"), sorted(times)
    found = []
    for tick in range(round(until / DT)):
        now = DT * tick
        came = "".join("b" for time in waiting if time <= now)
        waiting = [time for time in waiting if time > now]
        found.append(key.held(came, now))
    return found


def test_held_from_its_repeats_on_and_soon_let_go() -> None:
    times = [0.0, *(0.5 + 0.033 * n for n in range(31))]
    held = typed(times, 3.0)
    first, last = held.index(True), len(held) - 1 - held[::-1].index(True)
    assert 0.5 < DT * first < 0.65 and all(held[first : last + 1])
    assert times[-1] < DT * last <= times[-1] + LET_GO_S + DT


def test_a_tap_and_a_pasted_text_are_not_held() -> None:
    assert not any(typed([0.0, 0.4, 0.8, 1.2, 1.6], 2.0))
    assert not HeldKey("b").held("b" * 50, 0.0)
    assert not HeldKey("b").held("xyz", 0.0)


def test_another_key_lets_go_and_a_long_pasted_text_is_not_held() -> None:
    """A text comes in pieces of 64 characters, look after look, and most of them have the letter in them."""
    key = HeldKey("b")
    assert [key.held("b", 0.05 * look) for look in range(5)] == [False, False, False, True, True]
    assert not key.held("x", 0.25) and not key.held("b", 0.3) and not key.held("", 0.31)
    for look in range(20):
        assert not key.held("a robber grabbed a bob", 1.0 + DT * look)


def test_slow_keyboards_repeat_too() -> None:
    assert any(typed([0.09 * n for n in range(10)], 1.0))


@settings(max_examples=60)
@given(st.lists(st.floats(0.0, 3.0), max_size=40))
def test_never_held_without_repeats_just_before(times: list[float]) -> None:
    for tick, held in enumerate(typed(times, 3.5)):
        if held:
            now = DT * tick
            recent = [time for time in times if now - LET_GO_S - DT <= time <= now]
            assert recent and sum(time <= now for time in times) >= NEEDED
