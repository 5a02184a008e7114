"""Clearance is exact, near by and far away, of a body to itself and to a scene."""

from functools import partial
from pathlib import Path

import mujoco
import numpy as np
import pytest
from scipy.optimize import lsq_linear

from benchmarks.physics_runs import play
from people import close_passes
from retarget.model.body_file import compile_body_text
from retarget.model.robot import load_robot
from retarget.model.scene_state import SceneState
from retarget.report.clearance import (
    Clearance,
    ClosestPairs,
    MovingGeoms,
    compared_pairs,
    place_body,
    scene_model,
)
from retarget.report.measure import measure
from retarget.rotations import normalise, to_matrix
from retarget.run.options import RunOptions
from retarget.schema.scene import load_scene
from retarget.types import FloatArray, IntArray

TWO_BALLS = """
<mujoco><worldbody>
  <body name="base"><geom type="sphere" size="0.01" mass="1"/>
    <body name="arm"><joint name="s" type="slide" axis="1 0 0"/><geom type="sphere" size="0.001" mass="1"/>
      <body name="hand"><geom type="sphere" size="0.01" pos="0.02 0 0" mass="1"/></body>
    </body>
  </body>
</worldbody></mujoco>"""


def clearance(gaps: list[float]) -> Clearance:
    """Of two balls with these gaps (m) between them, one posture each."""
    return place_body(TWO_BALLS, np.array([[gap] for gap in gaps]), root="fixed").to_itself(neutral=np.array([1.0]))


def scene(folder: Path, *obstacles: str) -> SceneState:
    path = folder / "scene.yaml"
    path.write_text("name: scene\ndescription: For a test\nobstacles:\n" + "".join(f"  {line}\n" for line in obstacles))
    return SceneState(load_scene(path))


@pytest.mark.parametrize("nearest", [-0.004, 0.003, 0.03, 0.4, 3.0])
def test_the_smallest_gap_is_found_however_far(nearest: float) -> None:
    found = clearance([*np.linspace(3.5, 3.6, 30), nearest, 4.0])
    assert found.smallest == pytest.approx(nearest, abs=1e-9)
    assert found.row == 30
    assert found.penetrating == found.deep == (1 if nearest < 0.0 else 0)
    assert found.pair is not None and set(found.pair) == {"base", "hand"}


def test_touches_are_distinguished_from_penetrations() -> None:
    found = clearance([0.1, -5e-7, -0.0005, -0.002, 0.2, -0.0009, -0.0011])
    assert (found.penetrating, found.deep) == (4, 2)


def wavy(name: str, rows: int = 120) -> FloatArray:
    """Postures (T, nq) of a robot that waves all its joints."""
    robot = load_robot(name)
    q = np.tile(robot.posture(robot.profile.postures.stand), (rows, 1))
    swing = np.random.default_rng(3).uniform(-1.0, 1.0, len(robot.servo_columns))
    q[:, robot.servo_columns] += np.sin(np.linspace(0.0, 9.0, rows))[:, None] * swing
    return q


def test_no_posture_and_no_pair_is_overlooked() -> None:
    """Against a look at every pair of OP3's geoms that collide in every posture."""
    robot, q = load_robot("op3"), wavy("op3")
    neutral, body = robot.posture(robot.profile.postures.neutral), place_body(robot.profile.body_path, q, root="free")
    found, model = body.to_itself(neutral=neutral), body.model
    geoms, of_geom = np.flatnonzero(model.geom_contype), model.geom_bodyid.astype(np.int64)
    rows = compared_pairs(model, of_geom[geoms], geoms, neutral=neutral)
    compared = {frozenset(pair) for pair in of_geom[geoms][rows].tolist()}
    data = mujoco.MjData(model)
    pairs = [
        (a, b)
        for a, b in geoms[np.column_stack(np.triu_indices(len(geoms), 1))].tolist()
        if frozenset((int(of_geom[a]), int(of_geom[b]))) in compared
    ]
    nearest = np.empty(len(q))
    for row, posture in enumerate(q):
        data.qpos[:] = posture
        mujoco.mj_kinematics(model, data)
        nearest[row] = min(mujoco.mj_geomDistance(model, data, a, b, 10.0, None) for a, b in pairs)
    assert found.smallest == pytest.approx(nearest.min(), abs=1e-12)
    assert found.row == int(np.argmin(nearest))
    assert found.penetrating == int(np.count_nonzero(nearest < -1e-6)) > 0
    assert found.deep == int(np.count_nonzero(nearest < -1e-3))


