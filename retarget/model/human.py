"""The virtual human: a body of one person's size as MJCF, its degrees of freedom, speeds and reference postures.

The paper's 51 degrees of freedom are 17 internal joints with three axes each, of which two axes of each knee and the
sideways axis of each elbow are locked, and the six of the root.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from retarget._solver import Probe
from retarget.arithmetic import norm
from retarget.errors import ConfigError, suggest
from retarget.model.body import BodyModel, JointLimits, body_from_file, joint_weights
from retarget.model.body_file import compile_body_text
from retarget.model.human_dimensions import (
    ENDS,
    FRACTIONS,
    HUMAN_JOINTS,
    POINTS,
    SEGMENTS,
    TABLES,
    TRUNK_LEVELS,
    HumanDimensions,
    HumanJoint,
    kind_of,
)
from retarget.model.meshes import SolidBody, solid_body
from retarget.types import ORIENTED, BoolArray, FloatArray

# MJCF of the virtual human. Links have the name of the joint at their origin, hinges are `<joint>_<motion>`, and sites
# are head, hands, toes and soles. Shapes have no mass.

_HEADER = """<mujoco model="human">
  <compiler angle="degree" autolimits="true" boundmass="1e-6" boundinertia="1e-9"/>
  <default>
    <geom type="capsule" mass="0" rgba="0.75 0.7 0.65 1"/>
    <site size="0.01"/>
  </default>
  <worldbody>"""

_RADII: Mapping[str, float] = TABLES["radii"]
"""Radii of the links' capsules and of the head's sphere, relative to stature."""
_POINT_M = 1e-3
"""A shorter link is a point, m: its shape is a sphere."""


def human_mjcf(dimensions: HumanDimensions) -> str:
    """MJCF of the human, standing with the soles on the ground (z = 0), facing x."""
    lines = [_HEADER]
    _write_link(lines, HUMAN_JOINTS[0], dimensions, depth=2)
    lines += ["  </worldbody>", "</mujoco>", ""]
    return "\n".join(lines)


def _write_link(lines: list[str], joint: HumanJoint, dimensions: HumanDimensions, *, depth: int) -> None:
    indent = "  " * depth
    is_root = not joint.parent
    position = np.array([0.0, 0.0, dimensions.pelvis_height]) if is_root else dimensions.of(joint.name)
    lines.append(f'{indent}<body name="{joint.name}" pos="{_text(position)}">')
    if is_root:
        lines.append(f'{indent}  <freejoint name="root"/>')
    for hinge in joint.hinges:
        lower, upper = hinge.limits
        lines.append(
            f'{indent}  <joint name="{joint.name}_{hinge.motion}" axis="{_text(joint.axis(hinge))}" '
            f'range="{lower:g} {upper:g}"/>'
        )
    lines += [f"{indent}  {line}" for line in _inertial(joint, dimensions) + _shapes(joint, dimensions)]
    sites = [(name, dimensions.of(name)) for name, parent in ENDS if parent == joint.name]
    if kind_of(joint.name) == "ankle":
        below = np.array([0.0, 0.0, -FRACTIONS.ankle_height * dimensions.stature])
        sites.append((joint.name[:2] + "sole", below))
    lines += [f'{indent}  <site name="{name}" pos="{_text(position)}"/>' for name, position in sites]
    for child in HUMAN_JOINTS:
        if child.parent == joint.name:
            _write_link(lines, child, dimensions, depth=depth + 1)
    lines.append(f"{indent}</body>")


def _inertial(joint: HumanJoint, dimensions: HumanDimensions) -> list[str]:
    """Mass, centre of mass and inertia of a thick rod; gyration: across it."""
    segment = next((segment for segment in SEGMENTS if segment.body == kind_of(joint.name)), None)
    if segment is None:
        return []
    start, end = (_segment_point(name, joint, dimensions) for name in (segment.start, segment.end))
    length = norm(end - start)
    along = (end - start) / length if length > _POINT_M else np.array([0.0, 0.0, 1.0])
    mass = segment.mass * dimensions.mass
    radius = _RADII[segment.body] * dimensions.stature
    gyration = segment.gyration if segment.gyration is not None else np.sqrt(1.0 / 12.0)  # a uniform rod's
    across = mass * (gyration * length * gyration * length + radius * radius / 4.0)
    about = mass * radius * radius / 2.0
    inertia = across * np.eye(3) + (about - across) * along[:, None] * along
    full = np.array([inertia[0, 0], inertia[1, 1], inertia[2, 2], inertia[0, 1], inertia[0, 2], inertia[1, 2]])
    com = start + segment.com * (end - start)
    return [f'<inertial pos="{_text(com)}" mass="{mass:.10g}" fullinertia="{_text(full)}"/>']


def _segment_point(name: str, joint: HumanJoint, dimensions: HumanDimensions) -> FloatArray:
    """Point (3,) of a segment's entry, m, in the link's frame."""
    if name == kind_of(joint.name):
        return np.zeros(3)
    if name in TRUNK_LEVELS:
        at = dict(zip(POINTS, dimensions.standing(), strict=True))
        hips, shoulders = (0.5 * (at[f"l_{part}"] + at[f"r_{part}"]) for part in ("hip", "shoulder"))
        return np.asarray(hips + TRUNK_LEVELS[name] * (shoulders - hips) - at[joint.name])
    side = joint.name[:2] if joint.name[1] == "_" else ""
    return dimensions.of(side + name)


def _shapes(joint: HumanJoint, dimensions: HumanDimensions) -> list[str]:
    """Capsule of the link, from its joint to the next; across the hips for the pelvis."""
    kind = kind_of(joint.name)
    radius = _RADII[kind] * dimensions.stature
    if kind == "pelvis":
        start, end = dimensions.of("l_hip"), dimensions.of("r_hip")
    else:
        ends = [child.name for child in HUMAN_JOINTS if child.parent == joint.name]
        ends += [name for name, parent in ENDS if parent == joint.name]
        start, end = np.zeros(3), dimensions.of(ends[0])
    shapes = [_capsule(joint.name, start, end, radius)]
    if kind == "neck":
        size = _RADII["head"] * dimensions.stature
        shapes.append(f'<geom name="head" type="sphere" pos="{_text(end)}" size="{size:.6g}"/>')
    if kind == "ankle":
        heel, tip = _foot_ends(joint.name, dimensions)
        shapes[0] = _capsule(joint.name, heel, tip, radius)
    return shapes


def _foot_ends(name: str, dimensions: HumanDimensions) -> tuple[FloatArray, FloatArray]:
    """Axis of the sole's capsule, from heel to toe tip: two points (3,) m in the foot's frame."""
    stature, radius = dimensions.stature, _RADII["ankle"] * dimensions.stature
    toe = dimensions.of(name[:2] + "toe")
    height = -FRACTIONS.ankle_height * stature + radius
    length = norm(toe[:2])
    forward = np.array([toe[0], toe[1], 0.0]) / length
    reach = length + FRACTIONS.toe_tip * stature - radius
    back = -FRACTIONS.heel_back * stature + radius
    level = np.array([0.0, 0.0, height])
    return forward * back + level, forward * reach + level


def _capsule(name: str, start: FloatArray, end: FloatArray, radius: float) -> str:
    if norm(end - start) < _POINT_M:  # a file may lack a link of the trunk
        return f'<geom name="{name}" type="sphere" pos="{_text(start)}" size="{radius:.6g}"/>'
    return f'<geom name="{name}" fromto="{_text(start)} {_text(end)}" size="{radius:.6g}"/>'


def _text(values: FloatArray) -> str:
    return " ".join(f"{value:.12g}" for value in values)


POSTURES: Mapping[str, Mapping[str, float]] = TABLES["postures"]
"""Reference postures: name -> motion, of both sides -> degrees."""


@dataclass(frozen=True, eq=False)
class Human:
    """A virtual human. locked (nv,): DoFs that stay at zero. mjcf: source of `body`."""

    dimensions: HumanDimensions
    body: BodyModel
    locked: BoolArray
    mjcf: str

    @cached_property
    def solid(self) -> SolidBody:
        """The body to draw."""
        return solid_body(self.body)

    def posture(self, name: str) -> FloatArray:
        """Reference posture (nq,) at the origin. Raises ConfigError with the nearest names."""
        if name not in POSTURES:
            allowed = ", ".join(POSTURES)
            raise ConfigError("unknown posture", found=name, allowed=allowed, next_step=suggest(name, POSTURES))
        return self.posture_from(POSTURES[name].items())

    def posture_from(self, angles_deg: Iterable[tuple[str, float]]) -> FloatArray:
        """Posture (nq,) of (motion, degrees) pairs; motions without a side are of both. Raises ConfigError
        for unknown motions, or outside a joint's limits."""
        q = self.body.qpos0.copy()
        single, address = self.body.scalar_joints()
        for motion, degrees in angles_deg:
            for name in [motion] if motion in self.body.dof_names else [f"l_{motion}", f"r_{motion}"]:
                dof = self.body.dof_index(name)
                angle = np.deg2rad(degrees)
                low, high = self.body.lower[dof], self.body.upper[dof]
                if not (single[dof] and low <= angle <= high):
                    allowed = f"{np.rad2deg(low):.0f} to {np.rad2deg(high):.0f} degrees"
                    raise ConfigError("posture outside the joint's limits", where=name, found=degrees, allowed=allowed)
                q[address[dof]] = angle
        return q


