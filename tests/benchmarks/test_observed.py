"""The observed benchmark: obstacles stand where they should, and peers look at our pairs."""

from collections.abc import Callable
from dataclasses import replace
from functools import partial

import mujoco
import numpy as np
import pytest

from benchmarks.measure import play
from benchmarks.motion import Motion, crouch_and_reach
from benchmarks.observed import obstacle_cost, show_observed
from benchmarks.observed_body import (
    Watched,
    exact_self_distances,
    scene_distances,
    watched_human,
    watched_op3,
)
from benchmarks.observed_cases import BASE, entries, run_observed, settled
from benchmarks.observed_obstacles import FAR, NEAR, around_arms, influence
from benchmarks.observed_shapes import PREFIX, THIN, mujoco_model, urdf_names, urdf_shapes
from benchmarks.ours import observed
from benchmarks.side import check_distances
from benchmarks.urdf import write_urdf
from messages import refuses
from retarget.model.body import load_body_text
from retarget.model.scene_shapes import ShapeKind

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


def test_the_bodies_are_those_that_were_asked_for() -> None:
    made = [make() for make in BODIES.values()]
    sizes = [(len(w.observers.names), len(w.observers.pairs), w.body.degrees_of_freedom) for w in made]
    assert sizes[0][::2] == (9, 51) and sizes[1][::2] == (19, 51) and sizes[2][::2] == (23, 26)
    assert sizes[2][1] > 150  # every pair but neighbours, ignored ones and those that touch at rest


def test_every_other_obstacle_is_within_influence(watched: Watched) -> None:
    calm = replace(watched.body, swing={name: 0.1 * angle for name, angle in watched.body.swing.items()})
    postures = play(calm, crouch_and_reach(calm, 60), [observed("free", watched, None)])[2][0]
    around, zone = around_arms(watched, postures, 6), influence(watched)
    nearest = scene_distances(watched, np.ascontiguousarray(postures[::10]), around).min(axis=1) / zone
    assert nearest.shape == (6, 6) and set(around.kinds.tolist()) <= {ShapeKind.CAPSULE, ShapeKind.BOX}
    assert np.all((nearest[:, ::2] >= NEAR[0]) & (nearest[:, ::2] <= NEAR[1]))
    assert np.all(nearest[:, 1::2] >= FAR[0])


def test_settling_leaves_no_overlap(watched: Watched, motion: Motion) -> None:
    assert exact_self_distances(watched, settled(watched, motion).start).min() > 0.0


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


def test_the_urdf_has_our_shapes(watched: Watched) -> None:
    shapes = urdf_shapes(watched)
    text, plain = write_urdf(watched.body, shapes), write_urdf(watched.body)
    assert text.count("<collision ") == len(watched.observers.names) == len(set(urdf_names(watched)))
    assert "<collision " not in plain
    model = load_body_text(text, source="urdf", root="free")
    sizes = sorted(float(size) for geom in model.geoms for size in geom.size)
    assert sizes[-1] == pytest.approx(float(watched.observers.sizes.max()))
    assert THIN <= 1e-6 / 2.0  # two lines are no nearer each other than distances may differ


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


def test_obstacles_cost_and_tables_have_a_row_for_every_case(capsys: pytest.CaptureFixture[str]) -> None:
    cost = obstacle_cost(watched_op3(), "all", frames=40, repeats=2, counts=(1, 4))
    assert cost.near[1] > cost.near[0] > 0.0 and min(cost.median_us) > 0.0
    lines = watched_human("lines_and_head")
    motion = crouch_and_reach(lines.body, 30)
    show_observed(run_observed(lines, motion, [observed(BASE, lines, "all")], repeats=2), docs=False)
    table = [line for line in capsys.readouterr().out.splitlines() if line.startswith("|")]
    assert len(table) == 3 and f"| {len(lines.observers.pairs)} |" in table[-1]
