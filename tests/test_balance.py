"""Where the centre of mass belongs: over the feet that carry, less so while travelling."""

import pytest

from retarget.balance import LIFT_M, Balance
from retarget.priorities import CentreOfMassTask

TASK = CentreOfMassTask(type="centre_of_mass", mode="over_feet", forward=0.07, fade_speed=0.5)
LEFT, RIGHT = [0.0, 0.1, 0.1], [0.0, -0.1, 0.1]


def test_ahead_of_the_middle_of_the_feet() -> None:
    balance = Balance(TASK)
    balance.step([LEFT, RIGHT], (0.0, 1.0), dt=0.01)
    assert balance.goal[:2] == pytest.approx([0.0, 0.07])
    assert balance.weight == 1.0


def test_over_the_foot_that_stays_down() -> None:
    balance = Balance(TASK)
    balance.step([LEFT, [0.0, -0.1, 0.1 + LIFT_M]], (1.0, 0.0), dt=0.01)
    assert balance.goal[1] == pytest.approx(0.1 / 3.0)
    balance.step([LEFT, [0.0, -0.1, 0.9]], (1.0, 0.0), dt=0.01)
    assert balance.goal[1] == pytest.approx(0.1, abs=0.003)
    balance.step([RIGHT], (1.0, 0.0), dt=0.01)
    assert balance.goal[1] == pytest.approx(-0.1)


@pytest.mark.parametrize("rate", [24.0, 120.0])
def test_fades_with_the_speed_of_travel(rate: float) -> None:
    balance = Balance(TASK)
    for k in range(round(2.0 * rate)):
        x = 0.5 * k / rate
        balance.step([[x, 0.1, 0.1], [x, -0.1, 0.1]], (1.0, 0.0), dt=1.0 / rate)
    assert balance.weight == pytest.approx(0.5, abs=0.01)
    balance.start()
    balance.step([LEFT, RIGHT], (1.0, 0.0), dt=1.0 / rate)
    assert balance.weight == 1.0


def test_without_feet_there_is_no_goal() -> None:
    balance = Balance(TASK)
    balance.step([], (1.0, 0.0), dt=0.01)
    assert balance.weight == 0.0
