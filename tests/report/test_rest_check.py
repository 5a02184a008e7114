"""The last part of the rest trajectory is checked before anything moves."""

from dataclasses import replace

import pytest

from messages import shows
from retarget.model.robot import RobotBody, load_robot
from retarget.report.rest_check import PathToRest, at_rest, path_to_rest
from unknown_robots import SHIPPED as ROBOTS


def resting(robot: RobotBody, **changed: float) -> RobotBody:
    """With other angles in `rest`."""
    postures = robot.profile.postures
    rest = postures.rest | changed
    return replace(
        robot,
        profile=robot.profile.model_copy(update={"postures": postures.model_copy(update={"rest": rest})}),
    )


def found(robot: RobotBody) -> PathToRest:
    path = path_to_rest(robot)
    assert path is not None
    return path


@pytest.mark.parametrize("name", ROBOTS)
def test_every_shipped_robot_goes_straight_to_rest(name: str) -> None:
    path = found(load_robot(name))
    assert path.safe and path.margin > 0.04 and path.distance > 0.002
    assert str(path).startswith("centre of mass ")


def test_limbs_that_meet_on_it_are_named() -> None:
    path = found(resting(load_robot("poppy"), abs_y=0.5))
    assert not path.safe
    assert str(path).startswith("not straight, as limbs meet: ")
    shows(str(path), "l_hip", "0.5", "1.2")


def test_a_robot_that_would_fall_over_on_it_is_named() -> None:
    ankles = {"l_ank_pitch": 0.4, "r_ank_pitch": -0.4}
    path = found(resting(load_robot("op3"), **ankles))
    assert not path.safe and path.margin < 0.0
    assert str(path).startswith("not straight, as it would tip: ")
    shows(str(path), f"{-1000.0 * path.margin:.0f}")


def test_a_robot_that_would_topple_at_rest_is_said_with_its_lowest_part() -> None:
    robot = load_robot("op3")
    assert "topple" not in at_rest(robot)
    leaning = resting(robot, l_ank_pitch=0.4, r_ank_pitch=-0.4)
    shows(at_rest(leaning), "l_hip_roll", "postures.rest")
    assert at_rest(replace(robot, profile=robot.profile.model_copy(update={"root": "fixed"}))) == ""


def test_a_robot_on_a_stand_is_not_looked_at_nor_one_whose_trunk_is_unknown() -> None:
    robot = load_robot("op3")
    frames = {name: frame for name, frame in robot.profile.frames.items() if name != "neck"}
    assert path_to_rest(replace(robot, profile=robot.profile.model_copy(update={"frames": frames}))) is None
    fixed = replace(robot, profile=robot.profile.model_copy(update={"root": "fixed"}))
    assert path_to_rest(fixed) is None
