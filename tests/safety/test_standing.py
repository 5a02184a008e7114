"""The check of soles and balance on the path of a stop."""

import numpy as np
import pytest

from followers import op3
from retarget.ik.support_polygon import Stance, footing, plant
from retarget.ik.whole_body_stop import StopPath
from retarget.safety.standing import BALANCE_M, SOLE_M, StandingCheck
from retarget.types import FloatArray

NOTHING = np.zeros((0, 20))
LEANS = {"l": 0.4, "r": -0.4}
"""rad by which ankles pitch so that the robot leans forward."""


def stance() -> Stance:
    return plant(op3(), op3().profile.postures.stand)


def check() -> StandingCheck:
    return StandingCheck(op3(), stance(), dt=0.008)


def moved(axis: int, by: float) -> FloatArray:
    """The standing posture, the whole robot moved by so many m."""
    q = stance().q.copy()
    q[axis] += by
    return q


def stop(*postures: FloatArray, soles: int = 2) -> StopPath:
    """A stop on so many soles, the left one first."""
    carries = stance().soles[:soles]
    return StopPath(np.array(postures), footing(op3().kinematics, carries) if carries else None)


def holds(path: StopPath, last: FloatArray = NOTHING, standing: FloatArray | None = None) -> bool:
    return check().holds(path, last, stance().q if standing is None else standing)


def test_a_robot_that_stands_holds() -> None:
    lost = check().losses(stop(stance().q))
    assert lost.slip < 1e-9 and lost.shortfall < 0.0
    assert holds(stop(stance().q))


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_soles_may_leave_their_places_by_a_millimetre_on_any_row(axis: int) -> None:
    for by, passes in ((0.9 * SOLE_M, True), (1.1 * SOLE_M, False)):
        assert holds(stop(stance().q, moved(axis, by), stance().q)) == passes
        assert check().losses(stop(moved(axis, by))).slip == pytest.approx(by, rel=1e-3)


def test_a_mass_beyond_the_edge_does_not_hold() -> None:
    assert not holds(stop(moved(0, 0.2)))
    lost, less = check().losses(stop(moved(0, 0.05))), check().losses(stop(moved(0, 0.04)))
    assert lost.shortfall - less.shortfall == pytest.approx(0.01, abs=1e-3)
    inside = BALANCE_M - check().losses(stop(stance().q)).shortfall
    com = op3().kinematics.centre_of_mass(stance().q[None])[0, 0]
    front = max(float(sole.outline[:, 0].max()) for sole in stance().soles)
    assert 0.0 < inside <= front - com + 1e-9


def test_a_mass_that_leans_beyond_the_edge_of_soles_in_place_does_not_hold() -> None:
    stand = op3().profile.postures.stand
    lean = plant(op3(), stand | {f"{side}_ank_pitch": stand[f"{side}_ank_pitch"] + by for side, by in LEANS.items()}).q
    lean[:2] += (stance().soles[0].position - op3().points(lean[None], ("l_sole",))[0, 0])[:2]
    assert check().losses(stop(lean)).slip < SOLE_M and check().losses(stop(lean)).shortfall > 0.0
    assert not holds(stop(lean))


def test_only_soles_that_carry_count() -> None:
    q = stance().q.copy()
    q[op3().servo_columns[op3().joint_map.joints.index("r_knee")]] += 0.3
    assert not holds(stop(q))
    assert check().losses(stop(q, soles=1)).slip < 1e-9
    assert check().losses(stop(q, soles=1)).shortfall > 0.0, "its mass is not over the left sole"
    assert holds(stop(moved(2, 0.3), soles=0)), "in the air it keeps nothing"


def test_what_is_lost_already_may_go_on_if_it_gets_no_worse() -> None:
    far = moved(2, 0.01)
    assert holds(stop(far), standing=far)
    assert not holds(stop(moved(2, 0.0101)), standing=far)
    assert holds(stop(moved(2, 0.0099)), standing=far)


def test_many_small_steps_off_the_ground_do_not_add_up() -> None:
    q, rises = moved(2, SOLE_M), 0
    while rises < 50 and holds(stop(q + np.eye(1, len(q), 2)[0] * 9e-6), standing=q):
        q[2] += 9e-6
        rises += 1
    assert rises < 2


