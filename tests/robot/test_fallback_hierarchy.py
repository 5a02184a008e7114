"""Fallback hierarchies where the first posture is not safe: soles before all else, then the parts above the legs."""

from typing import Any

import numpy as np
import pytest

from followers import DT, follower, performer, postures
from retarget.ik.hierarchy import Hierarchy, soles_first
from retarget.ik.whole_body_stop import Stopping
from retarget.robot.follower import Follower
from retarget.robot.landmarks import standing_dofs
from retarget.schema.priorities import load_priorities
from retarget.types import FloatArray

SOLES = frozenset({"l_sole", "r_sole"})


def followed(robot: Follower, ticks: int = 500) -> FloatArray:
    """Postures (T, nq)."""
    human = postures(performer())[:ticks]
    robot.start(human[0])
    return np.array([robot.step(posture, DT).q for posture in human])


def test_the_level_of_the_soles_comes_first_and_the_others_keep_their_order() -> None:
    levels = load_priorities("servo").levels
    order = soles_first(levels, SOLES)
    assert levels[order[0]].name == "soles"
    assert order[1:] == [k for k in range(len(levels)) if k != order[0]]


def test_after_a_refusal_at_rest_limbs_are_separated_first_for_one_tick(monkeypatch: pytest.MonkeyPatch) -> None:
    human = postures(performer())[:120]
    robot = follower(priorities="balanced")
    robot.start(human[0])
    fallback = robot._soles.fallback
    assert fallback is not None and not fallback.separate
    solve, separated = fallback._solve, []

    def watched(hierarchy: Hierarchy, *rest: Any) -> tuple[FloatArray, FloatArray]:
        separated.append(hierarchy is fallback._separated)
        return solve(hierarchy, *rest)

    monkeypatch.setattr(fallback, "_solve", watched)
    assert robot.halt(DT) is not None
    rows = np.array([robot.step(posture, DT).q for posture in human])
    assert separated == [True]
    assert np.abs(rows - followed(follower(priorities="balanced"), 120)).max() < 0.05  # its goals are the same


def test_with_soles_first_the_robot_follows_as_before(monkeypatch: pytest.MonkeyPatch) -> None:
    """Where nothing is near, a robot that always falls back follows as one that never does."""
    once = followed(follower())
    robot, admits, turn = follower(), Stopping.admits, [0]

    def second_only(self: Stopping, q: FloatArray, velocity: FloatArray, dt: float) -> bool:
        turn[0] += 1
        return turn[0] % 2 == 0 and admits(self, q, velocity, dt)

    monkeypatch.setattr(Stopping, "admits", second_only)
    off = np.abs(followed(robot) - once)
    assert np.percentile(off, 99) < 0.2 and off.mean() < 0.01  # limbs come near in a crouch


def test_arms_follow_while_no_posture_that_moves_the_legs_is_safe(monkeypatch: pytest.MonkeyPatch) -> None:
    robot, admits = follower(), Stopping.admits
    legs = standing_dofs(robot._robot)

    def only_still_legs(self: Stopping, q: FloatArray, velocity: FloatArray, dt: float) -> bool:
        return float(np.abs(velocity[legs]).max()) < 1e-9 and admits(self, q, velocity, dt)

    monkeypatch.setattr(Stopping, "admits", only_still_legs)
    track = followed(robot)
    moved = np.abs(track - track[0]).max(axis=0)
    _, address = robot._robot.body.scalar_joints()
    assert moved[:7].max() < 1e-6 and moved[address[6:][legs[6:]]].max() < 1e-6
    assert moved[address[6:][~legs[6:]]].max() > 0.3
