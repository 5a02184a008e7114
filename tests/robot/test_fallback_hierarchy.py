"""Fallback hierarchies where the first posture is not safe: soles before all else, then the parts above the legs."""

from typing import Any

import numpy as np
import pytest

from followers import DT, follower, performer, postures
from retarget.ik.hierarchy import FallbackHierarchy, Hierarchy, soles_first
from retarget.ik.whole_body_stop import Stopping
from retarget.robot.follower import Follower
from retarget.robot.landmarks import standing_dofs
from retarget.schema.priorities import load_priorities
from retarget.types import FloatArray, IntArray

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


def watched(fallback: FallbackHierarchy, monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Which of its hierarchies are solved from now on."""
    names = {"planted": fallback._planted, "separated": fallback._separated, "above": fallback._above}
    solve = fallback._solve
    solved: list[str] = []

    def seen(ordered: tuple[Hierarchy, IntArray], *rest: Any) -> tuple[FloatArray, FloatArray]:
        solved.extend(name for name, one in names.items() if one is ordered)
        return solve(ordered, *rest)

    monkeypatch.setattr(fallback, "_solve", seen)
    return solved


def test_after_a_refusal_at_rest_limbs_are_separated_first_for_one_tick(monkeypatch: pytest.MonkeyPatch) -> None:
    human = postures(performer())[:120]
    robot = follower(priorities="balanced")
    robot.start(human[0])
    fallback = robot._soles.fallback
    assert fallback is not None and not fallback.separate
    solved = watched(fallback, monkeypatch)
    assert robot.halt(DT) is not None
    rows = np.array([robot.step(posture, DT).q for posture in human])
    assert solved == ["separated"]
    assert np.abs(rows - followed(follower(priorities="balanced"), 120)).max() < 0.05  # its goals are the same


def test_after_a_refusal_at_rest_arms_alone_separate_limbs_where_legs_cannot(monkeypatch: pytest.MonkeyPatch) -> None:
    """A goal that asks for soles or balance first was refused, and would be again, tick after tick."""
    human = postures(performer())[:2]
    robot, admits = follower(priorities="balanced"), Stopping.admits
    robot.start(human[0])
    fallback, legs = robot._soles.fallback, standing_dofs(robot._robot)
    assert fallback is not None
    assert fallback._above[0].labels == fallback._separated[0].labels != robot.hierarchy.labels

    def only_still_legs(self: Stopping, q: FloatArray, velocity: FloatArray, dt: float) -> bool:
        return float(np.abs(velocity[legs]).max()) < 1e-9 and admits(self, q, velocity, dt)

    monkeypatch.setattr(Stopping, "admits", only_still_legs)
    solved = watched(fallback, monkeypatch)
    robot.halt(DT)
    robot.step(human[1], DT)
    assert solved == ["separated", "above"]


@pytest.mark.long
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
