"""Whether a robot can stand where its profile says that it stands."""

from dataclasses import replace

import numpy as np
import pytest

from retarget.errors import ConfigError
from retarget.robot_body import RobotBody, load_robot
from retarget.standing import check_stand


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


def test_who_leans_too_far_is_told_where_the_centre_of_mass_is() -> None:
    margins = [check_stand(leaning(degrees)) for degrees in (0.0, 5.0, 10.0)]
    assert len({round(1e3 * (margin or 0.0)) for margin in margins}) == 3
    worst = max((-30.0, 30.0), key=lambda degrees: degrees if margins[2] < margins[0] else -degrees)  # type: ignore[operator]
    with pytest.raises(ConfigError) as caught:
        check_stand(leaning(worst))
    for text in ("postures.stand", "centre of mass at (", "mm outside the soles", "inside (", "Lean the robot"):
        assert text in str(caught.value)


def test_what_does_not_stand_is_not_asked() -> None:
    assert check_stand(load_robot("op3", root="fixed")) is None
