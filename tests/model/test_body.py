"""A body as arrays and files: what is accepted, names, limits and addresses, and the same motion as MuJoCo."""

import os
import resource
import shutil
import signal
import sys
from collections.abc import Callable
from functools import partial
from pathlib import Path

import mujoco
import numpy as np
import pytest
from numpy.testing import assert_allclose

from followers import DT, op3, shipped
from messages import Facts, refuses, shows
from observed import ALL_JOINTS_MJCF, TWO_LINK_URDF
from retarget import _solver
from retarget.errors import ConfigError, InputError, Problem
from retarget.model.body import (
    BodyModel,
    JointType,
    body_from_file,
    joint_weights,
    load_body,
    load_body_text,
    low_inertia_joints,
)
from retarget.model.body_file import compile_body_text
from retarget.model.body_xml import MAX_BYTES, MAX_LINKS
from retarget.model.compile_limits import MEMORY, try_in_child
from retarget.model.human import build_human
from retarget.model.human_dimensions import proportional_dimensions
from retarget.robot.landmarks import robot_frames
from retarget.schema.catalogue import shipped_folder


@pytest.fixture(scope="module")
def body() -> BodyModel:
    return load_body_text(ALL_JOINTS_MJCF, source="all.xml")


def test_names_types_and_addresses(body: BodyModel) -> None:
    assert body.body_names == ("world", "base", "upper", "lower", "hand", "other")
    assert body.joint_names == ("root", "twist", "rail", "ball", "joint_4")
    assert list(body.joint_type) == [JointType.FREE, JointType.HINGE, JointType.SLIDE, JointType.BALL, JointType.HINGE]
    assert (body.nq, body.nv) == (14, 12)
    assert list(body.joint_qpos) == [0, 7, 8, 9, 13] and list(body.joint_dof) == [0, 6, 7, 8, 11]
    assert body.dof_names[:6] == ("root_x", "root_y", "root_z", "root_rx", "root_ry", "root_rz")
    assert body.dof_names[6:] == ("twist", "rail", "ball_rx", "ball_ry", "ball_rz", "joint_4")
    assert np.all(body.parent[1:] < np.arange(1, 6)), "a parent comes before its children"
    single, address = body.scalar_joints()
    assert list(np.flatnonzero(single)) == [6, 7, 11] and list(address[single]) == [7, 8, 13]
    # A chain has its link and the root, and not the world.
    hand, *rest = links = [body.body_index(name) for name in ("hand", "lower", "upper", "base")]
    other = body.body_index("other")
    assert body.chain_to_root(hand) == tuple(links)
    assert body.chain_to_root(other) == (other, links[-1])
    assert body.chain_to_root(links[-1]) == (links[-1],) and body.chain_to_root(0) == ()
    assert body.links_between(hand, other) == {*links[:-1], other}
    assert body.links_between(rest[0], hand) == {hand} and body.links_between(hand, hand) == set()


def test_last_bits_of_the_compiler_are_not_in_a_body() -> None:
    """MuJoCo computes masses and frames with the C library of the machine."""
    text = (Path(__file__).resolve().parents[2] / "configs/robots/poppy/body.xml").read_text(encoding="utf-8")
    file = compile_body_text(text, source="body.xml", root="free")
    body, model = body_from_file(file), file.model
    for values in (model.body_pos, model.body_quat, model.body_mass, model.body_ipos, model.jnt_axis, model.jnt_pos):
        values *= 1.0 + 3e-13
        values[values == 0.0] = -1e-17
    for values in (model.site_pos, model.site_quat, model.geom_pos, model.geom_quat, model.geom_size):
        values *= 1.0 - 3e-13
    other = body_from_file(file)
    for name in ("body_pos", "body_quat", "mass", "com", "joint_axis", "joint_pos"):
        assert getattr(other, name).tobytes() == getattr(body, name).tobytes(), name
    for name in ("frames", "geoms"):
        for ours, theirs in zip(getattr(other, name), getattr(body, name), strict=True):
            assert (ours.position.tobytes(), ours.quat.tobytes()) == (theirs.position.tobytes(), theirs.quat.tobytes())
    for directions in (body.body_quat, body.joint_axis):
        assert_allclose(np.square(directions).sum(axis=-1), 1.0, rtol=1e-15)
    assert body.upper[np.isfinite(body.upper)].tolist() == model.jnt_range[model.jnt_limited == 1, 1].tolist()


