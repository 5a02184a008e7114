"""Where a robot stands."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from followers import op3
from retarget import rotations
from retarget.errors import ConfigError
from retarget.ik.support_polygon import check_stand, convex_hull, plant, support_distance, support_edges
from retarget.model.robot import RobotBody, load_robot


def test_a_posture_that_leans_is_put_upright_on_its_soles() -> None:
    angles = dict(op3().profile.postures.stand) | {"l_ank_pitch": 0.6, "r_ank_pitch": -0.6}
    stance = plant(op3(), angles)
    up = rotations.rotate(op3().orientations(stance.q[None], ("l_sole", "r_sole"))[0], np.array([0.0, 0.0, 1.0]))
    assert np.allclose(up, [0.0, 0.0, 1.0], atol=1e-9)
    assert abs(stance.points["l_sole"][2]) < 1e-9


def test_the_corners_of_a_sole_are_its_outline() -> None:
    stance = plant(op3(), op3().profile.postures.stand)
    for sole in stance.soles:
        links = [sole.frame.body] * len(sole.corners)
        corners = op3().body.solver_body().points(stance.q[None], links, sole.corners)[0]
        assert np.allclose(corners[:, :2], sole.outline, atol=1e-9) and np.allclose(corners[:, 2], 0.0, atol=1e-9)


def leaning(degrees: float) -> RobotBody:
    """OP3 that leans forward from its ankles in posture `stand`."""
    robot = load_robot("op3")
    stand = dict(robot.profile.postures.stand)
    for joint, sign in (("l_ank_pitch", 1.0), ("r_ank_pitch", -1.0)):
        stand[joint] = stand.get(joint, 0.0) + sign * np.radians(degrees)
    postures = robot.profile.postures.model_copy(update={"stand": stand})
    return replace(robot, profile=robot.profile.model_copy(update={"postures": postures}))


@pytest.mark.parametrize("name", ["op3", "poppy", "toddlerbot", "wolfgang"])
def test_shipped_robots_stand(name: str) -> None:
    margin = check_stand(load_robot(name))
    assert margin is not None and margin > 0.01


def test_the_message_of_a_stand_that_falls_shows_the_centre_of_mass() -> None:
    margins = [check_stand(leaning(degrees)) for degrees in (0.0, 5.0, 10.0)]
    assert len({round(1e3 * (margin or 0.0)) for margin in margins}) == 3
    worst = max((-30.0, 30.0), key=lambda degrees: degrees if margins[2] < margins[0] else -degrees)  # type: ignore[operator]
    with pytest.raises(ConfigError) as caught:
        check_stand(leaning(worst))
    for text in ("postures.stand", "centre of mass at (", "mm outside the soles", "inside (", "Lean the robot"):
        assert text in str(caught.value)


SQUARE = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
COORDINATES = st.floats(-1.0, 1.0).map(lambda value: round(value, 3))
POINTS = st.lists(st.tuples(COORDINATES, COORDINATES), min_size=6, max_size=20, unique=True).map(np.array)


def area(corners: np.ndarray) -> float:
    x, y = corners[:, 0], corners[:, 1]
    return 0.5 * float(x @ np.roll(y, -1) - y @ np.roll(x, -1))


@given(POINTS)
def test_a_hull_is_counter_clockwise_and_holds_every_point(points: np.ndarray) -> None:
    hull = convex_hull(points)
    if len(hull) > 2 and area(hull) > 1e-3:
        edges = support_edges([points])
        assert np.allclose(np.linalg.norm(edges[:, :2], axis=1), 1.0)
        assert support_distance(points, edges).min() > -1e-9


def test_distance_is_that_to_the_nearest_edge() -> None:
    edges = support_edges([SQUARE])
    points = np.array([[0.5, 0.5, 9.0], [0.9, 0.5, 9.0], [1.2, 0.5, 9.0]])
    assert np.allclose(support_distance(points, edges), [0.5, 0.1, -0.2])
    assert np.allclose(support_distance(points[None], edges), [[0.5, 0.1, -0.2]])
