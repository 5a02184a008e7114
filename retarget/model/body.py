"""A robot or a virtual human as a kinematic tree: names, limits, and the arrays of the solver.

Conventions are MuJoCo's (see `retarget/_solver.pyi`): body 0 is the world, parents come first, and `q` holds a free
joint as xyz + wxyz and a ball as wxyz.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from enum import IntEnum
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from retarget.arithmetic import norms
from retarget.errors import ConfigError, suggest
from retarget.model.body_file import BodyFile, Root, compile_body, compile_body_text
from retarget.types import FloatArray, IntArray

if TYPE_CHECKING:
    from retarget import _solver


class JointType(IntEnum):
    """MuJoCo's numbers of joint types."""

    FREE = 0
    BALL = 1
    SLIDE = 2
    HINGE = 3


_VELOCITY_SUFFIXES = {
    JointType.FREE: ("_x", "_y", "_z", "_rx", "_ry", "_rz"),
    JointType.BALL: ("_rx", "_ry", "_rz"),
    JointType.SLIDE: ("",),
    JointType.HINGE: ("",),
}


@dataclass(frozen=True, eq=False)
class Frame:
    """A frame fixed to a body: position (3,) m and quat (4,) wxyz in the body's frame."""

    name: str
    body: int
    position: FloatArray
    quat: FloatArray


@dataclass(frozen=True, eq=False)
class Geom:
    """A shape on a body: kind and size (3,) as in MuJoCo, position (3,) m and quat (4,) wxyz.

    triangles (t, 3, 3) m: of a mesh, in the shape's frame. collides: False for visual shapes. colour: 0 to 1.
    """

    name: str
    body: int
    kind: str
    size: FloatArray
    position: FloatArray
    quat: FloatArray
    collides: bool
    triangles: FloatArray | None
    colour: tuple[float, float, float] | None


@dataclass(frozen=True, eq=False)
class BodyModel:
    """A kinematic tree of nb bodies (0 the world) and nj joints, with nq positions and nv velocities.

    parent (nb,); body_pos (nb,3) m, body_quat (nb,4) wxyz: in the parent's frame; mass (nb,) kg; com (nb,3) m.
    joint_body, joint_type (nj,); joint_axis, joint_pos (nj,3): in the body's frame; joint_qpos, joint_dof (nj,): first
    address in q and velocities. qpos0 (nq,). lower, upper (nv,): rad or m, infinite without limit. notes: on changes
    and unused parts.
    """

    source: str
    root: Root
    body_names: tuple[str, ...]
    joint_names: tuple[str, ...]
    dof_names: tuple[str, ...]
    frames: tuple[Frame, ...]
    geoms: tuple[Geom, ...]
    parent: IntArray
    body_pos: FloatArray
    body_quat: FloatArray
    mass: FloatArray
    com: FloatArray
    joint_body: IntArray
    joint_type: IntArray
    joint_axis: FloatArray
    joint_pos: FloatArray
    joint_qpos: IntArray
    joint_dof: IntArray
    qpos0: FloatArray
    lower: FloatArray
    upper: FloatArray
    notes: tuple[str, ...] = field(default=())

    @property
    def nq(self) -> int:
        """Number of position coordinates."""
        return len(self.qpos0)

    @property
    def nv(self) -> int:
        """Number of velocity coordinates (degrees of freedom)."""
        return len(self.dof_names)

    @property
    def total_mass(self) -> float:
        """Mass of all bodies, kg."""
        return float(self.mass.sum())

    def body_index(self, name: str) -> int:
        """Index of a body. Raises ConfigError with the nearest names."""
        return self._index("body", name, self.body_names)

    def joint_index(self, name: str) -> int:
        """Index of a joint. Raises ConfigError with the nearest names."""
        return self._index("joint", name, self.joint_names)

    def dof_index(self, name: str) -> int:
        """Index of a degree of freedom. Raises ConfigError with the nearest names."""
        return self._index("degree of freedom", name, self.dof_names)

    def frame(self, name: str) -> Frame:
        """Site of the file, or the origin of a body. Raises ConfigError."""
        for frame in self.frames:
            if frame.name == name:
                return frame
        names = tuple(frame.name for frame in self.frames) + self.body_names
        body = self._index("frame", name, names) - len(self.frames)
        return Frame(name, body, np.zeros(3), np.array([1.0, 0.0, 0.0, 0.0]))

    def posture(self, angles: Mapping[str, float]) -> FloatArray:
        """Posture (nq,) with these joint angles, rad, and the file's elsewhere. Raises ConfigError."""
        q = self.qpos0.copy()
        for joint, angle in angles.items():
            q[self.joint_qpos[self.joint_index(joint)]] = angle
        return q

    def chain_to_root(self, link: int) -> tuple[int, ...]:
        """Link and its ancestors, nearest first, without the world."""
        links = []
        while link > 0:
            links.append(link)
            link = int(self.parent[link])
        return tuple(links)

    def links_between(self, first: int, second: int) -> set[int]:
        """Links whose joints move one link relative to the other."""
        return set(self.chain_to_root(first)).symmetric_difference(self.chain_to_root(second))

    def moved_with(self, link: int) -> int:
        """Nearest link with a joint, from `link` up to the root; 0 without any."""
        moving = set(self.joint_body.tolist())
        return next((above for above in self.chain_to_root(link) if above in moving), 0)

    def scalar_joints(self) -> tuple[NDArray[np.bool_], IntArray]:
        """Mask (nv,) of hinges and slides, and the index of each DoF in q (nv,), -1 for the others."""
        address = np.full(self.nv, -1, dtype=np.int64)
        single = np.isin(self.joint_type, (JointType.SLIDE, JointType.HINGE))
        address[self.joint_dof[single]] = self.joint_qpos[single]
        return address >= 0, address

    @property
    def scalar_names(self) -> tuple[str, ...]:
        """Names of hinges and slides, in the order of the DoFs."""
        single, _ = self.scalar_joints()
        return tuple(name for name, kept in zip(self.dof_names, single, strict=True) if kept)

    def solver_body(self) -> "_solver.Body":
        """Tree for the compiled solver."""
        from retarget import _solver

        return _solver.Body(
            self.parent,
            self.body_pos,
            self.body_quat,
            self.mass,
            self.com,
            self.joint_body,
            self.joint_type,
            self.joint_axis,
            self.joint_pos,
            self.qpos0,
        )

    def _index(self, kind: str, name: str, names: tuple[str, ...]) -> int:
        if name not in names:
            raise ConfigError(f"unknown {kind}", where=self.source, found=name, next_step=suggest(name, names))
        return names.index(name)