@pytest.mark.parametrize("text", [ALL_JOINTS_MJCF, TWO_LINK_URDF, "human"])
def test_the_solver_moves_the_body_as_mujoco_does(text: str) -> None:
    if text == "human":
        text = build_human(proportional_dimensions(1.7)).mjcf
    body = load_body_text(text, source="test")
    spec = mujoco.MjSpec.from_string(text)
    spec.compiler.fusestatic = False
    model = spec.compile()
    data, solver = mujoco.MjData(model), body.solver_body()
    assert (solver.nq, solver.nv) == (model.nq, model.nv)
    assert_allclose(solver.rest(), model.qpos0)
    rng = np.random.default_rng(3)
    for _ in range(5):
        posture = np.array(model.qpos0)
        mujoco.mj_integratePos(model, posture, rng.normal(size=model.nv), 1.0)
        data.qpos[:] = posture
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        position, quat = solver.forward(posture)
        assert_allclose(position, data.xpos, atol=1e-12)
        assert_allclose(np.abs(np.sum(quat * data.xquat, axis=1)), 1.0, atol=1e-12)
        assert_allclose(solver.centre_of_mass(posture[None])[0], data.subtree_com[0], atol=1e-9)
        linear, angular = np.zeros((3, model.nv)), np.zeros((3, model.nv))
        last, point = model.nbody - 1, np.array([0.1, -0.2, 0.3])
        world = data.xpos[last] + data.xmat[last].reshape(3, 3) @ point
        mujoco.mj_jac(model, data, linear, angular, world, last)
        assert_allclose(solver.frame_jacobian(posture, last, tuple(point)), np.vstack([linear, angular]), atol=1e-12)


@pytest.mark.parametrize(
    ("robot", "light", "heavy"),
    [
        ("op3", {"head_pan", "head_tilt"}, {"l_sho_pitch", "l_el", "l_knee", "r_hip_roll"}),
        ("wolfgang", {"HeadPan", "HeadTilt"}, {"LShoulderPitch", "LElbow", "LKnee", "RHipRoll"}),
        ("toddlerbot", {"neck_yaw", "neck_pitch"}, {"left_elbow_roll", "left_knee", "waist_roll"}),
        ("poppy", {"head_y", "head_z"}, {"l_knee_y", "l_shoulder_x", "abs_y"}),
    ],
)
def test_heads_are_light_and_legs_and_trunks_are_not(robot: str, light: set[str], heavy: set[str]) -> None:
    body = shipped(robot).body
    names = {body.dof_names[dof] for dof in low_inertia_joints(body, robot_frames(shipped(robot)))}
    assert names >= light and not names & heavy


def test_unknown_names_are_refused() -> None:
    with refuses(ConfigError):
        joint_weights(build_human(proportional_dimensions(1.7)).body, [("l_nkee", 1.0)], default=1.0)


@pytest.mark.parametrize("without", [[], [0], [3, 1]])
def test_a_support_is_kept_by_the_others_alone(without: list[int]) -> None:
    """The mass of a free body is pushed back along x: by those that may, the least way."""
    body = op3().body
    solver_body, q = body.solver_body(), op3().posture(op3().profile.postures.stand)
    com = solver_body.centre_of_mass(q[None])[0]
    wide = np.full(body.nv, np.inf)
    solver = _solver.Solver(
        solver_body,
        [[_solver.Task.support(1, without=without)]],
        lower=-wide,
        upper=wide,
        max_velocity=wide,
        max_acceleration=wide,
        locked=np.zeros(body.nv, dtype=np.bool_),
        n_ik=1,
    )
    solver.reset(q)
    moved = solver_body.difference(q, solver.frame(np.array([1.0, 1.0, 0.0, 0.0, com[0] - 0.01]), DT))
    column = solver_body.centre_of_mass_jacobian(q)[0]
    column[without] = 0.0
    assert np.abs(moved[without]).max(initial=0.0) < 1e-12
    assert np.abs(moved).max() > 1e-3
    along = moved @ column / np.linalg.norm(moved) / np.linalg.norm(column)
    assert along == pytest.approx(-1.0, abs=0.05)


