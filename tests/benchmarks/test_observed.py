"""The observed benchmark: obstacles stand where they should, and peers look at our pairs."""

from collections.abc import Callable
from dataclasses import replace
from functools import partial

import mujoco
import numpy as np
import pytest

from benchmarks.motion import Motion, crouch_and_reach
from benchmarks.observed_body import (
    Watched,
    exact_self_distances,
    watched_human,
    watched_op3,
)
from benchmarks.observed_cases import entries, run_observed
from benchmarks.observed_shapes import PREFIX, mujoco_model
from benchmarks.side import check_distances
from messages import refuses

FRAMES = 200
"""Past the farthest place of the hand."""
BODIES: dict[str, Callable[[], Watched]] = {
    "lines": partial(watched_human, "lines_and_head"),
    "capsules": partial(watched_human, "capsules"),
    "op3": watched_op3,
}


@pytest.fixture(scope="module", params=list(BODIES))
def watched(request: pytest.FixtureRequest) -> Watched:
    name: str = request.param
    return BODIES[name]()


@pytest.fixture(scope="module")
def motion(watched: Watched) -> Motion:
    return crouch_and_reach(watched.body, FRAMES)


def test_mujoco_has_our_shapes_and_masses(watched: Watched, motion: Motion) -> None:
    model = mujoco_model(watched)
    assert model.ngeom == len(watched.observers.names) and model.nv == watched.body.degrees_of_freedom
    assert model.body_mass.sum() == pytest.approx(watched.body.model.mass.sum())
    data = mujoco.MjData(model)
    joints = [watched.body.model.joint_index(model.joint(i).name) for i in range(1, model.njnt)]
    data.qpos[:7], data.qpos[7:] = motion.start[:7], motion.start[watched.body.model.joint_qpos[joints]]
    mujoco.mj_forward(model, data)
    names = [PREFIX + name for name in watched.observers.names]
    theirs = [
        mujoco.mj_geomDistance(model, data, model.geom(names[a]).id, model.geom(names[b]).id, 100.0, np.zeros(6))
        for a, b in watched.observers.pairs.tolist()
    ]
    np.testing.assert_allclose(theirs, exact_self_distances(watched, motion.start), atol=1e-6)


def test_peers_look_at_our_pairs(watched: Watched, motion: Motion) -> None:
    pytest.importorskip("placo")
    pytest.importorskip("mink")
    short = replace(motion, com=motion.com[:30], points=motion.points[:30])
    sides = entries(watched)
    rows = run_observed(watched, short, sides)  # raises where pairs or distances are not ours
    assert [row.outcome.side for row in rows[-3:]] == ["PlaCo hard", "PlaCo soft", "mink"]
    assert all(row.outcome.com_mm < 1.0 and row.outcome.failures == 0 for row in rows)


def test_a_peer_that_looks_at_less_is_reported(watched: Watched, motion: Motion) -> None:
    exact = exact_self_distances(watched, motion.start)
    check_distances("peer", exact, watched, motion.start)
    for off in (1e-4, np.nan):
        with refuses(RuntimeError):
            check_distances("peer", exact + np.where(np.arange(len(exact)) == 3, off, 0.0), watched, motion.start)