def load_body(path: str | Path, *, root: Root | None = None) -> BodyModel:
    """Read an MJCF or URDF file; see `body_file.compile_body`."""
    return body_from_file(compile_body(Path(path), root=root))


def load_body_text(text: str, *, source: str, root: Root | None = None) -> BodyModel:
    """Read MJCF or URDF text; `source` names it in messages."""
    return body_from_file(compile_body_text(text, source=source, root=root))


def body_from_file(file: BodyFile) -> BodyModel:
    """Arrays of a compiled body."""
    model = file.model
    joint_type = _ints(model.jnt_type)
    joint_names = tuple(model.joint(i).name or f"joint_{i}" for i in range(model.njnt))
    # Limits of hinges and slides only.
    limited = np.asarray(model.jnt_limited, dtype=bool)
    lower, upper = np.full(model.nv, -np.inf), np.full(model.nv, np.inf)
    boxed = np.isin(joint_type, (JointType.SLIDE, JointType.HINGE)) & limited
    lower[model.jnt_dofadr[boxed]] = model.jnt_range[boxed, 0]
    upper[model.jnt_dofadr[boxed]] = model.jnt_range[boxed, 1]
    cones = [joint_names[i] for i in np.flatnonzero((joint_type == JointType.BALL) & limited)]
    return BodyModel(
        source=file.source,
        root=file.root,
        body_names=tuple(model.body(i).name or f"body_{i}" for i in range(model.nbody)),
        joint_names=joint_names,
        dof_names=tuple(
            name + suffix
            for name, kind in zip(joint_names, joint_type, strict=True)
            for suffix in _VELOCITY_SUFFIXES[JointType(kind)]
        ),
        frames=tuple(_frame(model, i) for i in range(model.nsite)),
        geoms=geoms_of(model),
        parent=_ints(model.body_parentid),
        body_pos=_floats(model.body_pos),
        body_quat=_directions(model.body_quat),
        mass=_floats(model.body_mass),
        com=_floats(model.body_ipos),
        joint_body=_ints(model.jnt_bodyid),
        joint_type=joint_type,
        joint_axis=_directions(model.jnt_axis),
        joint_pos=_floats(model.jnt_pos),
        joint_qpos=_ints(model.jnt_qposadr),
        joint_dof=_ints(model.jnt_dofadr),
        qpos0=np.array(model.qpos0, dtype=np.float64),
        lower=lower,
        upper=upper,
        notes=(*file.notes, *(f"limit of ball joint '{name}' not used: it is a cone, not a box" for name in cones)),
    )


def _frame(model: Any, index: int) -> Frame:
    return Frame(
        name=model.site(index).name or f"site_{index}",
        body=int(model.site_bodyid[index]),
        position=_floats(model.site_pos[index]),
        quat=_directions(model.site_quat[index]),
    )


NO_COLOUR = 0.5
"""Red, green and blue of a shape without a colour of its own."""


def geoms_of(model: Any) -> tuple[Geom, ...]:
    """Shapes of a `mujoco.MjModel`."""
    return tuple(_geom(model, index) for index in range(model.ngeom))