def build_human(dimensions: HumanDimensions) -> Human:
    """Virtual human of this size, in about 5 ms."""
    mjcf = human_mjcf(dimensions)
    body = body_from_file(compile_body_text(mjcf, source=f"virtual human ({dimensions.origin})", own=True))
    locked = {f"{joint.name}_{hinge.motion}": hinge.locked for joint in HUMAN_JOINTS for hinge in joint.hinges}
    return Human(dimensions, body, np.array([locked.get(name, False) for name in body.dof_names]), mjcf)


def human_limits(body: BodyModel) -> JointLimits:
    """Anatomical limits of position, and the speeds of the table."""
    return JointLimits(
        lower=body.lower,
        upper=body.upper,
        max_velocity=joint_weights(body, TABLES["speeds"].items(), default=15.0),
        max_acceleration=np.full(body.nv, np.inf),
    )


class PostureReader:
    """Computes joint centres, orientations and centres of mass of a human's postures."""

    def __init__(self, human: Human) -> None:
        self._body = human.body.solver_body()
        frames = [human.body.frame(name) for name in POINTS]
        self._links = [frame.body for frame in frames]
        self._local = np.array([frame.position for frame in frames])
        self._oriented = [human.body.frame(name).body for name in ORIENTED]
        self._probe = Probe(self._body, self._links, self._local, self._oriented)

    def read(self, q: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Joints (m, 3) m, orientations (3, 4) wxyz and centre of mass (3,) m of a posture (nq,)."""
        return self._probe.read(q)

    def joints(self, q: FloatArray) -> FloatArray:
        """Centres (T, m, 3) m of POINTS, for postures (T, nq)."""
        return self._body.points(q, self._links, self._local)

    def orientations(self, q: FloatArray) -> FloatArray:
        """Orientations (T, 3, 4) wxyz of ORIENTED, for postures (T, nq)."""
        return self._body.orientations(q, self._oriented)
