"""A robot that stands is parked, once, and stays where something is in the way."""

import numpy as np

from followers import DT, op3
from retarget.way_home import WayHome

TICKS = 312


def test_it_leads_to_the_rest_posture_in_time() -> None:
    robot, home = op3(), WayHome(op3(), dt=DT)
    rest = robot.posture(robot.profile.postures.rest)[robot.servo_columns]
    here = start = rest + 0.3
    for ticks in range(TICKS + 1):
        assert home.begun == (ticks > 0)
        goal = home.next(here, passed=True, ticks=TICKS)
        if goal is None:
            break
        here = goal
    assert np.array_equal(here, rest) and 10 < ticks <= TICKS
    assert home.next(start, passed=True, ticks=TICKS) is None


def test_it_ends_where_a_goal_was_not_sent() -> None:
    home = WayHome(op3(), dt=DT)
    here = np.zeros(20)
    assert home.next(here, passed=False, ticks=TICKS) is not None
    assert home.next(here, passed=True, ticks=TICKS) is not None
    assert home.next(here, passed=False, ticks=TICKS) is None
    assert home.next(here, passed=True, ticks=TICKS) is None
