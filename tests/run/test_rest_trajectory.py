"""The end of a run is planned before it begins: at rest by a way that the gate lets pass, or standing."""

from dataclasses import replace

import pytest

from messages import refuses, shows
from retarget.errors import UsageError
from retarget.ik.hierarchy import SceneObstacles
from retarget.ik.support_polygon import plant
from retarget.model.observers import robot_observers
from retarget.model.robot import RobotBody, load_robot
from retarget.model.scene_state import SceneState
from retarget.run.options import RunOptions
from retarget.run.rest_trajectory import EndPlan, RestTrajectory, at_rest, plan_end, usual_rest_trajectory
from retarget.run.supervisor import End
from retarget.safety.clearance import PathClearance
from retarget.safety.gate import Gate
from retarget.schema.scene import load_scene, on_floor
from sim.buses import topples_at_rest

ROBOTS = ("op3", "poppy", "toddlerbot", "wolfgang")
OPTIONS = RunOptions(robot="op3")


def changed(robot: RobotBody, **postures: object) -> RobotBody:
    """With other postures in its profile."""
    profile = robot.profile
    return replace(robot, profile=profile.model_copy(update={"postures": profile.postures.model_copy(update=postures)}))


def resting(robot: RobotBody, **angles: float) -> RobotBody:
    """With other angles in `rest`."""
    return changed(robot, rest=robot.profile.postures.rest | angles)


def planned(robot: RobotBody, options: RunOptions = OPTIONS, scene: str | None = None) -> EndPlan:
    dt = 1.0 / robot.profile.safety.rate_hz
    obstacles = SceneObstacles(SceneState(on_floor(None if scene is None else load_scene(scene))))
    observers = robot_observers(robot).for_solver(robot.body, obstacles.shapes)
    gate = Gate(robot.joint_map, dt=dt, clearance=PathClearance(robot, observers, obstacles, dt=dt))
    stance = plant(robot, robot.profile.postures.stand)
    return plan_end(robot, stance, gate, replace(options, scene=scene), dt=dt)


def usual(robot: RobotBody) -> RestTrajectory:
    found = usual_rest_trajectory(robot)
    assert found is not None
    return found


@pytest.mark.parametrize("name", ROBOTS)
def test_every_shipped_robot_goes_straight_to_rest(name: str) -> None:
    found = usual(load_robot(name))
    assert found.is_safe and found.margin > 0.03 and found.keyframes == ("rest",)


@pytest.mark.parametrize("name", ["op3", "poppy", "wolfgang"])
@pytest.mark.parametrize("scene", [None, "table", "wall"])
def test_robots_that_stay_at_rest_end_there_beside_table_and_wall(name: str, scene: str | None) -> None:
    assert planned(load_robot(name), scene=scene).end is End.AT_REST


@pytest.mark.long
@pytest.mark.parametrize("name", ROBOTS)
def test_the_profile_says_which_robots_stay_at_rest(name: str) -> None:
    robot = load_robot(name)
    assert (topples_at_rest(robot) is None) is robot.profile.postures.stays_at_rest


def test_a_robot_of_which_nothing_is_known_ends_standing_unless_told_otherwise() -> None:
    robot = load_robot("toddlerbot")
    plan = planned(robot)
    assert plan.end is End.STANDING and "stays_at_rest" in plan.why
    assert planned(robot, replace(OPTIONS, torque_off_at_end=True)).end is End.AT_REST
    stands = planned(load_robot("op3"), replace(OPTIONS, stand_at_end=True))
    assert stands.end is End.STANDING and "--stand-at-end" in stands.why
    with refuses(UsageError, where="--stand-at-end", found="--torque-off-at-end"):
        RunOptions(robot="op3", stand_at_end=True, torque_off_at_end=True)


def test_where_the_way_of_the_profile_is_blocked_another_one_of_its_postures_is_taken() -> None:
    """Before a wall an arm that is held forward does not come down to `stand`; straight to rest it has room."""
    robot = load_robot("op3")
    forward = robot.profile.postures.attractor | {"l_sho_pitch": -1.5}
    by_stand = changed(robot, to_rest=("stand", "rest"), attractor=forward)
    assert planned(by_stand).keyframes == ("stand", "rest")
    plan = planned(by_stand, scene="wall")
    assert (plan.end, plan.keyframes) == (End.AT_REST, ("rest",))


def test_without_a_safe_way_the_run_is_refused_and_says_what_is_in_the_way() -> None:
    reaching = resting(load_robot("poppy"), l_shoulder_y=-1.85, l_elbow_y=-1.3, bust_y=1.15)
    with refuses(UsageError, found="l_forearm and top", next_step="--stand-at-end"):
        planned(reaching, scene="table")
    assert planned(reaching, replace(OPTIONS, stand_at_end=True), "table").end is End.STANDING


def test_limbs_that_meet_on_the_way_are_named() -> None:
    found = usual(resting(load_robot("poppy"), abs_y=0.5, bust_y=1.15))
    assert not found.is_safe and "l_hip" in found.refused and str(found).startswith("straight to rest: ")


def test_a_robot_that_would_fall_over_on_the_way_is_named() -> None:
    robot = load_robot("op3")
    leaning = changed(robot, rest=robot.profile.postures.stand | {"l_ank_pitch": -0.1, "r_ank_pitch": 0.1})
    found = usual(leaning)
    assert not found.is_safe and found.margin < 0.0 and not found.refused
    shows(found, "outside the soles")


def test_a_robot_that_would_topple_at_rest_is_said_with_its_lowest_part() -> None:
    robot = load_robot("op3")
    assert "topple" not in at_rest(robot)
    leaning = at_rest(resting(robot, l_ank_pitch=0.4, r_ank_pitch=-0.4))
    assert "l_hip_roll" in leaning and "postures.rest" in leaning


def test_a_robot_on_a_stand_goes_to_rest_untried() -> None:
    robot = load_robot("op3")
    fixed = replace(robot, profile=robot.profile.model_copy(update={"root": "fixed"}))
    assert usual_rest_trajectory(fixed) is None and at_rest(fixed) == ""
    assert planned(fixed).end is End.AT_REST
