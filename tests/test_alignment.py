"""The stream's world in ours: floor, origin, heading; and a turn while running that moves nobody."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from retarget import rotations
from retarget.errors import InputError
from retarget.live.alignment import Alignment, align
from support.messages import refuses

NAMES = ("head", "l_wrist", "r_wrist", "l_ankle", "r_ankle")
STANDING = np.array([[0.0, 0.0, 1.62], [0.02, 0.25, 0.8], [0.02, -0.25, 0.8], [0.0, 0.1, 0.07], [0.0, -0.1, 0.07]])
ANGLES = st.floats(-np.pi, np.pi)
PLACES = st.tuples(st.floats(-5, 5), st.floats(-5, 5), st.floats(-1, 1))


@settings(max_examples=60)
@given(ANGLES, PLACES)
def test_whoever_stands_faces_x_on_the_floor(yaw: float, place: tuple[float, float, float]) -> None:
    turn = rotations.from_axis_angle([0.0, 0.0, 1.0], yaw)
    told = rotations.rotate(turn, STANDING) + np.array(place)
    found = align(NAMES, told)
    ours = found.positions(told)
    np.testing.assert_allclose(ours[:, :2], STANDING[:, :2], atol=1e-9)
    np.testing.assert_allclose(ours[3, 2], 0.07, atol=0.01)
    assert rotations.angle_between(found.orientations(turn), rotations.IDENTITY) < 1e-7


def test_without_ankles_the_stream_s_floor_is_believed() -> None:
    told = STANDING.copy()
    told[3:] = np.nan
    assert align(NAMES, told).origin[2] == 0.0


def test_left_and_right_in_one_place_tell_nothing() -> None:
    told = STANDING.copy()
    told[:, 1] = 0.0
    with refuses(InputError):
        align(NAMES, told, where="vmc://:39539")


@settings(max_examples=60)
@given(ANGLES, PLACES, ANGLES, PLACES)
def test_a_turn_keeps_its_centre(
    yaw: float, origin: tuple[float, float, float], turn: float, about: tuple[float, float, float]
) -> None:
    before = Alignment(yaw, np.array(origin))
    after = before.turned(turn, np.array(about))
    told = np.array([[0.3, -0.2, 1.0], [1.0, 2.0, 0.0]])
    ours, centre = before.positions(told), np.array([about[0], about[1], 0.0])
    spun = rotations.rotate(rotations.from_axis_angle([0.0, 0.0, 1.0], turn), ours - centre) + centre
    np.testing.assert_allclose(after.positions(told), spun, atol=1e-9)
    q = rotations.from_axis_angle([0.0, 1.0, 0.0], 0.4)
    expected = rotations.multiply(rotations.from_axis_angle([0.0, 0.0, 1.0], turn), before.orientations(q))
    assert rotations.angle_between(after.orientations(q), expected) < 1e-7