OBSTACLES = (
    ("{sphere: {radius: 0.1}}", 0.39),
    ("{segment: {from: [0, -1, 0], to: [0, 1, 0]}}", 0.49),
    ("{capsule: {from: [0, -1, 0], to: [0, 1, 0], radius: 0.05}}", 0.44),
    ("{cylinder: {from: [0, 0, -1], to: [0, 0, 1], radius: 0.2}}", 0.29),
    ("{box: {size: [0.1, 0.2, 0.3]}}", 0.39),
    ("{half_space: {point: [-0.1, 0, 0], normal: [-2, 0, 0]}}", 0.39),
)


@pytest.mark.parametrize(("shape", "gap"), OBSTACLES)
def test_every_shape_of_a_scene_is_where_the_scene_says(tmp_path: Path, shape: str, gap: float) -> None:
    around = scene(tmp_path, f"it: {{shape: {shape}, at: {{pos: [0.53, 0, 0]}}}}")
    found = place_body(TWO_BALLS, np.array([[-1.0], [0.01], [-0.5]])).to_scene(around, np.zeros(3))
    assert found.smallest == pytest.approx(gap, abs=1e-9)
    assert (found.row, found.pair, found.penetrating) == (1, ("hand", "it"), 0)
    inside = place_body(TWO_BALLS, np.array([[0.01 + gap + 0.004]])).to_scene(around, np.zeros(1))
    assert inside.smallest == pytest.approx(-0.004, abs=1e-9)
    assert (inside.penetrating, inside.deep) == (1, 1)


def test_an_obstacle_is_where_it_is_at_the_time(tmp_path: Path) -> None:
    around = scene(
        tmp_path, "far: {shape: {sphere: {radius: 0.1}}, at: {pos: [9, 0, 0]}}",
        "it: {shape: {sphere: {radius: 0.1}}, at: {pos: [1, 0, 0]}, velocity: [-0.1, 0, 0]}",
    )  # fmt: skip
    times = np.linspace(-1.0, 6.0, 71)
    found = place_body(TWO_BALLS, np.full((71, 1), 0.08)).to_scene(around, times)
    assert found.pair == ("hand", "it")
    assert found.smallest == pytest.approx(0.4 - 0.21, abs=1e-9)
    assert found.row == 70


def test_a_mesh_is_measured_where_it_was(tmp_path: Path) -> None:
    corners = " ".join(f"{x} {y} {z}" for x in (0.1, 0.3) for y in (0, 0.05) for z in (-0.02, 0.01))
    body = (
        f'<mujoco><asset><mesh name="m" vertex="{corners}"/></asset><worldbody><body name="b"><freejoint/>'
        '<geom type="mesh" mesh="m" mass="1"/></body></worldbody></mujoco>'
    )
    around = scene(tmp_path, "it: {shape: {box: {size: [0.1, 0.1, 0.1]}}, at: {pos: [0.6, 0.1, 0]}}")
    q = np.array([[0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0], [0.0, 0.5, 0.0, 1.0, 0.0, 0.0, 0.0]])
    assert place_body(body, q[:1]).to_scene(around, np.zeros(1)).smallest == pytest.approx(0.2, abs=1e-6)
    turned = place_body(body, q[1:]).to_scene(around, np.zeros(1)).smallest
    assert turned == pytest.approx(np.hypot(0.2, 0.3), abs=1e-6)


