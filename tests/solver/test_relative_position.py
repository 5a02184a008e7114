"""A position that is asked from a point of another link: of the difference of both points, not of either."""

import numpy as np
import pytest

from followers import op3
from retarget._solver import Solver, Task
from retarget.types import FloatArray


def relative(base: int) -> Solver:
    robot = op3()
    body, hand = robot.body, robot.frame("l_hand")
    x, y, z = hand.position.tolist()
    free = np.full(body.nv, np.inf)
    task = Task.position(hand.body, (x, y, z), base=(base, (0.0, 0.0, 0.0)))
    return Solver(
        body.solver_body(),
        [[task]],
        lower=-free,
        upper=free,
        max_velocity=free,
        max_acceleration=free,
        locked=np.zeros(body.nv, dtype=np.bool_),
        n_ik=60,
    )


def test_the_difference_of_two_points_is_led() -> None:
    """Asked from the origin of the torso, which is free to move as well."""
    robot, shoulder = op3(), op3().frame("l_shoulder")
    solver, q = relative(shoulder.body), robot.posture(robot.profile.postures.stand)
    solver.reset(q)

    def apart(posture: FloatArray) -> FloatArray:
        """From the origin of the torso to the hand (3,), m."""
        origin = robot.body.solver_body().points(posture[None], [shoulder.body], np.zeros((1, 3)))[0, 0]
        return np.asarray(robot.points(posture[None], ("l_hand",))[0, 0] - origin)

    wanted = apart(q) + np.array([0.02, 0.01, 0.03])
    after = solver.frame(np.concatenate([[1.0], wanted]), 1.0)
    np.testing.assert_allclose(apart(after), wanted, atol=1e-4)


def test_a_base_that_the_body_does_not_have_is_refused() -> None:
    with pytest.raises(ValueError, match="link"):
        relative(10_000)
