"""A robot on its soles is not asked for more than its legs can carry for long."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scipy.linalg import null_space

from followers import DT, dimensions, performer, postures
from retarget.follow import Follower
from retarget.priorities import load_priorities
from retarget.robot_body import RobotBody, load_robot
from retarget.rotations import FloatArray
from retarget.stance import plant
from retarget.standing_strength import LEAST_THROW, StandingStrength, leg_joints, standing_strength

SHARE = 0.3
ROBOTS = ["op3", "poppy", "toddlerbot", "wolfgang"]


@cache
def robot(name: str) -> RobotBody:
    return load_robot(name)


def strength(name: str, share: float = SHARE) -> StandingStrength:
    return StandingStrength(robot(name), plant(robot(name), robot(name).profile.postures.stand), share=share)


def planted_moves(name: str, q: FloatArray, count: int) -> FloatArray:
    """Small moves (count, nv) from q (nq,) that leave both soles where they are."""
    body, soles = robot(name).body.solver_body(), robot(name).soles
    rows = [body.frame_jacobian(q, sole.body, tuple(sole.position.tolist())) for sole in soles]
    free = null_space(np.concatenate(rows))
    return np.asarray(1e-5 * np.random.default_rng(5).normal(size=(count, free.shape[1])) @ free.T)


@pytest.mark.parametrize("name", ROBOTS)
def test_torques_change_as_the_half_spaces_say(name: str) -> None:
    """By finite differences over postures with planted soles: but for the leg's own weight, which is left out."""
    keeps, body = strength(name), robot(name).body.solver_body()
    q = plant(robot(name), robot(name).profile.postures.attractor).q
    com, before = body.centre_of_mass(q[None])[0], keeps.torques(q)
    by_com, by_joint, places = keeps._gradients(q, com)
    errors, sizes = [], []
    for move in planted_moves(name, q, 20):
        there = body.integrate(q, move)
        moved = body.centre_of_mass(there[None])[0] - com
        places_moved = keeps._probe.read(there)[0] - places
        said = by_com @ moved[:2] + np.einsum("ki,ki->k", by_joint, places_moved[:, :2])
        errors.append(said - (keeps.torques(there) - before))
        sizes.append(keeps.torques(there) - before)
    pitch = [k for k, joint in enumerate(keeps.names) if "knee" in joint.lower() or "ank" in joint.lower()]
    assert np.linalg.norm(np.array(errors)[:, pitch]) < 0.05 * np.linalg.norm(np.array(sizes)[:, pitch])
    assert np.linalg.norm(errors) < 0.25 * np.linalg.norm(sizes)


def test_only_joints_of_one_leg_are_watched() -> None:
    joints = leg_joints(robot("toddlerbot"))
    assert "waist_roll" not in joints and "left_shoulder_pitch" not in joints
    assert joints["left_knee"][0] == 0 and joints["right_knee"][0] == 1
    assert len(joints) == 12


def test_stand_is_always_allowed() -> None:
    keeps = strength("wolfgang", share=0.01)
    stance = plant(robot("wolfgang"), robot("wolfgang").profile.postures.stand)
    assert (np.abs(keeps.torques(stance.q)) <= keeps.most + 1e-9).all()


def test_a_mass_is_not_thrown_up_faster_than_the_most_loaded_joint_can() -> None:
    keeps = strength("toddlerbot")
    q = plant(robot("toddlerbot"), robot("toddlerbot").profile.postures.rest).q
    com = robot("toddlerbot").body.solver_body().centre_of_mass(q[None])[0]
    rises = [edges[-1] for edges in keeps.spaces(q, (com, np.zeros(3)), 0.02) if len(edges) and edges[-1, 2] == 1.0]
    assert len(rises) == 1
    assert LEAST_THROW <= (rises[0][6] - com[2]) / 0.02**2 < 9.81


def most_used(priorities: str) -> float:
    """Greatest share of what ToddlerBot's legs may carry for long, at rest, while a performer reaches and crouches."""
    follower = Follower(robot("toddlerbot"), load_priorities(priorities), dimensions(performer()))
    keeps, used = strength("toddlerbot"), 0.0
    humans = postures(performer(), speed=2.0)[:600]
    follower.start(humans[0])
    for human in humans:
        used = max(used, float((np.abs(keeps.torques(follower.step(human, DT).q)) / keeps.most).max()))
    return used


def test_legs_carry_no_more_than_they_can_for_long() -> None:
    assert most_used("steady") > 1.5
    assert most_used("lasting") < 1.25


def test_whoever_does_not_ask_for_it_keeps_to_balance_alone() -> None:
    stance = plant(robot("op3"), robot("op3").profile.postures.stand)
    assert standing_strength(robot("op3"), load_priorities("steady"), stance) is None
    assert standing_strength(robot("op3"), load_priorities("lasting"), stance) is not None
    assert standing_strength(robot("op3"), load_priorities("lasting"), replace(stance, soles=stance.soles[:1])) is None
