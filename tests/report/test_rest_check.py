"""The last part of the way to where a robot is parked is looked at before anything moves."""

from dataclasses import replace

import pytest

from messages import shows
from physics_robots_helpers import ROBOTS
from retarget.model.robot import RobotBody, load_robot
from retarget.report.rest_check import PathToRest, path_to_rest


def resting(robot: RobotBody, **changed: float) -> RobotBody:
    """With other angles in `rest`."""
    postures = robot.profile.postures
    rest = postures.rest | changed
    return replace(
        robot,
        profile=robot.profile.model_copy(update={"postures": postures.model_copy(update={"rest": rest})}),
    )


def found(robot: RobotBody) -> PathToRest:
    way = path_to_rest(robot)
    assert way is not None
    return way


@pytest.mark.parametrize("name", ROBOTS)
def test_every_shipped_robot_goes_straight_to_rest(name: str) -> None:
    way = found(load_robot(name))
    assert way.sound and way.margin > 0.04 and way.distance > 0.002
    assert str(way).startswith("centre of mass ")


def test_limbs_that_meet_on_the_way_are_named() -> None:
    way = found(resting(load_robot("poppy"), abs_y=0.5))
    assert not way.sound
    assert str(way).startswith("not straight, as limbs meet: ")
    shows(str(way), "l_hip", "0.5", "1.2")


def test_a_robot_that_would_fall_over_on_the_way_is_told() -> None:
    ankles = {"l_ank_pitch": 0.4, "r_ank_pitch": -0.4}
    way = found(resting(load_robot("op3"), **ankles))
    assert not way.sound and way.margin < 0.0
    assert str(way).startswith("not straight, as it would tip: ")
    shows(str(way), f"{-1000.0 * way.margin:.0f}")


def test_a_robot_on_a_stand_is_not_looked_at_nor_one_whose_trunk_is_unknown() -> None:
    robot = load_robot("op3")
    frames = {name: frame for name, frame in robot.profile.frames.items() if name != "neck"}
    assert path_to_rest(replace(robot, profile=robot.profile.model_copy(update={"frames": frames}))) is None
    fixed = replace(robot, profile=robot.profile.model_copy(update={"root": "fixed"}))
    assert path_to_rest(fixed) is None
