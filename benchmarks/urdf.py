"""A body of hinges under a free root as URDF text, for peers that read nothing else."""

from __future__ import annotations

from collections.abc import Mapping
from xml.sax.saxutils import quoteattr

import numpy as np

from benchmarks.bodies import BenchBody, Floats
from retarget import rotations
from retarget.model.body import JointType

INERTIA = "<inertia ixx='1e-4' iyy='1e-4' izz='1e-4' ixy='0' ixz='0' iyz='0'/>"
UNBOUNDED = 1e3  # rad, where the body sets no limit


def write_urdf(body: BenchBody, shapes: Mapping[str, str] | None = None) -> str:
    """Links and joints keep their names, further joints of a link get links of their own, points become `bench_NAME`.

    shapes: XML with the collision shapes of a link, by its name. Inertias are placeholders: only masses and centres of
    mass matter here. Raises ValueError for what URDF cannot say.
    """
    shapes = {} if shapes is None else shapes
    model = body.model
    root = model.parent.tolist().index(0, 1)
    if model.parent[2:].min(initial=1) == 0 or model.joint_type[0] != JointType.FREE or np.any(model.joint_pos):
        raise ValueError(f"{body.name}: not one tree of joints at link origins under a free root")
    name = model.body_names[root]
    lines = [link(name, model.mass[root], model.com[root], shapes.get(name, ""))]
    for index in range(root + 1, len(model.body_names)):
        lines += chain(body, index, shapes.get(model.body_names[index], ""))
    for point in body.points:
        lines.append(link(f"bench_{point.name}", 0.0, np.zeros(3)))
        joint = f"bench_{point.name}_mount"
        lines.append(fixed(joint, point.link, f"bench_{point.name}", np.array(point.at), np.array([1.0, 0, 0, 0])))
    return "\n".join([f"<robot name={quoteattr(body.name)}>", *lines, "</robot>"])


def chain(body: BenchBody, index: int, shapes: str = "") -> list[str]:
    """The link of one body with its shapes, and its joints in order, from the parent's link."""
    model = body.model
    parent, name = model.body_names[model.parent[index]], model.body_names[index]
    position, quat = model.body_pos[index], model.body_quat[index]
    moving = [j for j in np.flatnonzero(model.joint_body == index) if not body.locked[model.joint_dof[j]]]
    lines = [link(name, model.mass[index], model.com[index], shapes)]
    if not moving:
        return [*lines, fixed(f"{name}_mount", parent, name, position, quat)]
    for j in moving:
        if model.joint_type[j] != JointType.HINGE or model.qpos0[model.joint_qpos[j]] != 0.0:
            raise ValueError(f"joint '{model.joint_names[j]}': only hinges that rest at zero")
        child = name if j == moving[-1] else f"{model.joint_names[j]}_link"
        if child != name:
            lines.append(link(child, 0.0, np.zeros(3)))
        lines.append(hinge(body, int(j), parent, child, position, quat))
        parent, position, quat = child, np.zeros(3), np.array([1.0, 0.0, 0.0, 0.0])
    return lines


def link(name: str, mass: float, com: Floats, shapes: str = "") -> str:
    """A link with mass and centre of mass, and what else stands in it."""
    inertial = f"<inertial><origin xyz='{text(com)}'/><mass value='{mass:.17g}'/>{INERTIA}</inertial>"
    return f"<link name={quoteattr(name)}>{inertial}{shapes}</link>"


def hinge(body: BenchBody, j: int, parent: str, child: str, position: Floats, quat: Floats) -> str:
    """A revolute joint with its limits."""
    model = body.model
    dof = model.joint_dof[j]
    lower, upper = np.clip([model.lower[dof], model.upper[dof]], -UNBOUNDED, UNBOUNDED)
    limit = f"<limit lower='{lower:.17g}' upper='{upper:.17g}' velocity='{body.max_speed:.17g}' effort='100'/>"
    axis = f"<axis xyz='{text(model.joint_axis[j])}'/>"
    return joint(model.joint_names[j], "revolute", parent, child, place(position, quat) + axis + limit)


def fixed(name: str, parent: str, child: str, position: Floats, quat: Floats) -> str:
    """A joint that does not move."""
    return joint(name, "fixed", parent, child, place(position, quat))


def joint(name: str, kind: str, parent: str, child: str, inner: str) -> str:
    """Any joint."""
    ends = f"<parent link={quoteattr(parent)}/><child link={quoteattr(child)}/>"
    return f"<joint name={quoteattr(name)} type='{kind}'>{ends}{inner}</joint>"


def place(position: Floats, quat: Floats) -> str:
    """Origin of a joint: metres, and roll, pitch, yaw of a wxyz quaternion."""
    R = rotations.to_matrix(quat)
    pitch = np.arctan2(-R[2, 0], np.hypot(R[0, 0], R[1, 0]))
    roll, yaw = np.arctan2(R[2, 1], R[2, 2]), np.arctan2(R[1, 0], R[0, 0])
    return f"<origin xyz='{text(position)}' rpy='{text(np.array([roll, pitch, yaw]))}'/>"


def text(values: Floats) -> str:
    """Numbers that read back exactly."""
    return " ".join(f"{value:.17g}" for value in values)
