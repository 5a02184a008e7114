"""The base pose from the lower sole."""

import numpy as np
import pytest

from followers import op3
from retarget.ik.base_pose import SupportFootBase, plant_root
from retarget.ik.gravity_torque import CARRIES_BELOW_M, GravityTorque
from retarget.ik.support_polygon import plant
from retarget.model.robot import load_robot
from retarget.types import FloatArray

STANCE = plant(op3(), op3().profile.postures.stand)


def bent(side: str, knee: float) -> FloatArray:
    """The standing posture with one leg drawn up, its root somewhere else."""
    sign = 1.0 if side == "l" else -1.0
    angles = dict(op3().profile.postures.stand)
    angles[f"{side}_knee"] += sign * knee
    angles[f"{side}_hip_pitch"] -= sign * 0.5 * knee
    angles[f"{side}_ank_pitch"] += sign * 0.5 * knee
    q = op3().posture(angles)
    q[:3] += [0.3, -0.2, 0.1]
    return q


@pytest.mark.parametrize(("side", "other"), [("l", "r_sole"), ("r", "l_sole")])
def test_the_sole_of_the_straighter_leg_is_where_it_was_planted(side: str, other: str) -> None:
    q = bent(side, 0.3)
    heights = SupportFootBase(op3(), STANCE).plant(q)
    place = next(sole.position for sole in STANCE.soles if sole.frame.name == other)
    assert np.abs(op3().points(q[None], (other,))[0, 0] - place).max() < 1e-9
    assert sorted(heights)[0] == pytest.approx(0.0, abs=1e-12) and sorted(heights)[1] > 0.005


def test_a_sole_in_the_air_carries_nothing_and_no_torque_jumps() -> None:
    load, still = GravityTorque(op3(), STANCE), np.zeros(3)
    both = load.torques(STANCE.q, still)
    assert (load.torques(STANCE.q, still, heights=np.zeros(2)) == both).all()
    alone = load.torques(STANCE.q, still, heights=np.array([0.0, 1.0]))
    right = [op3().body.dof_index(joint) for joint in ("r_knee", "r_ank_pitch")]
    # It still carries its shank.
    assert np.abs(alone[right]).max() < 0.5 * np.abs(both[right]).max()
    way = [load.torques(STANCE.q, still, heights=np.array([0.0, h])) for h in np.linspace(0.0, CARRIES_BELOW_M, 50)]
    assert np.abs(np.diff(way, axis=0)).max() < 0.05


def test_the_sole_stays_when_the_joints_move() -> None:
    robot = load_robot("op3")
    before = plant(robot, robot.profile.postures.stand).q
    q = before.copy()
    q[robot.servo_columns] += np.random.default_rng(0).uniform(-0.2, 0.2, 20)
    q[:7] = np.nan
    plant_root(robot, before, q)
    both = np.stack([before, q])
    soles = robot.points(both, ("l_sole", "r_sole"))
    turns = robot.orientations(both, ("l_sole", "r_sole"))
    foot = int(np.argmin(soles[0, :, 2]))
    np.testing.assert_allclose(soles[1, foot], soles[0, foot], atol=1e-12)
    np.testing.assert_allclose(np.abs(np.sum(turns[1, foot] * turns[0, foot])), 1.0, atol=1e-12)