CHAIN = """
<mujoco><worldbody><geom name="floor" type="plane" size="1 1 1"/>
  <body name="base"><freejoint/><geom size="0.01"/><geom size="0.01" pos="0.02 0 0"/>
    <body name="arm" pos="0.1 0 0"><joint/><geom size="0.01"/>
      <body name="plate" pos="0.1 0 0"><geom size="0.01"/>
        <body name="hand" pos="0.1 0 0"><joint axis="1 0 0"/><geom size="0.01"/></body>
      </body>
    </body>
    <body name="leg" pos="0 0 -0.1"><joint/><geom size="0.01"/></body>
    <body name="tail" pos="0.015 0 0"><joint/><geom size="0.01"/>
      <body name="tip" pos="0 0 0"><joint/><geom size="0.012"/></body>
    </body>
  </body>
</worldbody><contact><exclude body1="hand" body2="leg"/></contact></mujoco>"""


def test_every_pair_is_compared_but_those_that_may_touch() -> None:
    model = mujoco.MjModel.from_xml_string(CHAIN)
    geoms = np.flatnonzero(model.geom_bodyid > 0)
    links = model.geom_bodyid[geoms].astype(np.int64)
    pairs = compared_pairs(model, links, geoms, neutral=model.qpos0, ignored=[("tip", "leg")])
    named = {frozenset(str(model.body(int(links[side])).name) for side in pair) for pair in pairs}
    neighbours = [("base", "arm"), ("base", "leg"), ("base", "tail"), ("arm", "plate"), ("tail", "tip")]
    neighbours += [("arm", "hand"), ("base", "plate"), ("plate", "hand")]  # the plate is one with the arm
    excluded, ignored, touching = ("hand", "leg"), ("leg", "tip"), ("base", "tip")
    names = [str(model.body(link).name) for link in sorted(set(links.tolist()))]
    every = {frozenset((a, b)) for k, a in enumerate(names) for b in names[k + 1 :]}
    assert named == every - {frozenset(pair) for pair in (*neighbours, excluded, ignored, touching)}


