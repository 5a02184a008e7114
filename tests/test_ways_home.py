"""The ways of a robot that stands to where it is parked: straight, and around what is in the way."""

from collections.abc import Callable

import numpy as np
import pytest

from followers import DT, op3
from hardware.guard_state import Stop, StopCause
from retarget.robot_reader import standing_dofs
from retarget.rotations import FloatArray
from retarget.ways_home import ALONE_RAD, HOME_S, LONGEST_HOME_S, NEAR_REST, Way, not_parked, ways_home

TICKS = round(HOME_S / DT)
DOFS = [op3().body.dof_index(joint) for joint in op3().joint_map.joints]
LEGS = standing_dofs(op3())[DOFS]


def angles(name: str) -> FloatArray:
    posture = getattr(op3().profile.postures, name)
    return op3().posture(posture)[op3().servo_columns]


def ways() -> list[Callable[[FloatArray], Way]]:
    return list(ways_home(op3(), dt=DT))


def gone(number: int, here: FloatArray) -> FloatArray:
    """The goals (k, n) of one way from `here` (n,), which is the first row."""
    return np.array([here, *ways()[number](here)])


def test_the_first_leads_straight_to_the_rest_posture_in_time() -> None:
    here = angles("rest") + 0.3
    way = gone(0, here)
    assert np.array_equal(way[-1], angles("rest")) and 10 < len(way) <= TICKS + 1
    share = (way - here) / (angles("rest") - here)
    assert np.ptp(share, axis=1).max() < 1e-9  # straight
    assert len(gone(0, angles("rest"))) == 1  # it is there


@pytest.mark.parametrize(("number", "aside"), [(1, "attractor"), (2, "stand"), (3, "neutral")])
def test_the_next_take_the_arms_aside_first_and_go_by_the_stand(number: int, aside: str) -> None:
    here = angles("stand") + 0.1
    way = gone(number, here)
    assert np.array_equal(way[-1], angles("rest"))
    there = int(np.argmax(np.abs(way - np.where(LEGS, here, angles(aside))).max(axis=1) < 1e-12))
    assert there > 10
    assert not np.abs(way[: there + 1, LEGS] - here[LEGS]).any()  # legs wait
    assert (np.abs(way[there:] - angles("stand")).max(axis=1) < 1e-12).any()


def test_then_one_joint_of_an_arm_goes_first_the_outermost_before_all_others() -> None:
    here = angles("stand") + 0.1
    moved = [np.flatnonzero(next(begin(here)) != here).tolist() for begin in ways()]
    assert all(len(joints) > 1 for joints in moved[:4])
    assert sorted(joint for (joint,) in moved[4:]) == np.flatnonzero(~LEGS).tolist()
    elbows = {op3().joint_map.joints.index(joint) for joint in ("l_el", "r_el")}
    assert {moved[4][0], moved[5][0]} == elbows
    way = gone(4, here)
    alone = here[moved[4][0]] - way[:, moved[4][0]]
    assert np.abs(alone[: np.flatnonzero((way != here).sum(axis=1) > 1)[0]]).max() <= ALONE_RAD + 1e-12
    assert np.array_equal(way[-1], angles("rest"))


@pytest.mark.parametrize("number", [0, 1, 3, 6])
def test_every_way_keeps_the_speeds_of_the_servos_and_ends_in_time(number: int) -> None:
    steps = np.diff(gone(number, angles("stand") + 0.2), axis=0)
    assert (np.abs(steps).max(axis=0) <= op3().joint_map.max_velocity * DT + 1e-12).all()
    assert len(steps) * DT <= 4 * HOME_S < LONGEST_HOME_S


def test_a_robot_that_was_to_be_parked_and_is_not_is_told() -> None:
    rest, stand = angles("rest"), angles("stand")
    assert not_parked(op3(), rest + 0.9 * NEAR_REST, None) == ()
    (told,) = not_parked(op3(), stand, None)
    knees = {op3().joint_map.joints[joint] for joint in np.flatnonzero(np.abs(stand - rest) > 1.5)}
    assert told.startswith("not parked") and any(f"{knee} 1.84 rad" in told for knee in knees)
    assert not_parked(op3(), stand, Stop(StopCause.REQUESTED, "asked", 0.0)) == (told,)
    assert not_parked(op3(), stand, Stop(StopCause.REQUESTED, "insisted", 0.0, then=StopCause.REQUESTED)) == ()
    assert not_parked(op3(), stand, Stop(StopCause.TEMPERATURE, "hot", 0.0)) == (), "it stays, and the reason says so"