FREE_MJCF = """<mujoco><worldbody><body name="base"><freejoint name="root"/><geom size="0.1" mass="2"/>
  <body name="arm" pos="0 0 1"><joint name="swing" axis="0 1 0"/><geom size="0.1" mass="1"/></body></body></worldbody>
  <keyframe><key qpos="0 0 1 1 0 0 0 0.5"/></keyframe></mujoco>"""


def test_a_urdf_keeps_every_link_and_stays_fixed_unless_the_caller_frees_it() -> None:
    file = compile_body_text(TWO_LINK_URDF, source="robot.urdf")
    names = [file.model.body(i).name for i in range(file.model.nbody)]
    assert names == ["world", "base", "arm", "tip"]
    assert file.root == "fixed" and file.model.nv == 1 and file.notes == ()
    # A root link that is the world: the free root is on the link above.
    weld = '<joint name="weld" type="fixed"><parent link="world"/><child link="base"/></joint>'
    urdf = TWO_LINK_URDF.replace('<link name="tip"/>', '<link name="tip"/><link name="world"/>' + weld)
    body = load_body_text(urdf, source="robot.urdf", root="free")
    assert body.nv == 7 and body.frame("base").body == 1


def test_a_removed_root_missing_meshes_loops_and_tendons_are_named_in_notes() -> None:
    for root in ("fixed", "suspended"):
        body = load_body_text(FREE_MJCF, source="robot.xml", root=root)
        assert body.root == root and body.dof_names == ("swing",)
        assert any("removed" in note for note in body.notes)
    shape = '<collision><geometry><mesh filename="package://absent/arm.stl"/></geometry></collision></link>'
    body = load_body_text(TWO_LINK_URDF.replace("</link><!-- arm -->", shape), source="robot.urdf")
    assert body.total_mass == pytest.approx(3.0) and any("mesh" in note for note in body.notes)
    extra = """<equality><joint name="coupled" joint1="swing"/></equality>
      <tendon><fixed name="cord"><joint joint="swing" coef="1"/></fixed></tendon></mujoco>"""
    shows(" ".join(load_body_text(FREE_MJCF.replace("</mujoco>", extra), source="robot.xml").notes), 1)


@pytest.mark.parametrize(
    ("text", "facts"),
    [
        ("", ()),
        ("frame 1", ()),
        ("<html><body/></html>", "<html>"),
        ("<mujoco/>", ()),
        ("\ud800", ()),
        ("<mujoco><worldbody><body/></worldbody></mujoco>", ()),
        ('<mujoco><worldbody><body><joint type="screw"/></body></worldbody></mujoco>', "screw"),
        (FREE_MJCF.replace('axis="0 1 0"', 'axis="0 1 0" range="2 1" limited="true"'), "range"),
        (TWO_LINK_URDF.replace('xyz="0 0 0.5"', 'xyz="0 0 nan"'), "arm"),
        (FREE_MJCF.replace('mass="1"', 'mass="1" pos="0 0 nan"'), "arm"),
        (FREE_MJCF.replace('pos="0 0 1"', 'pos="0 nan 1"'), "arm"),
        (FREE_MJCF.replace('axis="0 1 0"', 'axis="0 1 0" pos="0 inf 0"'), "swing"),
        (FREE_MJCF.replace("<worldbody>", '<worldbody><body name="ball"><freejoint/><geom size="1"/></body>'), "ball"),
    ],
)
def test_bad_text_is_refused_with_its_reason(text: str, facts: Facts) -> None:
    with refuses(InputError, "robot.xml", facts):
        load_body_text(text, source="robot.xml")


