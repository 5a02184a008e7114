"""A robot that stands is parked: straight, or around what is in the way; and stays where there is no way."""

import numpy as np
import pytest

from followers import DT, op3
from hardware.guard_state import Stop, StopCause
from retarget.robot_reader import standing_dofs
from retarget.rotations import FloatArray
from retarget.way_home import HOME_S, LONGEST_HOME_S, NEAR_REST, WayHome, not_parked

TICKS = round(HOME_S / DT)
DOFS = [op3().body.dof_index(joint) for joint in op3().joint_map.joints]
LEGS = standing_dofs(op3())[DOFS]


def angles(name: str) -> FloatArray:
    posture = getattr(op3().profile.postures, name)
    return op3().posture(posture)[op3().servo_columns]


def gone(home: WayHome, here: FloatArray) -> list[FloatArray]:
    """Where it leads from where a goal was refused, or from the start, nothing else being in the way."""
    way = [here]
    goal = home.next(here, passed=False, stands=True)
    while goal is not None:
        way.append(goal)
        goal = home.next(goal, passed=True, stands=False)
    return way


def test_it_begins_when_it_is_asked() -> None:
    assert not WayHome(op3(), dt=DT).begun


def test_it_leads_to_the_rest_posture_in_time() -> None:
    home = WayHome(op3(), dt=DT)
    way = gone(home, angles("rest") + 0.3)
    assert home.begun
    assert np.array_equal(way[-1], angles("rest")) and 10 < len(way) <= TICKS + 1
    assert home.next(way[-1], passed=False, stands=True) is None  # and nobody sets off again


def test_where_something_is_in_the_way_it_stands_and_then_takes_the_arms_aside_first() -> None:
    home, here = WayHome(op3(), dt=DT), angles("stand") + 0.1
    first = home.next(here, passed=True, stands=True)
    assert first is not None
    assert home.next(first, passed=False, stands=False) is None  # refused: it brakes
    assert home.next(first, passed=False, stands=False) is None
    way = np.array(gone(home, first))
    assert np.array_equal(way[-1], angles("rest"))
    aside = int(np.argmax(np.abs(way - np.where(LEGS, first, angles("attractor"))).max(axis=1) < 1e-12))
    assert aside > 10
    assert not np.abs(way[: aside + 1, LEGS] - first[LEGS]).any()  # legs wait
    assert (np.abs(way - angles("stand")).max(axis=1) < 1e-12).any()  # and all of it goes by `stand`


def test_the_fourth_try_goes_by_neutral_then_joint_by_joint_and_then_it_stays() -> None:
    home, here = WayHome(op3(), dt=DT), angles("stand") + 0.1
    for _ in range(3):
        goal = home.next(here, passed=False, stands=True)
        assert goal is not None
        here = goal
    way = np.array(gone(home, here))
    assert np.array_equal(way[-1], angles("rest"))
    assert (np.abs(way[:, ~LEGS] - angles("neutral")[~LEGS]).max(axis=1) < 1e-12).any()

    blocked, moved = WayHome(op3(), dt=DT), []
    while (goal := blocked.next(here, passed=False, stands=True)) is not None:
        moved.append(np.flatnonzero(goal != here).tolist())
    free = np.flatnonzero(~LEGS)
    assert all(len(joints) > 1 for joints in moved[:4])
    assert sorted(joint for (joint,) in moved[4:]) == free.tolist()
    elbows = {op3().joint_map.joints.index(joint) for joint in ("l_el", "r_el")}
    assert {moved[4][0], moved[5][0]} == elbows
    assert blocked.next(here, passed=False, stands=True) is None


@pytest.mark.parametrize("refused", [0, 1, 3])
def test_every_try_keeps_the_speeds_of_the_servos_and_ends_in_time(refused: int) -> None:
    home, here = WayHome(op3(), dt=DT), angles("stand") + 0.2
    for _ in range(refused):
        goal = home.next(here, passed=False, stands=True)
        assert goal is not None
        here = goal
    steps = np.diff(np.array(gone(home, here)), axis=0)
    assert (np.abs(steps).max(axis=0) <= op3().joint_map.max_velocity * DT + 1e-12).all()
    assert len(steps) * DT <= LONGEST_HOME_S


def test_a_try_that_is_refused_where_the_robot_stands_is_followed_by_the_next() -> None:
    """Nothing moves then, and who asked would take the way for gone."""
    here, asked = angles("stand") + 0.1, []

    def passes(goal: FloatArray) -> bool:
        asked.append(goal)
        return len(asked) > 6

    home = WayHome(op3(), dt=DT, passes=passes)
    goal = home.next(here, passed=False, stands=True)
    assert goal is not None and len(asked) == 7
    assert np.count_nonzero(goal != here) == 1  # the third joint alone

    blocked = WayHome(op3(), dt=DT, passes=lambda goal: False)
    assert blocked.next(here, passed=False, stands=True) is None


def test_a_robot_that_was_to_be_parked_and_is_not_is_told() -> None:
    rest, stand = angles("rest"), angles("stand")
    assert not_parked(op3(), rest + 0.9 * NEAR_REST, None) == ()
    (told,) = not_parked(op3(), stand, None)
    knees = {op3().joint_map.joints[joint] for joint in np.flatnonzero(np.abs(stand - rest) > 1.5)}
    assert told.startswith("not parked") and any(f"{knee} 1.55 rad" in told for knee in knees)
    assert not_parked(op3(), stand, Stop(StopCause.REQUESTED, "asked", 0.0)) == (told,)
    assert not_parked(op3(), stand, Stop(StopCause.REQUESTED, "insisted", 0.0, then=StopCause.REQUESTED)) == ()
    assert not_parked(op3(), stand, Stop(StopCause.TEMPERATURE, "hot", 0.0)) == (), "it stays, and the reason says so"