# The search over postures finds what a look at all of them finds, with fewer looks.


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("offset", [0.5, 0.0, -0.3])
def test_all_is_found(seed: int, offset: float) -> None:
    rng = np.random.default_rng(seed)
    table = offset + np.abs(0.3 + np.cumsum(rng.normal(0.0, 0.01, (400, 12)), axis=0)) - 0.05
    bound = table - rng.uniform(0.0, 0.05, table.shape)
    looked = 0

    def distances(block: IntArray, rows: IntArray, pairs: IntArray) -> FloatArray:
        nonlocal looked
        looked += len(rows)
        assert (np.diff(rows) >= 0).all()
        return np.asarray(table[block[rows], pairs])

    def bounds(block: IntArray, rows: IntArray) -> FloatArray:
        return np.asarray(bound[block[rows]])

    closest = ClosestPairs((1e-6, 1e-3))
    for block in np.split(np.arange(len(table)), [64, 128, 256]):
        closest.look(partial(distances, block), partial(bounds, block), len(block))
    assert closest.smallest == table.min()
    assert table[closest.row, closest.pair] == table.min()
    nearest = table.min(axis=1)
    assert closest.deeper == [int(np.count_nonzero(nearest < -depth)) for depth in (1e-6, 1e-3)]
    assert looked < (table.size // 2 if offset == 0.5 else table.size)


SIZES = np.array([[0.021, 0.0565, 0.0151], [0.08725, 0.0646, 0.0728]])


def box_distance(position: FloatArray, turn: FloatArray) -> float:
    """Signed distance of the two boxes at (2, 3) m, turned (2, 3, 3)."""
    axes = [*turn[0].T, *turn[1].T, *(np.cross(a, b) for a in turn[0].T for b in turn[1].T)]
    unit = np.array([axis / np.linalg.norm(axis) for axis in axes])
    between = np.abs(unit @ (position[1] - position[0]))
    separation = float((between - np.abs(unit @ turn[0]) @ SIZES[0] - np.abs(unit @ turn[1]) @ SIZES[1]).max())
    if separation <= 0.0:
        return separation
    matrix, ends = np.hstack([turn[0], -turn[1]]), SIZES.ravel()
    found = lsq_linear(matrix, position[1] - position[0], bounds=(-ends, ends), method="bvls")
    return float(np.sqrt(2.0 * found.cost))


def test_boxes_are_exact_apart_and_inside() -> None:
    rng, rows = np.random.default_rng(0), 1000
    turn = to_matrix(normalise(rng.normal(size=(rows, 2, 4))))
    position = rng.uniform(-0.1, 0.1, (rows, 2, 3))
    text = "".join(f'<geom type="box" size="{a} {b} {c}"/>' for a, b, c in SIZES)
    model = mujoco.MjModel.from_xml_string(f"<mujoco><worldbody>{text}</worldbody></mujoco>")
    geoms = MovingGeoms(model, np.array([0, 1]), position, turn.reshape(rows, 2, 9))
    found = geoms.distances(np.array([[0, 1]]))(np.arange(rows), np.zeros(rows, dtype=np.int64))
    wanted = np.array([box_distance(p, t) for p, t in zip(position, turn, strict=True)])
    assert 200 < np.count_nonzero(wanted < 0.0) < rows - 200
    assert np.abs(found - wanted).max() < 1e-6


@pytest.mark.parametrize("second", ['"box" size=".1 .2 .3"', '"plane" size="1 1 1"', '"sphere" size=".1"'])
def test_no_pair_is_nearer_than_its_bound(second: str) -> None:
    model = mujoco.MjModel.from_xml_string(
        '<mujoco><asset><mesh name="m" vertex="0 0 0 .3 0 0 0 .1 0 0 0 .2"/></asset><worldbody>'
        f'<geom type="mesh" mesh="m"/><geom type={second}/></worldbody></mujoco>'
    )
    rng, rows = np.random.default_rng(1), 300
    position, turn = rng.uniform(-0.5, 0.5, (rows, 2, 3)), to_matrix(normalise(rng.normal(size=(rows, 2, 4))))
    geoms, one = MovingGeoms(model, np.array([0, 1]), position, turn.reshape(rows, 2, 9)), np.array([[0, 1]])
    found = geoms.distances(one)(np.arange(rows), np.zeros(rows, dtype=np.int64))
    bound = geoms.bounds(one)(np.arange(rows))[:, 0]
    assert (bound <= found + 1e-9).all() and (bound > 0.0).any()


def test_a_body_and_its_scene_share_a_model() -> None:
    body = compile_body_text(
        '<mujoco><worldbody><geom type="plane" size="1 1 1"/><body><freejoint/><geom type="box" size="1 2 3" mass="1"/>'
        '<geom type="ellipsoid" size="1 2 3"/></body></worldbody></mujoco>',
        source="test",
    )
    scene = SceneState(load_scene("table"))
    model, obstacles = scene_model(body, scene.shapes)
    assert model.ngeom == 1 + 5 + 2
    np.testing.assert_allclose(model.geom_size[np.array([1, 2]) + 5], [[1, 2, 3], [1, 2, 3]])
    top = scene.shapes.names.index("top")
    np.testing.assert_allclose(model.geom_size[obstacles[top]], [0.15, 0.3, 0.008])


@pytest.mark.parametrize(
    "robot", ["op3", *(pytest.param(name, marks=pytest.mark.long) for name in ("poppy", "toddlerbot", "wolfgang"))]
)
def test_ankles_that_pass_close_and_crossed_arms_reach_no_robot_as_a_collision(robot: str) -> None:
    report = measure(play(close_passes(), RunOptions(robot=robot)))
    # Arms that cross are the robot's own: it may hold them apart for a tick.
    assert report.penetrating_frames == 0 and report.gated_frames in (0, 1)
    nearest = report.min_clearance_mm.self
    assert nearest is not None and nearest > 0.0