def test_two_root_links_cannot_be_set_free() -> None:
    mjcf = "<mujoco><worldbody>" + '<body><joint/><geom size="1"/></body>' * 2 + "</worldbody></mujoco>"
    with refuses(InputError):
        load_body_text(mjcf, source="two.xml", root="free")
    one = mjcf.replace("</body><body>", "</body><!--").replace("</body></w", "--></w")
    with refuses(InputError):
        load_body_text(one, source="one.xml", root="free")


def test_bad_files_are_refused(tmp_path: Path) -> None:
    chain = '<robot name="a">' + 3000 * '<link name="c"/>' + '<link name="b"/></robot>'
    latin = TWO_LINK_URDF.replace("arm", "\xe9").encode("latin-1")
    contents = {"binary": bytes(range(256)), "latin": latin, "empty": b"", "huge": bytes(MAX_BYTES + 1)}
    facts: dict[str, Facts] = {"empty.xml": 0, "chain.xml": (3001, MAX_LINKS)}
    for name, content in (contents | {"chain": chain.encode()}).items():
        (tmp_path / f"{name}.xml").write_bytes(content)
    for name in ("binary.xml", "latin.xml", "empty.xml", "huge.xml", "chain.xml", ".", "absent.xml"):
        with refuses(InputError, facts.get(name, ())) as error:
            load_body(tmp_path / name)
        assert str(tmp_path / name) in str(error.value)


# Large sizes in a few bytes, and what a child process finds.

SIZED = """<mujoco>{size}<asset>{asset}</asset><worldbody>
<body name="link"><joint/><geom size="0.1"/>{link}</body>{world}
</worldbody>{rest}</mujoco>"""
COPIED = '<worldbody><replicate count="9"><site/></replicate></worldbody>'
WHOLE = {"size": "", "asset": "", "link": "", "world": "", "rest": ""}


