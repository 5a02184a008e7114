"""The compiled arcs against the general functions."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from messages import refuses
from retarget import rotations
from retarget._solver import along_arc

ANGLES = st.one_of(st.floats(0.0, 3.1), st.sampled_from([0.0, 1e-12, 1e-9, 1e-8, 1e-7, 1e-5, 1e-3, 3.14159]))


@settings(max_examples=60)
@given(st.integers(0, 2**32 - 1), ANGLES, st.sampled_from([-1.0, 1.0]))
def test_they_are_slerp(seed: int, angle: float, sign: float) -> None:
    rng = np.random.default_rng(seed)
    a = rotations.normalise(rng.normal(size=(5, 4)))
    axis = rng.normal(size=(5, 3))
    turn = angle * axis / np.linalg.norm(axis, axis=1, keepdims=True)
    b = sign * rotations.multiply(rotations.from_rotation_vector(turn), a)
    for share in (0.0, 0.3, 1.0):
        found = along_arc(a, b, np.full(5, share))
        assert np.abs(found - rotations.slerp(a, b, share)).max() < 1e-8
        assert np.abs(np.linalg.norm(found, axis=1) - 1.0).max() < 1e-10
    if angle < 0.5:
        beyond = rotations.multiply(rotations.from_rotation_vector(3.0 * turn), a)
        assert rotations.angle_between(along_arc(a, b, np.full(5, 3.0)), beyond).max() < 1e-7


def test_what_is_missing_stays_missing() -> None:
    a = np.array([[1.0, 0.0, 0.0, 0.0], [np.nan] * 4])
    assert np.isnan(along_arc(a, a, np.ones(2))).any(axis=1).tolist() == [False, True]


def test_bad_shapes_are_refused() -> None:
    a = np.tile([1.0, 0.0, 0.0, 0.0], (2, 1))
    with refuses(ValueError):
        along_arc(a, a[:1], np.ones(2))
