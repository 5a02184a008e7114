"""Margins that a body could not keep where it rests, and soles on an obstacle."""

from pathlib import Path

import numpy as np

from messages import refuses
from retarget.errors import UsageError
from retarget.ik.support_polygon import plant
from retarget.model.observers import robot_observers
from retarget.model.robot import load_robot
from retarget.model.scene_state import SceneState
from retarget.safety.clearance import refuse_floor
from retarget.schema.scene import load_scene


def test_no_pair_is_asked_for_more_than_it_has_at_home(tmp_path: Path) -> None:
    """With margins of 2 cm the hips of an OP3 would never be satisfied, and nothing else would move."""
    robot = load_robot("op3")
    text = robot.profile.path.read_text(encoding="utf-8").replace("margin: 0.004", "margin: 0.02")
    (tmp_path / "body.xml").write_text(robot.profile.body_path.read_text(encoding="utf-8"), encoding="utf-8")
    (tmp_path / "robot.yaml").write_text(text, encoding="utf-8")
    wide, narrow = robot_observers(load_robot(tmp_path / "robot.yaml")), robot_observers(robot)
    assert (wide.margin == 0.02).all() and 0.0 < wide.pair_margin.min() < 0.01
    np.testing.assert_array_equal(wide.pair_margin, narrow.pair_margin)


def test_a_floor_under_the_soles_is_refused(tmp_path: Path) -> None:
    robot = load_robot("op3")
    stand = plant(robot, robot.profile.postures.stand).q
    for height, refused in ((0.0, True), (-0.03, False)):
        path = tmp_path / "floor.yaml"
        shape = f"{{shape: {{half_space: {{normal: [0, 0, 1]}}}}, at: {{pos: [0, 0, {height}]}}}}"
        path.write_text(f"name: floor\ndescription: a floor\nobstacles:\n  ground: {shape}\n", encoding="utf-8")
        scene = SceneState(load_scene(path))
        if refused:
            with refuses(UsageError, "ground"):
                refuse_floor(robot, robot_observers(robot), scene, stand)
        else:
            refuse_floor(robot, robot_observers(robot), scene, stand)
