"""Names once, parents before children, and bones composed into the world."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from retarget.rotations import FloatArray, multiply, normalise, rotate
from retarget.sources.natnet_frame import Owner, PoseGroup
from retarget.sources.natnet_models import BodyDefinition, Definitions, GroupDefinition
from retarget.sources.natnet_names import NameTable
from retarget.sources.natnet_plan import PosePlan, compose_bones, plan_poses

ANN = 5 << 16


def table(*parents: int) -> NameTable:
    """A skeleton whose bone i + 1 has the parent given."""
    bones = tuple(BodyDefinition(f"b{i + 1}", i + 1, parent, (0.0, 0.0, 0.0)) for i, parent in enumerate(parents))
    return NameTable(Definitions(skeletons=(GroupDefinition("Ann", 5, bones),)))


def plan(names: NameTable, *bones: int, limit: int = 256) -> PosePlan:
    return plan_poses(names, (PoseGroup(Owner.SKELETON, 5, len(bones)),), [ANN | bone for bone in bones], limit=limit)


def test_parents_come_before_children_in_whatever_order_they_are_sent() -> None:
    found = plan(table(0, 1, 2, 3), 4, 2, 1, 3)
    assert found.bones == ((1, 2), (3, 1), (0, 3))
    assert found.lost == ()
    assert found.all_defined


def test_bones_without_a_known_chain_are_lost() -> None:
    assert plan(table(0, 1, 2), 3, 1).lost == (0,)
    assert plan(table(2, 3, 1), 1, 2, 3).lost == (0, 1, 2)
    unknown = plan(table(0, 1), 1, 9)
    assert unknown.lost == (1,)
    assert not unknown.all_defined


def test_rigid_bodies_and_assets_have_no_parents() -> None:
    groups = (PoseGroup(Owner.RIGID_BODIES, 0, 1), PoseGroup(Owner.ASSET, 5, 2))
    found = plan_poses(table(0, 1), groups, [1, ANN | 1, ANN | 2], limit=256)
    assert (found.bones, found.lost) == ((), ())


def test_each_name_once_and_no_more_than_the_limit() -> None:
    found = plan(table(0, 1, 1), 1, 2, 2, 3, limit=2)
    assert found.names == ("bone://Ann/b1", "bone://Ann/b2")
    assert found.rows is not None and found.rows.tolist() == [0, 1]
    assert (found.doubled, found.surplus) == (1, 1)
    assert plan(table(0, 1), 1, 2).rows is None


def test_an_unvouched_parent_vouches_for_no_child() -> None:
    found = plan(table(0, 1, 0), 1, 2, 3)
    tracked = np.array([False, True, True])
    compose_bones(found, np.zeros((3, 3)), np.tile([1.0, 0, 0, 0], (3, 1)), tracked)
    assert tracked.tolist() == [False, False, True]


def test_lost_bones_have_no_pose() -> None:
    found = plan(table(0, 1), 1, 9)
    position, orientation, tracked = np.ones((2, 3)), np.tile([1.0, 0, 0, 0], (2, 1)), np.ones(2, bool)
    compose_bones(found, position, orientation, tracked)
    assert np.isfinite(position[0]).all() and np.isnan(position[1]).all() and np.isnan(orientation[1]).all()
    assert tracked.tolist() == [True, False]


@given(st.lists(st.integers(0, 99), min_size=1, max_size=12), st.integers(0, 2**32 - 1))
@settings(max_examples=40)
def test_composed_bones_are_what_matrices_say(choices: list[int], seed: int) -> None:
    """Any tree, any order: each bone stands in its parent as it was sent."""
    count = len(choices)
    parents = [choice % (i + 1) for i, choice in enumerate(choices)]
    rng = np.random.default_rng(seed)
    order = rng.permutation(count) + 1
    found = plan(table(*parents), *order.tolist())
    points, turns = rng.normal(size=(count, 3)), normalise(rng.normal(size=(count, 4)))
    world_points, world_turns, tracked = points.copy(), turns.copy(), np.ones(count, bool)
    compose_bones(found, world_points, world_turns, tracked)
    places = {bone: row for row, bone in enumerate(order.tolist())}
    for bone, parent in enumerate(parents, start=1):
        row = places[bone]
        expected: tuple[FloatArray, FloatArray] = (points[row], turns[row])
        if parent:
            above = places[parent]
            expected = (
                world_points[above] + rotate(world_turns[above], points[row]),
                multiply(world_turns[above], turns[row]),
            )
        np.testing.assert_allclose(world_points[row], expected[0], atol=1e-12)
        np.testing.assert_allclose(world_turns[row], expected[1], atol=1e-12)
