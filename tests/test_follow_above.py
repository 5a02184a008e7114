"""What the legs carry goes on where the legs may not move."""

import numpy as np
import pytest

from followers import DT, follower, performer, postures
from retarget.robot_reader import standing_dofs
from retarget.rotations import FloatArray
from retarget.stopping import Stopping


def test_arms_follow_while_no_posture_that_moves_the_legs_is_safe(monkeypatch: pytest.MonkeyPatch) -> None:
    robot = follower()
    human = postures(performer())[:500]
    legs = standing_dofs(robot._robot)
    admits = Stopping.admits

    def only_still_legs(self: Stopping, q: FloatArray, velocity: FloatArray, dt: float) -> bool:
        return float(np.abs(velocity[legs]).max()) < 1e-9 and admits(self, q, velocity, dt)

    monkeypatch.setattr(Stopping, "admits", only_still_legs)
    robot.start(human[0])
    track = np.array([robot.step(posture, DT).q for posture in human])
    moved = np.abs(track - track[0]).max(axis=0)
    arms = [name for name in robot._robot.joint_map.servos if "sho" in name.joint or "_el" in name.joint]
    columns = [robot._robot.servo_columns[robot._robot.joint_map.servos.index(servo)] for servo in arms]
    carried = np.isin(np.arange(robot._robot.body.nq), robot._robot.servo_columns[:6])
    assert moved[columns].max() > 0.3
    assert moved[~carried & ~np.isin(np.arange(len(moved)), robot._robot.servo_columns[18:])].max() < 1e-6
