"""Chained poses against the array functions, velocities against finite differences."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from retarget import rotations
from retarget.scalar_rotations import product, turn
from retarget.scene_poses import MovingPose, Pose, carried_by, on_body, unit

PARENT = Pose((1.0, -2.0, 0.5), turn((0.3, -1.0, 2.0)))
CHILD = Pose((0.2, 0.4, -0.1), turn((1.0, 0.5, -0.2)))


def test_inside_is_the_product_of_transforms() -> None:
    both = PARENT.inside(CHILD)
    assert_allclose(both.position, PARENT.position + rotations.rotate(PARENT.quat, CHILD.position), atol=1e-15)
    assert_allclose(both.quat, rotations.multiply(PARENT.quat, CHILD.quat), atol=1e-15)


def test_velocities_are_derivatives() -> None:
    linear, angular, h = (0.3, -0.2, 0.7), (1.0, -2.0, 0.4), 1e-6

    def seen(time: float) -> MovingPose:
        x, y, z = (CHILD.position[i] + time * linear[i] for i in range(3))
        spun = product(turn((time * angular[0], time * angular[1], time * angular[2])), CHILD.quat)
        return on_body(carried_by(PARENT, MovingPose(Pose((x, y, z), spun), linear, angular)), Pose((0.5, 0.1, -0.3)))

    now, before, after = seen(0.0), seen(-h), seen(h)
    rate = (np.array(after.pose.position) - before.pose.position) / (2 * h)
    assert_allclose(rate, now.linear, atol=1e-8)
    spin = rotations.log(rotations.multiply(after.pose.quat, rotations.conjugate(before.pose.quat))) / (2 * h)
    assert_allclose(spin, now.angular, atol=1e-8)


def test_unit() -> None:
    assert unit((0.0, 3.0, 0.0, -4.0)) == pytest.approx((0.0, 0.6, 0.0, -0.8))
