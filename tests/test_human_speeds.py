"""How fast a human may move."""

import numpy as np

from retarget.human import build_human
from retarget.human_dimensions import proportional_dimensions
from retarget.human_speeds import human_limits


def test_every_degree_of_freedom_has_a_speed_and_no_acceleration_limit() -> None:
    body = build_human(proportional_dimensions(1.7)).body
    limits = human_limits(body)
    assert ((limits.max_velocity >= 10.0) & (limits.max_velocity <= 30.0)).all()
    assert np.isinf(limits.max_acceleration).all()
    assert (limits.lower == body.lower).all() and (limits.upper == body.upper).all()
