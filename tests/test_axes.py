"""Up, left and forward of a motion file."""

import numpy as np
import pytest

from retarget.rotations import FloatArray
from retarget.sources.axes import Axes, rest_axes, world_axes
from support.messages import shows


def body(up: FloatArray, left: FloatArray) -> dict[str, FloatArray]:
    """A person of 1.7 with that up and left."""
    return {
        "head": 0.7 * up,
        **{f"{s}_hip": 0.1 * sign * left - 0.1 * up for s, sign in (("l", 1), ("r", -1))},
        **{f"{s}_shoulder": 0.2 * sign * left + 0.4 * up for s, sign in (("l", 1), ("r", -1))},
        **{f"{s}_ankle": 0.1 * sign * left - 0.9 * up for s, sign in (("l", 1), ("r", -1))},
    }


def test_world_axes_keep_the_cyclic_order_of_the_file() -> None:
    eye = np.eye(3)
    np.testing.assert_array_equal(Axes.with_up(eye[2]).matrix(), eye)
    np.testing.assert_array_equal(Axes.with_up(eye[1]).matrix(), [[0, 0, 1], [1, 0, 0], [0, 1, 0]])
    for up in (*eye, *-eye):
        matrix = Axes.with_up(up).matrix()
        assert np.linalg.det(matrix) == pytest.approx(1.0)
        np.testing.assert_array_equal(matrix @ up, [0, 0, 1])


def test_the_rest_pose_tells_all_24_ways_to_stand() -> None:
    directions = [*np.eye(3), *-np.eye(3)]
    for up in directions:
        for left in directions:
            if up @ left:
                continue
            axes = rest_axes(body(up, left))
            assert axes is not None
            np.testing.assert_array_equal(axes.matrix() @ np.stack([np.cross(left, up), left, up], axis=1), np.eye(3))


def test_a_heap_of_joints_has_no_axes() -> None:
    eye = np.eye(3)
    assert rest_axes({name: np.zeros(3) for name in body(eye[2], eye[1])}) is None
    assert rest_axes({name: at * [0, 0, 1] for name, at in body(eye[2], eye[1]).items()}) is None
    assert rest_axes({name: at * np.nan for name, at in body(eye[2], eye[1]).items()}) is None


def test_frames_overrule_the_rest_pose_only_when_they_stand_near_the_ground() -> None:
    eye = np.eye(3)
    rest = rest_axes(body(eye[1], eye[0]))
    assert rest is not None
    standing = {name: np.tile(at + 0.95 * eye[2], (5, 1)) for name, at in body(eye[2], eye[0]).items()}
    axes, notes = world_axes(rest, standing)
    np.testing.assert_array_equal(axes.up, eye[2])
    shows(notes[0])
    far = {name: at + 7.0 * eye[2] for name, at in standing.items()}
    lying_or_upright = ({name: np.tile(at + 0.95 * eye[1], (5, 1)) for name, at in body(eye[1], eye[0]).items()}, far)
    for tracks in lying_or_upright:
        axes, notes = world_axes(rest, tracks)
        np.testing.assert_array_equal(axes.up, eye[1])
        assert notes == ()
