"""Where a cycle ends: once for each look at the servos, however often people ask between."""

from hypothesis import given
from hypothesis import strategies as st

from retarget.recording.boundary import Boundary


def test_a_cycle_holds_one_look() -> None:
    turns: list[str] = []
    boundary = Boundary(lambda: turns.append("turn"))
    boundary.before()
    assert turns == []  # nothing happened yet
    boundary.look()
    boundary.before()
    boundary.before()
    assert turns == ["turn"]
    boundary.look()
    boundary.look()
    assert turns == ["turn", "turn"]


@given(st.lists(st.booleans(), max_size=40))
def test_there_are_as_many_cycles_as_looks(looks: list[bool]) -> None:
    turns: list[int] = []
    boundary = Boundary(lambda: turns.append(1))
    for look in looks:
        (boundary.look if look else boundary.before)()
    boundary.before()
    assert len(turns) == sum(looks)
