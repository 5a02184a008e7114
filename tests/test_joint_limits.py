"""Limits per degree of freedom, as bodies hand them to the solver."""

from dataclasses import FrozenInstanceError

import numpy as np
import pytest

from followers import op3
from retarget.joint_limits import JointLimits


def test_limits_are_per_degree_of_freedom() -> None:
    limits = op3().limits
    assert isinstance(limits, JointLimits)
    assert all((part >= 0.0).all() for part in (limits.max_velocity, limits.max_acceleration))
    assert (limits.lower <= limits.upper).all()


def test_limits_do_not_change() -> None:
    nothing = np.zeros(2)
    limits = JointLimits(lower=nothing, upper=nothing, max_velocity=nothing, max_acceleration=nothing)
    with pytest.raises(FrozenInstanceError):
        limits.lower = np.ones(2)  # type: ignore[misc]
