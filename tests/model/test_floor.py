"""The floor: an obstacle of everything but soles, for every robot on its feet, in its stage and in the gate."""

from dataclasses import replace

import numpy as np
import pytest

import followers
from gated_robot import GatedRobot
from messages import refuses
from physics_rig import PhysicsRig, op3, ticks
from retarget.errors import ConfigError, UsageError
from retarget.ik.support_polygon import plant
from retarget.model.observers import Observers, robot_observers
from retarget.model.robot import RobotBody, load_robot
from retarget.model.scene_state import SceneState
from retarget.report.clearance import place_body
from retarget.robot.follower import Follower
from retarget.safety.clearance import refuse_floor
from retarget.schema.priorities import load_priorities
from retarget.schema.profile_parts import Observer
from retarget.schema.scene import FLOOR, Scene, on_floor
from retarget.types import FloatArray

ROBOTS = ("op3", "poppy", "toddlerbot", "wolfgang")


def scene(**obstacles: object) -> Scene:
    return Scene.model_validate({"name": "a", "description": "b", "obstacles": obstacles})


def heights(robot: RobotBody, q: FloatArray) -> float:
    """Least height (m) of the robot's own geoms, soles' links aside, over the floor, by MuJoCo."""
    placed = place_body(robot.profile.body_path, q, root=robot.profile.root)
    soles = [robot.body.body_names[sole.body] for sole in robot.soles]
    found = placed.to_ground(SceneState(on_floor(None)), np.zeros(len(q)), soles=soles)
    assert found.smallest is not None
    return found.smallest


def looks_down(observers: Observers) -> set[str]:
    """Observers that look at the floor."""
    pairs, _ = observers.obstacle_pairs(SceneState(on_floor(None)).shapes)
    return {observers.names[row] for row in pairs[:, 0]}


@pytest.mark.parametrize("name", ROBOTS)
def test_all_but_soles_look_at_it_and_keep_less_than_they_have_at_home(name: str) -> None:
    robot = load_robot(name)
    observers = robot_observers(robot)
    feet = {sole.body for sole in robot.soles}
    on_soles = {n for n, link in zip(observers.names, observers.links.tolist(), strict=True) if link in feet}
    assert on_soles and looks_down(observers) == set(observers.names) - on_soles
    kept = observers.ground_margin[~observers.stands]
    lowest = heights(robot, np.array([plant(robot, robot.profile.postures.rest).q]))
    assert 0.0 < kept.min() <= lowest


def test_a_robot_that_is_held_knows_no_floor() -> None:
    observers = robot_observers(load_robot("op3", root="fixed"))
    assert not observers.stands.any() and np.isinf(observers.ground_margin).all()


def test_a_part_below_the_soles_is_refused() -> None:
    """A stick that hangs from the torso in front of the feet, 0.1 m too long."""
    robot = load_robot("op3")
    stick = {
        "link": "body_link",
        "shape": {"capsule": {"from": [0.3, 0, 0], "to": [0.3, 0, -0.37], "radius": 0.005}},
        "influence": 0.05,
        "margin": 0.004,
    }
    observers = {**robot.profile.observers, "stick": Observer.model_validate(stick)}
    profile = robot.profile.model_copy(update={"observers": observers})
    with refuses(ConfigError, "stick", "103.0"):
        robot_observers(replace(robot, profile=profile))


@pytest.mark.parametrize("name", ROBOTS)
def test_hands_that_are_asked_below_it_stay_above(name: str) -> None:
    """A performer who crouches and digs: both wrists go 0.3 m below their feet."""
    robot = load_robot(name)
    performer = followers.performer()
    follower = Follower(
        robot, load_priorities("servo"), followers.dimensions(performer), scene=SceneState(on_floor(None))
    )
    motion = followers.postures(performer)[:300]
    follower.start(motion[0])
    sent = []
    for human in motion:
        joints = human.joints.copy()
        for wrist in ("l_wrist", "r_wrist"):
            joints[human.joint_names.index(wrist), 2] = -0.3
        sent.append(follower.step(replace(human, joints=joints), followers.DT).q)
    q = np.array(sent)
    hands = robot.points(q, ("l_hand", "r_hand"))[..., 2]
    assert hands.min() < 0.75 * hands[0].min()  # they did go down
    assert heights(robot, q) > 0.0


def test_the_gate_refuses_a_hand_in_the_floor() -> None:
    """A deep squat with an arm that hangs straight down."""
    robot, bare = GatedRobot(SceneState(on_floor(None))), GatedRobot()
    arm = {"l_sho_pitch": 0.0, "l_sho_roll": 1.4, "l_el": 0.0}
    low = robot.robot.profile.postures.rest | arm | {"l_hip_pitch": -1.5, "r_hip_pitch": 1.5}
    down = robot.robot.posture(low)[robot.robot.servo_columns] - robot.sent
    path = robot.sent + np.linspace(0.0, 1.0, 40)[:, None] * down
    assert heights(robot.robot, robot.standing(path)) < 0.0
    stay = path[:1].repeat(len(path), axis=0)
    assert bare.clearance(np.ascontiguousarray(path), stay) and not robot.clearance(np.ascontiguousarray(path), stay)


def test_a_scene_may_bring_its_own_floor_and_others_stay() -> None:
    low = {"shape": {"half_space": {"point": [0, 0, -0.1], "normal": [0, 0, 1]}}, "ground": True}
    ball = {"shape": {"sphere": {"radius": 0.1}}, "at": {"pos": [1, 0, 1]}}
    whole = on_floor(scene(floor=low, ball=ball))
    assert set(whole.obstacles) == {FLOOR, "ball"}
    at = SceneState(whole).at_rest(0.0).position[list(whole.obstacles).index(FLOOR)]
    assert at[2] == pytest.approx(-0.1)


def test_what_is_under_the_soles_has_to_be_ground() -> None:
    robot = load_robot("op3")
    q, observers = plant(robot, robot.profile.postures.stand).q, robot_observers(robot)
    plate = {"shape": {"box": {"size": [0.2, 0.2, 0.01]}}, "at": {"pos": [0, 0, -0.01]}}
    with refuses(UsageError, "plate", "ground: true"):
        refuse_floor(robot, observers, SceneState(on_floor(scene(plate=plate))), q)
    refuse_floor(robot, observers, SceneState(on_floor(scene(plate={**plate, "ground": True}))), q)


def test_a_simulated_hand_on_the_floor_is_no_fall_and_is_counted() -> None:
    """A squat whose left hand is 3 mm in the floor at first, held for 0.3 s."""
    arm = {"l_sho_pitch": 0.0, "l_sho_roll": 1.45, "l_el": 0.0}
    low = ticks(op3().profile.postures.rest | arm | {"l_hip_pitch": -1.55, "r_hip_pitch": 1.55})
    rig = PhysicsRig(start=low)
    rig.arm()
    rig.run(0.3, low)
    witness = rig.bus.witness
    assert witness.state.fixture_contacts == 1 and not witness.state.touching and witness.fall is None
