"""The proposed shapes on the robot's tree, as a MuJoCo model that tells the distance between any two of them."""

from typing import Any

import numpy as np

from retarget.body import BodyModel, JointType
from retarget.fitting.box import Box
from retarget.fitting.capsule import Capsule
from retarget.fitting.geometry import Lone
from retarget.fitting.proposals import Proposal
from retarget.rotations import FloatArray

__all__ = ["Pair", "ShapeModel"]

FAR = 1e3
"""[m] distances beyond this are not told apart."""

Pair = tuple[int, int]
"""Two shapes by their place in the list of proposals, the smaller one first."""


class ShapeModel:
    """Shapes in one posture at a time."""

    def __init__(self, body: BodyModel, proposals: tuple[Proposal, ...]) -> None:
        import mujoco

        self._mujoco = mujoco
        self._model = _compile(mujoco, body, proposals)
        self._data = mujoco.MjData(self._model)
        self._reach = np.array(self._model.geom_rbound)

    @property
    def nv(self) -> int:
        """Number of velocity coordinates, those of the body."""
        return int(self._model.nv)

    def place(self, q: FloatArray) -> None:
        """Take the posture q (nq,)."""
        self._data.qpos[:] = q
        self._mujoco.mj_kinematics(self._model, self._data)

    def distance(self, pair: Pair) -> float:
        """Distance of two shapes, m, negative inside."""
        return float(self._mujoco.mj_geomDistance(self._model, self._data, pair[0], pair[1], FAR, None))

    def at_least(self, first: Any, second: Any) -> FloatArray:
        """Lower bounds (k,) of the distances of shapes first (k,) and second (k,), m: of the balls around them."""
        centres = self._data.geom_xpos
        gaps = np.linalg.norm(centres[first] - centres[second], axis=1)
        return np.asarray(gaps - self._reach[first] - self._reach[second])

    def moved(self, q: FloatArray, step: FloatArray) -> FloatArray:
        """The posture (nq,) after a step (nv,) from q."""
        after = q.copy()
        self._mujoco.mj_integratePos(self._model, after, step, 1.0)
        return after


def _compile(mujoco: Any, body: BodyModel, proposals: tuple[Proposal, ...]) -> Any:
    spec = mujoco.MjSpec()
    spec.compiler.degree = False
    links = [spec.worldbody]
    for link in range(1, len(body.body_names)):
        part = links[body.parent[link]].add_body(name=f"link{link}", pos=body.body_pos[link], quat=body.body_quat[link])
        part.mass, part.inertia, part.explicitinertial = 1.0, np.ones(3), True  # only shapes matter here
        links.append(part)
    for joint, link in enumerate(body.joint_body):
        kind = JointType(body.joint_type[joint])
        if kind is JointType.FREE:
            links[link].add_freejoint()
            continue
        part = links[link].add_joint(
            type=mujoco.mjtJoint(int(kind)), axis=body.joint_axis[joint], pos=body.joint_pos[joint]
        )
        if kind is not JointType.BALL:
            part.ref = body.qpos0[body.joint_qpos[joint]]
    for proposal in proposals:
        _add(mujoco, links[proposal.link], proposal.shape)
    model = spec.compile()
    # Geoms come in the order of links, as proposals do: their numbers are the same.
    assert [int(link) for link in model.geom_bodyid] == [proposal.link for proposal in proposals]
    assert np.array_equal(model.body_parentid, body.parent)
    return model


def _add(mujoco: Any, link: Any, shape: Capsule | Box | Lone) -> None:
    kinds = mujoco.mjtGeom
    if isinstance(shape, Box):
        link.add_geom(type=kinds.mjGEOM_BOX, pos=shape.pos, quat=shape.quat, size=shape.size)
    elif isinstance(shape, Lone):
        kind = kinds.mjGEOM_BOX if shape.kind == "box" else kinds.mjGEOM_CYLINDER
        link.add_geom(type=kind, pos=shape.pos, quat=shape.quat, size=shape.size)
    elif shape.is_ball:
        link.add_geom(type=kinds.mjGEOM_SPHERE, pos=shape.start, size=[shape.radius, 0.0, 0.0])
    else:
        ends = np.concatenate([shape.start, shape.end])
        link.add_geom(type=kinds.mjGEOM_CAPSULE, fromto=ends, size=[shape.radius, 0.0, 0.0])
