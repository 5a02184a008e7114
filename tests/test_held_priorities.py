"""What a robot with mass runs that something else holds up: its feet point forward, as nothing else would keep them."""

import numpy as np
import pytest

from followers import DT, dimensions, performer, postures
from retarget import rotations
from retarget.follow import Follower
from retarget.options import RunOptions
from retarget.physics_options import PhysicsOptions
from retarget.priorities import AxisTask, PostureTask, load_priorities
from retarget.priority_choice import priority_names
from retarget.robot_body import load_robot


@pytest.mark.parametrize("forward", [True, False])
def test_feet_that_are_asked_to_point_forward_do(forward: bool) -> None:
    """The axis of a robot's frame points along a direction of its own world, x forward."""
    robot, held = load_robot("op3", root="suspended"), load_priorities("held")
    dropped = (PostureTask,) if forward else (PostureTask, AxisTask)
    levels = tuple(
        level.model_copy(update={"tasks": tuple(task for task in level.tasks if not isinstance(task, dropped))})
        for level in held.levels
    )
    one = Follower(robot, held.model_copy(update={"levels": levels}), dimensions(performer()))
    human = postures(performer())[0]
    one.start(human)
    turned = robot.posture(robot.profile.postures.stand)
    turned[robot.body.joint_qpos[robot.body.joint_index("l_hip_yaw")]] = 0.5
    one.reseed(turned, np.zeros(robot.body.nv))
    posture = one.step(human, DT)
    for _ in range(400):
        posture = one.step(human, DT)
    x, y, _ = rotations.rotate(robot.orientations(posture.q[None], ("l_sole",))[0, 0], np.array([1.0, 0.0, 0.0]))
    assert (abs(float(np.arctan2(y, x))) < 0.02) is forward
    for name in ("l_sole", "l_hand"):
        row = posture.landmark_names.index(name)
        assert np.linalg.norm(posture.landmarks_reached[row] - posture.landmarks_asked[row]) < 1e-3


@pytest.mark.parametrize(
    ("bus", "mount", "named", "chosen"),
    [
        ("physics", "gantry", None, "held"),
        ("physics", "stand", None, "held"),
        ("physics", "floor", None, "steady"),
        ("physics", "gantry", "servo", "servo"),
        ("mock", None, None, "servo"),
    ],
)
def test_who_runs_them(bus: str, mount: str | None, named: str | None, chosen: str) -> None:
    hook = "neck" if mount == "gantry" else None
    physics = PhysicsOptions(mount=mount, hook=hook)
    options = RunOptions(robot="op3", bus=bus, priorities=named, physics=physics)
    assert priority_names(load_robot("op3", root=physics.root), options)[-1] == chosen
