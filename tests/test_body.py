"""A body as arrays: names, limits and addresses, and the same motion as MuJoCo."""

import mujoco
import numpy as np
import pytest
from numpy.testing import assert_allclose

from bodies import ALL_JOINTS_MJCF, TWO_LINK_URDF
from retarget.body import BodyModel, JointType, load_body_text
from retarget.errors import ConfigError
from retarget.human import build_human
from retarget.human_dimensions import proportional_dimensions
from retarget.rotations import FloatArray
from support.messages import refuses


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


def test_limits_are_a_box_and_cones_are_noted(body: BodyModel) -> None:
    assert_allclose(body.lower[[6, 7]], [-1.0, -0.1])
    assert_allclose(body.upper[[6, 7]], [2.0, 0.2])
    rest = np.delete(np.arange(12), [6, 7])
    assert np.all(np.isneginf(body.lower[rest])) and np.all(np.isposinf(body.upper[rest]))
    assert any("'ball'" in note and "cone" in note for note in body.notes)


def test_masses_are_the_files(body: BodyModel) -> None:
    assert body.total_mass == pytest.approx(7.0)
    assert_allclose(body.com[1], [0.02, 0.0, 0.0], atol=1e-12)
    urdf = load_body_text(TWO_LINK_URDF, source="two.urdf")
    assert urdf.total_mass == pytest.approx(3.0)
    assert_allclose(urdf.com[1], [0.1, 0.0, 0.0], atol=1e-12)


def test_frames_are_sites_and_links(body: BodyModel) -> None:
    assert body.frame("tool").body == 1 and body.frame("hand").body == 4
    assert_allclose(body.frame("tool").position, [0.0, 0.1, 0.0])
    with refuses(ConfigError):
        body.frame("tol")
    for lookup in (body.body_index, body.joint_index, body.dof_index):
        with refuses(ConfigError, "all.xml"):
            lookup("nothing")


def test_a_chain_has_its_link_and_the_root_and_not_the_world(body: BodyModel) -> None:
    links = [body.body_index(name) for name in ("hand", "lower", "upper", "base")]
    assert body.chain_to_root(links[0]) == tuple(links)
    assert body.chain_to_root(body.body_index("other")) == (body.body_index("other"), links[-1])
    assert body.chain_to_root(links[-1]) == (links[-1],) and body.chain_to_root(0) == ()
    assert body.links_between(links[0], body.body_index("other")) == {*links[:-1], body.body_index("other")}
    assert body.links_between(links[1], links[0]) == {links[0]} and body.links_between(links[0], links[0]) == set()


@pytest.mark.parametrize("text", [ALL_JOINTS_MJCF, TWO_LINK_URDF, "human"])
def test_the_solver_moves_the_body_as_mujoco_does(text: str) -> None:
    if text == "human":
        text = build_human(proportional_dimensions(1.7)).mjcf
    body = load_body_text(text, source="test")
    spec = mujoco.MjSpec.from_string(text)
    spec.compiler.fusestatic = False
    model = spec.compile()
    data, solver = mujoco.MjData(model), body.solver_body()
    assert (solver.nq, solver.nv, solver.nbody) == (model.nq, model.nv, model.nbody)
    assert_allclose(solver.rest(), model.qpos0)
    rng = np.random.default_rng(3)
    for _ in range(5):
        data.qpos[:] = posture = _random_posture(model, rng)
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


def _random_posture(model: mujoco.MjModel, rng: np.random.Generator) -> FloatArray:
    posture = np.array(model.qpos0)
    mujoco.mj_integratePos(model, posture, rng.normal(size=model.nv), 1.0)
    return posture
