"""Random trees of links as MJCF text, and their arrays as MuJoCo compiled them, for the solver's `Body`."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np
from numpy.random import Generator

from oracles.problem import Array


@dataclass(frozen=True)
class Tree:
    """A compiled MuJoCo model with its data, and a posture away from rest."""

    model: Any
    data: Any
    q: Array

    def at(self, q: Array) -> Tree:
        """This tree with MuJoCo's kinematics and centres of mass computed at q (nq,)."""
        self.data.qpos[:] = q
        mujoco.mj_kinematics(self.model, self.data)
        mujoco.mj_comPos(self.model, self.data)
        return self

    def body_arguments(self) -> tuple[Any, ...]:
        """Arguments of `retarget._solver.Body`, taken from the compiled model."""
        m = self.model
        whole = [np.asarray(a, dtype=np.int64) for a in (m.body_parentid, m.jnt_bodyid, m.jnt_type)]
        real = [np.array(a, dtype=np.float64) for a in (m.body_pos, m.body_quat, m.body_mass, m.body_ipos)]
        joint = [np.array(a, dtype=np.float64) for a in (m.jnt_axis, m.jnt_pos, m.qpos0)]
        return (whole[0], *real, whole[1], whole[2], *joint)


def random_tree(seed: int) -> Tree:
    """A tree of 3 to 14 links under the world: free, fixed or jointed roots, up to three joints on a link."""
    rng = np.random.default_rng(seed)
    parents = [int(rng.integers(-1, k)) for k in range(int(rng.integers(3, 15)))]
    xml = f"<mujoco><compiler angle='radian'/><worldbody>{children(-1, parents, rng)}</worldbody></mujoco>"
    model = mujoco.MjModel.from_xml_string(xml)
    q = model.qpos0.copy()
    mujoco.mj_integratePos(model, q, rng.normal(size=model.nv), 1.0)
    return Tree(model, mujoco.MjData(model), q)


def children(of: int, parents: list[int], rng: Generator) -> str:
    """MJCF of all links below link `of`."""
    return "".join(link(k, parents, rng) for k, parent in enumerate(parents) if parent == of)


def link(k: int, parents: list[int], rng: Generator) -> str:
    """MJCF of one link with its joints, mass and children."""
    joints = random_joints(rng, root=parents[k] == -1)
    mass = rng.uniform(0.1, 3.0)
    inertial = f"<inertial pos='{numbers(rng, 3)}' mass='{mass}' diaginertia='1 1 1'/>"
    place = f"pos='{numbers(rng, 3)}' quat='{numbers(rng, 4)}'"
    return f"<body name='b{k}' {place}>{joints}{inertial}{children(k, parents, rng)}</body>"


def random_joints(rng: Generator, *, root: bool) -> str:
    """Joints of one link, in MuJoCo's legal combinations: free alone, a ball last, any hinges and slides."""
    if root and rng.random() < 0.6:
        return "<freejoint/>"
    kinds = [str(kind) for kind in rng.choice(["hinge", "slide"], size=int(rng.integers(0, 4)))]
    if rng.random() < 0.25:
        kinds = [*(kind for kind in kinds if kind == "slide"), "ball"]
    return "".join(joint(kind, rng) for kind in kinds)


def joint(kind: str, rng: Generator) -> str:
    """MJCF of one joint; hinges and slides rest at a reference that is not zero."""
    if kind == "ball":
        return f"<joint type='ball' pos='{numbers(rng, 3)}'/>"
    return f"<joint type='{kind}' axis='{numbers(rng, 3)}' pos='{numbers(rng, 3)}' ref='{rng.normal():.6f}'/>"


def numbers(rng: Generator, size: int) -> str:
    """Random numbers as MJCF writes them."""
    return " ".join(f"{value:.6f}" for value in rng.normal(size=size) * 0.5)
