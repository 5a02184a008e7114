"""Joint trees and their forward kinematics."""

import numpy as np

from retarget import rotations
from retarget.sources.tree import JointTree, forward_kinematics

TREE = JointTree(
    names=("root", "arm", "hand", "leg"),
    parents=(-1, 0, 1, 0),
    offsets=np.array([[0.0, 0, 0], [1, 0, 0], [0, 2, 0], [0, 0, -1]]),
    ends=((), (), (np.array([0.0, 0, 3]),), ()),
)


def test_paths_children_and_rest() -> None:
    assert TREE.path(2) == [0, 1, 2] and TREE.path(0) == [0]
    assert TREE.children(0) == [1, 3] and TREE.children(2) == []
    np.testing.assert_array_equal(TREE.rest_positions(), [[0, 0, 0], [1, 0, 0], [1, 2, 0], [0, 0, -1]])


def test_forward_kinematics_is_the_product_of_transforms() -> None:
    generator = np.random.default_rng(0)
    local = rotations.normalise(generator.normal(size=(5, 4, 4)))
    translation = np.broadcast_to(TREE.offsets, (5, 4, 3)).copy()
    translation[:, 0] = generator.normal(size=(5, 3))
    pose = forward_kinematics(TREE, local, translation)
    for frame in range(5):
        matrices = np.zeros((4, 4, 4))
        matrices[:, :3, :3] = rotations.to_matrix(local[frame])
        matrices[:, :3, 3] = translation[frame]
        matrices[:, 3, 3] = 1.0
        hand = matrices[0] @ matrices[1] @ matrices[2]
        np.testing.assert_allclose(pose.position[frame, 2], hand[:3, 3], atol=1e-12)
        np.testing.assert_allclose(rotations.to_matrix(pose.orientation[frame, 2]), hand[:3, :3], atol=1e-12)
        tip = pose.point(2, TREE.ends[2][0])[frame]
        np.testing.assert_allclose(tip, (hand @ [0, 0, 3, 1])[:3], atol=1e-12)


def test_constant_offsets_serve_every_frame() -> None:
    local = np.broadcast_to(rotations.IDENTITY, (3, 4, 4))
    pose = forward_kinematics(TREE, local, TREE.offsets)
    np.testing.assert_array_equal(pose.position, np.broadcast_to(TREE.rest_positions(), (3, 4, 3)))
