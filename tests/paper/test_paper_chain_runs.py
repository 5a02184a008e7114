"""Figures 5 and 6: a still chain yields before it is touched; of a chain that reaches, the right links act."""

import numpy as np
import pytest

from benchmarks.paper.chain_runs import ONE, TWO, ChainRun, reaching_chain, yielding_chain

TOUCH = -1e-5
"""m: exact touching is allowed (margin 0), rounding of a step is not penetration."""


@pytest.fixture(scope="module")
def one() -> ChainRun:
    return reaching_chain(ONE)


@pytest.fixture(scope="module")
def two() -> ChainRun:
    return reaching_chain(TWO)


def test_a_still_chain_bends_away_before_it_is_touched() -> None:
    run = yielding_chain()
    assert run.clearance.min() > TOUCH
    assert not (run.modes == 2).any()
    still = run.points[0]
    first = int(np.argmax(run.within.any(axis=(1, 2))))
    assert first > 20
    np.testing.assert_allclose(run.points[:first], still[None].repeat(first, axis=0), atol=1e-9)
    # A chain that stayed would have been hit.
    ball = run.balls[0]
    assert np.abs(run.centres[:, 0, 0]).min() < 0.5 * ball.radius
    moved = np.linalg.norm(run.points[-1] - still, axis=1)
    assert moved.max() > 0.1
    yielded = int(np.argmax(np.linalg.norm(run.points - still, axis=2).max(axis=1) > 1e-6))
    assert first <= yielded + 1 and run.clearance[yielded].min() > 0.5 * ball.influence


def test_of_the_links_in_one_zone_only_the_closest_acts(one: ChainRun) -> None:
    acting = one.modes == 1
    assert one.clearance.min() > TOUCH
    assert acting.sum(axis=1).max() == 1
    assert one.within.any(axis=2).sum(axis=1).max() >= 3
    for k in np.flatnonzero(acting.any(axis=1)).tolist():
        before, link = one.clearance[k - 1, :, 0], int(np.argmax(acting[k]))  # modes are of the way from there to k
        assert one.within[k - 1, link, 0]
        nearer = (before < before[link] - 1e-9) & (one.clearance[k, :, 0] < before - 1e-4)
        assert not nearer.any(), "a nearer link approached, and did not act"


def test_two_obstacles_each_have_their_own(two: ChainRun) -> None:
    acting = two.modes == 1
    assert two.clearance.min() > TOUCH
    both = np.flatnonzero(acting.sum(axis=1) == 2)
    assert acting.sum(axis=1).max() == 2 and len(both) > 0
    for k in both.tolist():
        links = np.flatnonzero(acting[k])
        zones = two.within[k - 1][links]
        assert zones.any(axis=0).all(), "one of them is in the zone of each obstacle"


def test_the_goal_is_reached(one: ChainRun, two: ChainRun) -> None:
    for run in (one, two):
        assert run.goal is not None
        np.testing.assert_allclose(run.points[-1, -1], run.goal, atol=1e-3)
