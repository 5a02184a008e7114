"""Scene files: the shipped ones, the format, and what is refused."""

import re
import textwrap
from pathlib import Path

import mujoco
import numpy as np
import pytest

from followers import op3
from messages import refuses
from retarget import rotations
from retarget.errors import ConfigError
from retarget.model.scene_shapes import ShapeKind
from retarget.model.scene_state import SceneState
from retarget.schema.scene import Scene, load_scene

GOOD = """\
name: mine
description: one of each
obstacles:
  top: {frame: world, shape: {box: {size: [0.2, 0.4, 0.01]}}, at: {pos: [0.3, 0, 0.2]}, influence: 0.06, margin: 0.01}
  wall: {shape: {half_space: {normal: [-1, 0, 0]}}, at: {pos: [1, 0, 0], quat: [1, 0, 0, 0]}}
  post: {frame: stand, shape: {cylinder: {from: [0, 0, 0], to: [0, 0, 1], radius: 0.02}}}
  ball: {shape: {sphere: {radius: 0.1}}, velocity: [1, 0, 0], from: 1, until: 2}
  rope: {shape: {segment: {from: [0, 0, 0], to: [0, 0, 1]}}, angular_velocity: [0, 0, 1]}
  car:
    shape: {capsule: {from: [0, 0, 0], to: [1, 0, 0], radius: 0.1}}
    path:
      - {time: 0, pos: [2, 0, 0]}
      - {time: 1, pos: [3, 0, 0], quat: [0, 0, 0, 1]}
      - {time: 2.5, pos: [2, 0, 0], quat: [-1, 0, 0, 0]}
    loop: true
"""


def load(text: str, folder: Path) -> Scene:
    path = folder / "mine.yaml"
    path.write_text(text, encoding="utf-8")
    return load_scene(path)


def test_one_of_each_is_read(tmp_path: Path) -> None:
    scene = load(GOOD, tmp_path)
    kinds = ["box", "half_space", "cylinder", "sphere", "segment", "capsule"]
    assert [obstacle.shape.label for obstacle in scene.obstacles.values()] == kinds
    wall = scene.obstacles["wall"]
    assert (wall.frame, wall.influence, wall.margin) == ("world", 0.1, 0.01)


@pytest.mark.parametrize("name", ["crossing_ball", "door_frame", "gantry", "table", "wall"])
@pytest.mark.parametrize("time", [0.0, 2.5])
def test_shipped_scenes_are_clear_of_a_standing_op3(name: str, time: float) -> None:
    """Its soles about the origin, by MuJoCo."""
    q = op3().posture(op3().profile.postures.stand)
    q[:3] -= op3().points(q[None], ("l_sole", "r_sole"))[0].mean(axis=0)
    state = SceneState(scene := load_scene(name))
    poses, shapes, spec = state.at(time), state.shapes, mujoco.MjSpec.from_file(str(op3().profile.body_path))
    kinds = {ShapeKind.CYLINDER: mujoco.mjtGeom.mjGEOM_CYLINDER, ShapeKind.BOX: mujoco.mjtGeom.mjGEOM_BOX}
    for row, kind in enumerate(shapes.kinds):
        size, position = shapes.sizes[row].copy(), poses.position[row].copy()
        form = kinds.get(kind, mujoco.mjtGeom.mjGEOM_SPHERE)
        if kind == ShapeKind.HALF_SPACE:  # a slab as thick as far from its plane as no body reaches
            form, size = mujoco.mjtGeom.mjGEOM_BOX, np.array([5.0, 5.0, 0.5])
            position -= rotations.rotate(poses.quat[row], [0, 0, 0.5])
        spec.worldbody.add_geom(type=form, size=size, pos=position, quat=poses.quat[row])
    model = spec.compile()
    data = mujoco.MjData(model)
    data.qpos[:] = q
    mujoco.mj_kinematics(model, data)
    fixed = [geom for geom in range(model.ngeom) if model.geom_bodyid[geom] == 0][-len(shapes.kinds) :]
    own = [geom for geom in range(model.ngeom) if model.geom_bodyid[geom] != 0]
    assert len(own) > 10
    gaps = [mujoco.mj_geomDistance(model, data, a, b, 1.0, None) for a in own for b in fixed]
    assert min(gaps) > (0.0 if time else max(obstacle.margin for obstacle in scene.obstacles.values()))


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("{box:", "{bix:"),
        ("{box: {size: [0.2, 0.4, 0.01]}}", "half_space"),
        ("{box: {size: [0.2, 0.4, 0.01]}}", "{}"),
        ("sphere: {radius: 0.1}", "sphere: 0.1"),
        ("frame: stand", "frame: stnad"),
        ("0.4, 0.01]", "0, 0.01]"),
        ("radius: 0.02", "radius: -0.02"),
        ("pos: [0.3, 0, 0.2]", "pos: [0.3, .nan, 0.2]"),
        ("pos: [0.3, 0, 0.2]", "pos: [0.3, nan, 0.2]"),
        ("pos: [0.3, 0, 0.2]", "pos: [0.3, 0, 2e4]"),
        ("normal: [-1, 0, 0]", "normal: [0, 0, 0]"),
        ("quat: [1, 0, 0, 0]", "quat: [1, 1, 0, 0]"),
        ("influence: 0.06", "influence: 0.01"),
        ("influence: 0.06, margin: 0.01", "margin: 0.2"),
        ("margin: 0.01", "margin: -0.01"),
        ("to: [0, 0, 1], radius", "to: [0, 0, 0], radius"),
        ("  wall:", "  top:"),
        ("{time: 1, pos", "{pos"),
        ("time: 2.5", "time: 1"),
        ("time: 1,", "time: 0.001,"),
        ("time: 1,", "time: 0.02,"),
        ("2.5, pos: [2,", "2.5, pos: [2.1,"),
        ("quat: [-1, 0, 0, 0]", "quat: [0, 1, 0, 0]"),
        ("    loop: true", "    velocity: [0, 0, 1]"),
        ("    loop: true", "    at: {pos: [0, 0, 1]}"),
        ("velocity: [1, 0, 0], from", "loop: true, from"),
        ("velocity: [1, 0, 0], from", "from"),
        ("until: 2", "until: 1"),
        ("velocity: [1, 0, 0]", "velocity: [101, 0, 0]"),
        ("velocity: [1, 0, 0]", "velocity: 1"),
        ("description: one of each\n", ""),
        ("influence:", "influense:"),
        ("{radius: 0.1}", "{}"),
    ],
)
def test_refused_with_its_place(tmp_path: Path, old: str, new: str) -> None:
    assert old in GOOD
    with refuses(ConfigError, "mine.yaml"):
        load(GOOD.replace(old, new, 1), tmp_path)


def test_the_examples_of_the_page_are_good(tmp_path: Path, root: Path) -> None:
    page = (root / "docs" / "scenes.md").read_text(encoding="utf-8")
    blocks = [textwrap.dedent(block) for block in re.findall(r"(?:^    .*\n|^\n)+", page, re.MULTILINE)]
    whole = next(block for block in blocks if "name: mine\n" in block).strip("\n") + "\n"
    parts = [textwrap.indent(block.strip("\n"), "  ") for block in blocks if block.strip().startswith(("door", "ball"))]
    assert len(parts) == 2
    scene = load(whole + "\n".join(parts).replace("  ball:", "  path:", 1) + "\n", tmp_path)
    assert list(scene.obstacles) == ["top", "wall", "ball", "door", "path"]
