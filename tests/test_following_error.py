"""A servo that lags is where it was sent a moment ago; one that is elsewhere is off its way."""

import numpy as np

from retarget.following_error import REMEMBERED_S, FollowingError

DT = 0.008
TICK = np.array([0.0015, -0.0015])


def test_lag_is_explained_and_the_rest_is_not() -> None:
    following = FollowingError(TICK, dt=DT)
    following.seed(np.zeros(2))
    for k in range(10):
        following.sent(np.array([0.02 * k, -0.02 * k]))
    assert following.unexplained(np.array([0.1, -0.1])).tolist() == [0.0, 0.0]
    assert following.unexplained(np.array([0.182, 0.002])).tolist() == [0.0, 0.0]  # rounding
    np.testing.assert_allclose(following.unexplained(np.array([0.2, 0.02])), [0.017, 0.017])


def test_what_was_long_ago_explains_nothing() -> None:
    following = FollowingError(TICK, dt=DT)
    following.seed(np.full(2, 1.0))
    for _ in range(round(REMEMBERED_S / DT)):
        assert not following.unexplained(np.full(2, 1.0)).any()
        following.sent(np.zeros(2))
    assert following.unexplained(np.full(2, 1.0)).all()