def _geom(model: Any, index: int) -> Geom:
    import mujoco

    kind = mujoco.mjtGeom(int(model.geom_type[index])).name.removeprefix("mjGEOM_").lower()
    material = int(model.geom_matid[index])
    own = model.geom_rgba[index, :3]
    shade = model.mat_rgba[material, :3] if material >= 0 and (own == NO_COLOUR).all() else own
    red, green, blue = (round(float(value), 3) for value in shade)
    triangles = None
    if kind == "mesh":
        mesh = int(model.geom_dataid[index])
        vertices, faces = (int(start[mesh]) for start in (model.mesh_vertadr, model.mesh_faceadr))
        corners = model.mesh_face[faces : faces + int(model.mesh_facenum[mesh])]
        triangles = _floats(model.mesh_vert[vertices:][corners])
    return Geom(
        name=model.geom(index).name,
        body=int(model.geom_bodyid[index]),
        kind=kind,
        size=_floats(model.geom_size[index]),
        position=_floats(model.geom_pos[index]),
        quat=_directions(model.geom_quat[index]),
        collides=bool(model.geom_contype[index] or model.geom_conaffinity[index]),
        triangles=triangles,
        colour=None if red == green == blue == NO_COLOUR else (red, green, blue),
    )


DECIMALS = 9
"""Decimals (m, kg) of MuJoCo's results, whose last bits differ between machines."""


def _floats(values: Any) -> FloatArray:
    rounded = np.round(np.array(values, dtype=np.float64, order="C"), DECIMALS)
    return np.asarray(rounded + 0.0)  # no -0


def _directions(values: Any) -> FloatArray:
    rounded = _floats(values)
    return np.ascontiguousarray(rounded / norms(rounded)[..., None])


def _ints(values: Any) -> IntArray:
    return np.array(values, dtype=np.int64, order="C")


@dataclass(frozen=True, eq=False)
class JointLimits:
    """Limits per DoF (nv,): position (rad or m), velocity per s, acceleration per s^2; infinite for no limit."""

    lower: FloatArray
    upper: FloatArray
    max_velocity: FloatArray
    max_acceleration: FloatArray

    @property
    def unhurried(self) -> "JointLimits":
        """The limits of position alone."""
        free = np.full_like(self.max_velocity, np.inf)
        return JointLimits(self.lower, self.upper, free, free)


def joint_weights(body: BodyModel, values: Iterable[tuple[str, float]], *, default: float) -> FloatArray:
    """One number per DoF (nv,): that of the last pair that names it, else `default`, or 0 for a free root.

    A name is a DoF (`l_knee_flexion`), a joint (`l_hip`), either without its side (`hip`), or `root`, the six DoFs of a
    free root. Raises ConfigError with the nearest names.
    """
    result = np.full(body.nv, default)
    for start, kind in zip(body.joint_dof, body.joint_type, strict=True):
        if kind == JointType.FREE:
            result[start : start + 6] = 0.0
    aliases = []
    for name in body.dof_names:
        unsided = name[2:] if name[:2] in ("l_", "r_") else name
        aliases.append({name, unsided, name.rsplit("_", 1)[0], unsided.rsplit("_", 1)[0]})
    for key, value in values:
        chosen = [i for i, names in enumerate(aliases) if key in names]
        if not chosen:
            known = sorted(set().union(*aliases))
            raise ConfigError("unknown joint", where=body.source, found=key, next_step=suggest(key, known))
        result[chosen] = value
    return result


# Joints with little mass, as of a head, which a balance task would swing between their limits.

LIGHT = 0.008
"""Greatest movement of the centre of mass by a light joint, per radian, relative to the size."""
LIGHT_POSTURES, TURNED = 64, 2.0
"""Number of postures, and greatest angle of their joints, rad."""
LIMB_ENDS = ("l_hand", "r_hand", "l_sole", "r_sole")
"""Frames at the ends of limbs, which have no light joints."""


def low_inertia_joints(body: BodyModel, frames: Mapping[str, Frame]) -> list[int]:
    """DoFs of light hinges outside limbs. frames: of the body, by name."""
    solver = body.solver_body()
    hinges = body.joint_type == JointType.HINGE
    columns, dofs = body.joint_qpos[hinges], body.joint_dof[hinges]
    random = np.random.default_rng(0)
    low, high = np.maximum(body.lower[dofs], -TURNED), np.minimum(body.upper[dofs], TURNED)
    most = np.zeros(body.nv)
    for _ in range(LIGHT_POSTURES):
        q = body.qpos0.copy()
        q[columns] = random.uniform(np.minimum(low, high), np.maximum(low, high))
        most = np.maximum(most, norms(solver.centre_of_mass_jacobian(q).T))
    limbs = {link for name in LIMB_ENDS if name in frames for link in body.chain_to_root(frames[name].body)}
    links = body.joint_body[hinges].tolist()
    every = np.arange(1, len(body.parent))
    origins = solver.points(body.qpos0[None], every.tolist(), np.zeros((len(every), 3)))[0]
    light = most[dofs] < LIGHT * float(np.ptp(origins[:, 2]))
    return [int(dof) for dof, link, is_light in zip(dofs, links, light, strict=True) if is_light and link not in limbs]
