"""Proposed observers: a capsule per link, or a flat shape where a capsule is far too large; and their distances."""

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from retarget.errors import UsageError
from retarget.model.body import BodyModel, JointType
from retarget.rotations import normalise, to_matrix
from retarget.setup.enclosing_shapes import (
    Box,
    Capsule,
    LinkGeometry,
    Lone,
    directions,
    distances_to_segment,
    enclosing_box,
    enclosing_capsule,
)
from retarget.types import FloatArray

DIGITS = 5
"""Decimals of lengths in m: shapes are rounded outwards to them, so that what is written still encloses."""
FAR_TOO_LARGE = 3.0
"""A capsule of so many times the other shape's volume gives way to it."""
SOMEWHAT_LARGE = 2.0
"""So does one of so many times, if it also stands out of the geometry by more than the influence."""


@dataclass(frozen=True)
class Zones:
    """influence: distance at which the observers act, margin: distance that they keep, m."""

    influence: float
    margin: float

    def __post_init__(self) -> None:
        """Raise UsageError for zones that no profile may have."""
        if not (math.isfinite(self.influence) and self.influence > 0.0):
            raise UsageError(
                "no usable influence", where="--influence", found=f"{self.influence} m", allowed="more than 0 m"
            )
        if not 0.0 <= self.margin < self.influence:
            allowed = f"0 m to less than the influence, {self.influence} m"
            raise UsageError("no usable margin", where="--margin", found=f"{self.margin} m", allowed=allowed)


@dataclass(frozen=True, eq=False)
class Proposal:
    """An observer `name` on `link` (its index and its name).

    ratio: volume of the shape over that of the geometry's convex hull, None where that is flat. stands_out: how far
    the shape reaches beyond the hull, m. why: why it is no capsule, else empty.
    """

    link: int
    link_name: str
    name: str
    shape: Capsule | Box | Lone
    ratio: float | None
    stands_out: float
    why: str


def propose(geometries: tuple[LinkGeometry, ...], zones: Zones) -> tuple[Proposal, ...]:
    """An observer for every link, named for it."""
    return tuple(
        replace(_propose(geometry, zones), name=name)
        for geometry, name in zip(geometries, _names(geometries), strict=True)
    )


def flattened(proposal: Proposal, geometry: LinkGeometry, why: str) -> Proposal:
    """The same observer as a box or a cylinder, and why it is none of a capsule."""
    flat = _flat(geometry)
    kind = flat.kind if isinstance(flat, Lone) else "box"
    return replace(_proposal(geometry, flat, f"{kind}: {why}"), name=proposal.name)


def _propose(geometry: LinkGeometry, zones: Zones) -> Proposal:
    axes = geometry.axes.transpose(0, 2, 1).reshape(-1, 3)
    capsule = _rounded_capsule(enclosing_capsule(geometry.centres, geometry.radii, axes=axes), geometry)
    round_one = _proposal(geometry, capsule, "")
    times, out = capsule.volume / _flat(geometry).volume, round_one.stands_out
    if times < FAR_TOO_LARGE and not (times >= SOMEWHAT_LARGE and out > zones.influence):
        return round_one
    why = f"the smallest capsule is {times:.1f} times as large and stands out by {1e3 * out:.0f} mm"
    return flattened(round_one, geometry, why)


def _flat(geometry: LinkGeometry) -> Box | Lone:
    return geometry.lone or _rounded_box(enclosing_box(geometry), geometry)


def _proposal(geometry: LinkGeometry, shape: Capsule | Box | Lone, why: str) -> Proposal:
    hull = geometry.hull_volume()
    ratio = shape.volume / hull if hull > 0.0 else None
    return Proposal(geometry.link, geometry.name, "", shape, ratio, _stands_out(shape, geometry), why)


def _names(geometries: tuple[LinkGeometry, ...]) -> list[str]:
    """The links' names without an ending `_link`, where that leaves them different."""
    short = [geometry.name.removesuffix("_link") or geometry.name for geometry in geometries]
    if len(set(short)) == len(short):
        return short
    return [geometry.name for geometry in geometries]


def _stands_out(shape: Capsule | Box | Lone, geometry: LinkGeometry) -> float:
    """Largest difference of the support functions, m: for nested convex bodies, how far the outer one reaches out."""
    if isinstance(shape, Lone):
        return 0.0
    inner = np.max(directions() @ geometry.centres.T + geometry.radii, axis=1)
    return float(max(np.max(shape.support(directions()) - inner), 0.0))


def _rounded_capsule(capsule: Capsule, geometry: LinkGeometry) -> Capsule:
    start, end = _round(capsule.start), _round(capsule.end)
    if capsule.is_ball:
        end = start
    needed = float(np.max(distances_to_segment(geometry.centres, start, end) + geometry.radii))
    return Capsule(start, end, round_up(max(needed, 10.0**-DIGITS)))


def _rounded_box(box: Box, geometry: LinkGeometry) -> Box:
    pos, quat = _round(box.pos), np.round(box.quat, 9)
    local = (geometry.centres - pos) @ to_matrix(normalise(quat))
    needed = np.max(np.abs(local) + geometry.radii[:, None], axis=0)
    return Box(pos, quat, np.array([round_up(max(float(half), 10.0**-DIGITS)) for half in needed]))


def _round(values: FloatArray) -> FloatArray:
    return np.round(values, DIGITS) + 0.0  # no -0.0


def round_up(value: float) -> float:
    """To DIGITS decimals, never below; a value within 1e-12 above a decimal counts as that decimal."""
    return round(math.ceil(value * 10.0**DIGITS - 10.0 ** (DIGITS - 12)) / 10.0**DIGITS, DIGITS)


# The proposed shapes on the robot's tree, as a MuJoCo model that computes the distance between any two of them.

FAR = 1e3
"""[m] larger distances are reported as this one."""

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
        links[proposal.link].add_geom(**proposal.shape.as_geom())
    model = spec.compile()
    # Geoms come in the order of links, as proposals do: their numbers are the same.
    assert [int(link) for link in model.geom_bodyid] == [proposal.link for proposal in proposals]
    assert np.array_equal(model.body_parentid, body.parent)
    return model
