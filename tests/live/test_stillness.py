"""Frozen sensors: repeating one value is suspect only where the others move."""

import numpy as np
import pytest

from retarget.live.sensor_validity import ValidityLimits, ValidityState, watched_sensors

COUNT = 5
ROWS = np.arange(COUNT)


def found(
    moves: list[int],
    *,
    metres: float = 0.01,
    seconds: float = 1.0,
    turns: bool = True,
    goes: bool = True,
    back: int | None = None,
) -> np.ndarray:
    """Which sensors are frozen, (k,). All move for 0.2 s, then only some do, by `metres` a capture at 100 Hz; `back`
    moves again from 1 s on."""
    watched = watched_sensors(COUNT, ValidityLimits())
    pose = np.tile([0.0, 0.0, 1.0, 1.0, 0.0, 0.0, 0.0], (COUNT, 1))
    frozen = np.zeros(COUNT, dtype=bool)
    for i in range(int(100 * (0.2 + seconds))):
        moving = ROWS if i < 20 else np.array(moves, dtype=int)
        if back is not None and i > 100:
            moving = np.append(moving, back)
        pose[moving, 0] = metres * (i % 10) if goes else 0.0
        pose[moving, 4] = metres * (i % 10) if turns else 0.0
        pose[:, 3] = np.sqrt(1.0 - pose[:, 4] ** 2)
        watched.put(ROWS, 0.01 * i, pose.copy())
        frozen = watched.judge(0.01 * i + 0.005) == ValidityState.FROZEN
    return frozen


@pytest.mark.parametrize("turns", [False, True])
def test_a_sensor_at_rest_while_most_move_is_frozen(turns: bool) -> None:
    assert found([0, 1, 2, 3], turns=turns).tolist() == [False] * 4 + [True]
    assert found([0, 1, 2], turns=turns).tolist() == [False] * 3 + [True] * 2


def test_no_sensor_is_frozen_where_few_move() -> None:
    assert not found([0, 1]).any() and not found([0]).any() and not found([]).any()


def test_no_sensor_is_frozen_where_the_others_only_waver() -> None:
    assert not found([0, 1, 2, 3], metres=0.0002).any()


def test_a_sensor_is_frozen_after_its_time() -> None:
    assert not found([0, 1, 2, 3], seconds=0.17).any() and found([0, 1, 2, 3], seconds=0.23).any()


def test_others_may_move_by_turning_only() -> None:
    assert found([0, 1, 2, 3], goes=False).tolist() == [False] * 4 + [True]


def test_a_sensor_that_moves_again_is_not_frozen_with_the_others() -> None:
    assert found([0, 1, 2]).tolist() == [False] * 3 + [True] * 2
    assert found([0, 1, 2], back=3).tolist() == [False] * 4 + [True]
