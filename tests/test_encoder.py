"""How a 2.0 servo counts its position: folding, offset, direction."""

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hardware.dynamixel.control_table import find_table
from sim.emulator.encoder import REVERSE, TURN, Encoder
from sim.emulator.motion import Shaft
from sim.emulator.registers import Memory
from sim.emulator.rules import EXTENDED, POSITION

positions = st.floats(-1e6, 1e6)
offsets = st.integers(-1_044_479, 1_044_479)


class Counted:
    """A shaft, and the registers that say how it is counted."""

    def __init__(self, mode: int, position: float = 0.0, offset: int = 0) -> None:
        self.memory = Memory(find_table("XM430-W350", 2))
        self.memory.put("max_position_limit", 4095)
        self.shaft = Shaft(position, 1000.0)
        self.encoder = Encoder(self.memory, self.shaft)
        self.set(operating_mode=mode, homing_offset=offset)
        self.encoder.place(position)

    def set(self, **values: int) -> None:
        for name, value in values.items():
            self.memory.put(name, value)

    def follow(self, **values: int) -> float:
        """The position as it is counted with new registers."""
        self.set(**values)
        self.encoder.follow_settings()
        return self.shaft.position


@settings(max_examples=60)
@given(mode=st.sampled_from((POSITION, EXTENDED)), position=positions, offset=offsets)
def test_folding_takes_whole_turns_and_only_once(mode: int, position: float, offset: int) -> None:
    one = Counted(mode, position, offset)
    one.encoder.fold()
    honoured = 0 if mode == POSITION and abs(offset) > 1024 else offset
    assert 0.0 <= one.shaft.position - honoured <= TURN
    turns = (one.shaft.position - position) / TURN
    assert turns == pytest.approx(round(turns), abs=1e-6)
    folded = one.shaft.position
    one.encoder.fold()
    assert (one.shaft.position - folded) % TURN == pytest.approx(0.0, abs=1e-6)


@settings(max_examples=60)
@given(position=positions, moves=st.lists(offsets, min_size=1, max_size=6), offset=offsets)
def test_an_offset_shifts_the_count_and_never_the_shaft(position: float, moves: list[int], offset: int) -> None:
    one = Counted(EXTENDED, position, offset)
    for move in moves:
        assert one.follow(homing_offset=move) - move == pytest.approx(position - offset, abs=1e-6)


@settings(max_examples=60)
@given(position=positions, offset=offsets)
def test_reverse_mode_mirrors_about_the_offset_and_twice_is_never(position: float, offset: int) -> None:
    one = Counted(EXTENDED, position, offset)
    assert one.follow(drive_mode=REVERSE) - offset == pytest.approx(offset - position, abs=1e-6)
    assert one.encoder.reversed
    assert one.follow() == one.follow(drive_mode=REVERSE)  # nothing new, nothing done
    assert one.follow(drive_mode=0) == pytest.approx(position, abs=1e-6)
    assert not one.encoder.reversed


@pytest.mark.parametrize(
    ("mode", "offset", "honoured"),
    [(POSITION, 1024, 1024), (POSITION, -1025, 0), (EXTENDED, -1025, -1025), (EXTENDED, 40000, 40000)],
)
def test_an_offset_out_of_reach_is_ignored_in_position_mode(mode: int, offset: int, honoured: int) -> None:
    assert Counted(mode, 2000.0).follow(homing_offset=offset) == 2000 + honoured


@settings(max_examples=60)
@given(turns=st.integers(-200, 200), place=st.integers(0, TURN - 1), ahead=st.integers(-300, 300))
def test_clearing_turns_takes_the_goal_along(turns: int, place: int, ahead: int) -> None:
    one = Counted(EXTENDED, float(turns * TURN + place))
    one.set(goal_position=turns * TURN + place + ahead)
    one.encoder.clear_turns()
    assert one.shaft.position == place
    assert one.memory.value("goal_position") == place + ahead


def test_a_goal_that_goes_along_stays_within_its_limits() -> None:
    one = Counted(POSITION, float(TURN + 100))
    one.set(goal_position=50)
    one.encoder.clear_turns()
    assert one.shaft.position == 100 and one.memory.value("goal_position") == 0