def test_joints_and_postures_are_each_others() -> None:
    rows = np.tile(check().joints(stance().q[None]), (3, 1))
    rows[1:, 4] += 0.1
    there = check().postures(rows, stance().q)
    np.testing.assert_array_equal(check().joints(there), rows)
    np.testing.assert_allclose(there[0], stance().q, atol=1e-9)


# A robot that walks: soles stay where they were put down, the zero-moment point is on those that carry.


def way(*postures: FloatArray, carries: list[tuple[bool, bool]]) -> StopPath:
    return StopPath(np.array(postures), None, np.array(carries))


def leaning_left(angle: float) -> FloatArray:
    """The standing posture with legs that lean by so much, rad, both soles flat where they are."""
    body, stand = op3().body, dict(op3().profile.postures.stand)
    for side in "lr":
        for joint, sign in ((f"{side}_hip_roll", 1.0), (f"{side}_ank_roll", -1.0)):
            stand[joint] = stand.get(joint, 0.0) - sign * angle * float(body.joint_axis[body.joint_index(joint)][0])
    q = plant(op3(), stand).q
    q[:3] += stance().soles[0].position - op3().points(q[None], ("l_sole",))[0, 0]
    return q


def stepping(lift: float, *, aside: float = 0.0, rows: int = 40) -> StopPath:
    """A stand, the right leg lifted by `lift` rad of its knee and put down again, the body moved by `aside` m."""
    knee = op3().servo_columns[op3().joint_map.joints.index("r_knee")]
    postures, carries = [], []
    for row in range(rows + 1):
        share = np.sin(np.pi * row / rows) ** 2
        q = moved(1, aside)
        q[knee] += lift * share
        postures.append(q)
        carries.append((True, row in (0, rows)))
    return way(*postures, carries=carries)


def test_a_lifted_foot_is_no_slip_and_its_weight_has_to_be_on_the_other() -> None:
    lost = check().losses(stepping(-0.5))
    assert lost.slip < 1e-9 and lost.shortfall > 0.0, "the mass is between both feet"
    assert not holds(stepping(-0.5))


def test_a_walk_that_ends_on_one_foot_or_on_none_is_refused() -> None:
    still = stance().q
    assert holds(way(still, still, carries=[(True, True)] * 2))
    for last in ((True, False), (False, True), (False, False)):
        assert not holds(way(still, still, carries=[(True, True), last]))
    assert not holds(way(still, still, still, carries=[(True, True), (False, False), (True, True)]))
    over = leaning_left(0.25)
    assert check().losses(stop(over, soles=1)).shortfall < 0.0, "its mass is over the left sole"
    assert holds(way(over, over, over, carries=[(True, True), (True, False), (True, True)]), standing=over)
    assert not holds(way(over, over, over, carries=[(True, True), (True, False), (True, False)]), standing=over)


def test_a_walk_through_what_is_no_number_is_refused() -> None:
    still, none = stance().q, np.full_like(stance().q, np.nan)
    assert not holds(way(still, none, still, carries=[(True, True)] * 3))


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_a_sole_that_carries_stays_where_it_was_put_down(axis: int) -> None:
    for by, passes in ((0.9 * SOLE_M, True), (1.1 * SOLE_M, False)):
        still, there = stance().q, moved(axis, by)
        path = way(*[still] * 5, *[there] * 5, *[still] * 5, carries=[(True, True)] * 15)
        assert (check().losses(path).slip <= SOLE_M) == passes


def test_a_mass_that_is_thrown_presses_beyond_the_soles() -> None:
    """Its own acceleration moves the zero-moment point by c''/w^2."""
    com = op3().kinematics.centre_of_mass(stance().q[None])[0]
    joint = op3().servo_columns[[op3().joint_map.joints.index(f"{side}_sho_pitch") for side in "lr"]]
    times = np.linspace(0.0, 0.4, 51)
    for size, passes in ((0.05, True), (2.5, False)):
        postures = np.tile(stance().q, (len(times), 1))
        postures[:, joint] += size * np.sin(2.0 * np.pi * times / 0.4)[:, None] * np.array([1.0, -1.0])
        path = way(*postures, carries=[(True, True)] * len(times))
        assert holds(path) == passes, com
