"""One servo's loop in plain floats is the law that the mock bus has for arrays."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sim.emulator.follow import follow
from sim.servo_motion import saturated_lag


@given(
    error=st.floats(-1e5, 1e5),
    lag=st.floats(1e-3, 1.0),
    top=st.floats(1.0, 1e4),
    elapsed=st.floats(0.0, 10.0),
)
def test_it_is_the_same_law(error: float, lag: float, top: float, elapsed: float) -> None:
    left, velocity = follow(error, lag, top, elapsed)
    moved, speed = saturated_lag(np.array([error]), lag=np.array([lag]), top=np.array([top]), elapsed=elapsed)
    assert error - left == pytest.approx(moved[0], abs=1e-6)
    assert velocity == pytest.approx(speed[0], abs=1e-6)
