"""The heading of a performer: slow, and untouched by bending."""

import numpy as np

from retarget.facing import SETTLE_S, Facing
from retarget.scalar_rotations import axis_turn, product

DT = 0.008
AHEAD = (0.1, 0.0, -0.02)


def turned(angle: float) -> tuple[float, float, float]:
    return (0.1 * np.cos(angle), 0.1 * np.sin(angle), 0.0)


def yaw(heading: tuple[float, float]) -> float:
    return float(np.arctan2(heading[1], heading[0]))


def test_the_first_posture_is_taken_as_it_is() -> None:
    pelvis = axis_turn((0.0, 0.0, 1.0), 1.0)
    assert abs(yaw(Facing().update(pelvis, turned(1.0), turned(1.0), DT)) - 1.0) < 1e-9


def test_bending_does_not_turn_it() -> None:
    for lean in (0.5, 1.5, 2.0):
        pelvis = product(axis_turn((0.0, 0.0, 1.0), 0.7), axis_turn((0.0, 1.0, 0.0), lean))
        assert abs(yaw(Facing().update(pelvis, turned(0.7), turned(0.7), DT)) - 0.7) < 1e-9


def test_a_quick_twist_hardly_turns_it_and_a_new_stance_does() -> None:
    facing, straight = Facing(), axis_turn((0.0, 0.0, 1.0), 0.0)
    facing.update(straight, AHEAD, AHEAD, DT)
    twist = axis_turn((0.0, 0.0, 1.0), 0.8)
    for _ in range(int(0.2 / DT)):
        heading = facing.update(twist, AHEAD, AHEAD, DT)
    assert 0.0 < yaw(heading) < 0.1
    for _ in range(int(8.0 * SETTLE_S / DT)):
        heading = facing.update(twist, turned(0.8), turned(0.8), DT)
    assert abs(yaw(heading) - 0.8) < 0.01


def test_directions_that_disagree_hold_it() -> None:
    facing, straight = Facing(), axis_turn((0.0, 0.0, 1.0), 0.0)
    facing.update(straight, AHEAD, AHEAD, DT)
    back = (-0.1, 0.0, 0.0)
    for _ in range(1000):
        heading = facing.update(straight, back, back, DT)
    assert heading == (1.0, 0.0)


def test_what_is_not_finite_takes_no_part() -> None:
    nan = float("nan")
    assert Facing().update(axis_turn((0.0, 0.0, 1.0), 0.3), (nan, nan, nan), turned(0.3), DT)[0] > 0.9


def test_a_restart_forgets() -> None:
    facing = Facing()
    facing.update(axis_turn((0.0, 0.0, 1.0), 0.0), AHEAD, AHEAD, DT)
    facing.restart()
    assert abs(yaw(facing.update(axis_turn((0.0, 0.0, 1.0), 2.0), turned(2.0), turned(2.0), DT)) - 2.0) < 1e-9