@pytest.mark.parametrize(
    ("part", "text", "line", "facts"),
    [
        ("asset", '<hfield name="h" nrow="40000" ncol="40" size="1 1 1 1"/>', 1, ("nrow", "40000")),
        ("asset", '<texture name="t" type="2d" builtin="flat" width="9000" height="9"/>', 1, ("width", "9000")),
        ("asset", '<mesh name="m" builtin="cone" params="100000000 0.1"/>', 1, "params"),
        ("size", '<size nkey="2000000000"/>', 1, ("nkey", "2000000000")),
        ("size", '<size nkey="2000000000 keys"/>', 1, "nkey"),
        ("size", '<size nuser_geom="1000000"/>', 1, "nuser_geom"),
        ("size", '<size nuserdata="1e400"/>', 1, "nuserdata"),
        ("size", '<size memory="900G"/>', 1, ("memory", "900G")),
        ("world", '<replicate count="100000000"><geom size="0.1"/></replicate>', 2, "<replicate>"),
        ("world", '<replicate count="90">' * 3 + '<geom size="1"/>' + "</replicate>" * 3, 2, "<replicate>"),
        ("world", '<replicate count="-1"><replicate count="9000"><site/></replicate></replicate>', 2, "<replicate>"),
        ("world", '<flexcomp name="f" type="grid" count="40 40 40" dim="3" mass="1"/>', 2, ("count", "40 40 40")),
        ("link", '<composite type="cable" count="90000 1 1"/>', 2, "count"),
        ("link", '<camera name="c" resolution="90000 90000"/>', 2, "resolution"),
        ("rest", '<sensor><user name="u" dim="1000000000"/></sensor>', 3, "dim"),
        ("rest", "<sensor><clock/></sensor>" + COPIED, 3, "<clock>"),
        ("rest", '<size xmlns="elsewhere" nkey="2000000000"/>', 3, "nkey"),
    ],
)
def test_a_size_that_no_robot_needs_is_refused_with_its_line(
    part: str, text: str, line: int, facts: Facts, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Before MuJoCo sees it, which takes all memory for some of these."""
    monkeypatch.setattr("retarget.model.body_file.engine", lambda: None)
    mjcf = SIZED.format(**{**WHOLE, part: text})
    with refuses(InputError, facts, where=f"robot.xml:{line}"):
        load_body_text(mjcf, source="robot.xml")
    (tmp_path / "main.xml").write_text('<mujoco><include file="part.xml"/></mujoco>')
    (tmp_path / "part.xml").write_text(mjcf)
    with refuses(InputError, where=f"part.xml:{line}"):
        load_body(tmp_path / "main.xml")


def test_links_are_counted_as_often_as_they_are_repeated(tmp_path: Path) -> None:
    leg, legs = '<body><joint/><geom size="1"/></body>', '<replicate count="600"><include file="leg.xml"/></replicate>'
    (tmp_path / "main.xml").write_text(f"<mujoco><worldbody>{legs}</worldbody></mujoco>")
    (tmp_path / "leg.xml").write_text(f"<mujocoinclude>{leg}</mujocoinclude>")
    with refuses(InputError, 600, MAX_LINKS):
        load_body(tmp_path / "main.xml")


def test_sizes_that_robots_have_are_read() -> None:
    few = '<size nkey="3" nuserdata="10" nuser_geom="2" memory="20M"/>'
    texture = '<texture name="t" type="skybox" builtin="gradient" width="512" height="3072"/>'
    legs = '<replicate count="3" euler="0 0 60"><body pos="1 0 0"><joint/><geom size="0.1"/></body></replicate>'
    body = load_body_text(SIZED.format(**{**WHOLE, "size": few, "asset": texture, "world": legs}), source="robot.xml")
    assert len(body.body_names) == 1 + 1 + 3


def take_time() -> None:
    resource.setrlimit(resource.RLIMIT_CPU, (0, resource.getrlimit(resource.RLIMIT_CPU)[1]))
    while True:
        pass


def refuse() -> None:
    raise InputError.from_problems([Problem("one", "a:1", line=1), Problem("two", "a:2", line=2)], title="2 problems")


@pytest.mark.parametrize(
    ("work", "facts"),
    [
        (lambda: bytearray(2 * MEMORY), "1000 MB"),
        (take_time, "30 s of a processor"),
        (refuse, ("a:1", "a:2")),
        (partial(signal.raise_signal, signal.SIGTERM), "(-15)"),
        (partial(os._exit, 5), "(5)"),
    ],
)
def test_what_takes_too_much_or_ends_the_process_does_no_harm(work: Callable[[], None], facts: Facts) -> None:
    with refuses(InputError, facts):
        try_in_child(work, source="body.xml")


def test_what_fits_is_done_and_prints_nothing(capfd: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    """A defect of ours is left to show where the work is done again."""

    def work() -> None:
        sys.stdout.write("said")
        os.write(2, b"said")
        (tmp_path / "done").touch()

    try_in_child(work, source="body.xml")
    try_in_child(lambda: 1 // 0, source="body.xml")
    assert (tmp_path / "done").exists() and capfd.readouterr() == ("", "")


def test_only_what_is_not_shipped_is_tried_in_a_child_and_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    tried: list[str] = []
    monkeypatch.setattr("retarget.model.body_file.try_in_child", lambda work, source: tried.append(source))
    shipped = shipped_folder() / "robots/op3/body.xml"
    copy = tmp_path / "body.xml"
    load_body(shipped)
    assert tried == []
    shutil.copyfile(shipped, copy)
    load_body(copy)
    load_body(copy, root="fixed")
    assert tried == [str(copy)]
    copy.write_bytes(copy.read_bytes() + b"\n")
    load_body(copy)
    assert tried == [str(copy)] * 2


def test_a_body_that_takes_all_memory_by_sizes_that_are_allowed_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("retarget.model.compile_limits.MEMORY", 100_000_000)
    pictures = '<texture name="t{}" type="2d" builtin="flat" width="4096" height="4096"/>'
    text = SIZED.format(**{**WHOLE, "asset": "".join(map(pictures.format, range(9)))})
    with refuses(InputError):
        load_body_text(text, source="robot.xml")
