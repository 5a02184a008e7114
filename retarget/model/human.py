"""The virtual human: a body of one person's size as MJCF, its degrees of freedom, speeds and reference postures.

The paper's "18 joints (51 degrees of freedom)" are read as seventeen internal joints of three axes each beside the six
of the root (57 velocities), of which two axes of each knee and the sideward axis of each elbow are locked.
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

# The virtual human as MJCF text, written from one person's dimensions.
#
# Links are named for the joint at their near end, so that a link's origin is that joint's centre; hinges are
# `<joint>_<motion>`. Sites are the points that no joint carries: head, hands, toes, and the soles. Shapes are capsules
# and a sphere, massless: masses and inertias stand in <inertial>.

_HEADER = """<mujoco model="human">
  <compiler angle="degree" autolimits="true" boundmass="1e-6" boundinertia="1e-9"/>
  <default>
    <geom type="capsule" mass="0" rgba="0.75 0.7 0.65 1"/>
    <site size="0.01"/>
  </default>
  <worldbody>"""

_RADII: Mapping[str, float] = TABLES["radii"]
"""Radius of each link's capsule, and of the head's sphere, as a share of stature."""
_POINT_M = 1e-3
"""A link shorter than this is a point: its shape is a sphere."""


def human_mjcf(dimensions: HumanDimensions) -> str:
    """MJCF text of the human, standing with the soles on the ground (z = 0), facing x."""
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
    """Mass, centre of mass and inertia of a thick rod: radius of gyration across it, its radius about it."""
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
    """Point (3,) of a segment's table entry in the link's frame, in the rest posture."""
    if name == kind_of(joint.name):
        return np.zeros(3)
    if name in TRUNK_LEVELS:
        # At a share of the way from the middle of the hips to that of the shoulders.
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
    """Axis (two points (3,), in the foot's frame) of the capsule that stands on the sole from heel to toe tip."""
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
    if norm(end - start) < _POINT_M:  # some files leave a link of the trunk out
        return f'<geom name="{name}" type="sphere" pos="{_text(start)}" size="{radius:.6g}"/>'
    return f'<geom name="{name}" fromto="{_text(start)} {_text(end)}" size="{radius:.6g}"/>'


def _text(values: FloatArray) -> str:
    return " ".join(f"{value:.12g}" for value in values)


POSTURES: Mapping[str, Mapping[str, float]] = TABLES["postures"]
"""Reference postures: name -> motion (`knee_flexion`: both knees) -> degrees. A posture task pulls the joints towards
one of these."""


@dataclass(frozen=True, eq=False)
class Human:
    """A virtual human. `locked` (nv,): DoFs that stay at zero. `mjcf`: the text that `body` was compiled from."""

    dimensions: HumanDimensions
    body: BodyModel
    locked: BoolArray
    mjcf: str

    @cached_property
    def solid(self) -> SolidBody:
        """What is drawn of it."""
        return solid_body(self.body)

    def posture(self, name: str) -> FloatArray:
        """Reference posture q (nq,), m, wxyz and rad, standing at the origin. Raises ConfigError with the nearest
        names."""
        if name not in POSTURES:
            allowed = ", ".join(POSTURES)
            raise ConfigError("unknown posture", found=name, allowed=allowed, next_step=suggest(name, POSTURES))
        return self.posture_from(POSTURES[name].items())

    def posture_from(self, angles_deg: Iterable[tuple[str, float]]) -> FloatArray:
        """Posture q (nq,) from (motion, degrees) pairs over the zero posture; no side means both sides.

        Raises ConfigError: unknown motion, or outside the limits of a joint.
        """
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
    """The virtual human of this size. About 5 ms, after MuJoCo's own import."""
    mjcf = human_mjcf(dimensions)
    body = body_from_file(compile_body_text(mjcf, source=f"virtual human ({dimensions.origin})", own=True))
    locked = {f"{joint.name}_{hinge.motion}": hinge.locked for joint in HUMAN_JOINTS for hinge in joint.hinges}
    return Human(dimensions, body, np.array([locked.get(name, False) for name in body.dof_names]), mjcf)


def human_limits(body: BodyModel) -> JointLimits:
    """Anatomical positions, the speeds of the table, no limit on acceleration."""
    return JointLimits(
        lower=body.lower,
        upper=body.upper,
        max_velocity=joint_weights(body, TABLES["speeds"].items(), default=15.0),
        max_acceleration=np.full(body.nv, np.inf),
    )


# What a reconstruction yields each tick: a posture of the virtual human, and where its parts are.


class PostureReader:
    """Joint centres, orientations and the centre of mass of a human's postures."""

    def __init__(self, human: Human) -> None:
        self._body = human.body.solver_body()
        frames = [human.body.frame(name) for name in POINTS]
        self._links = [frame.body for frame in frames]
        self._local = np.array([frame.position for frame in frames])
        self._oriented = [human.body.frame(name).body for name in ORIENTED]
        self._probe = Probe(self._body, self._links, self._local, self._oriented)

    def read(self, q: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Read a posture (nq,): joints (m, 3) m, orientations (3, 4) wxyz, and centre of mass (3,) m."""
        return self._probe.read(q)

    def joints(self, q: FloatArray) -> FloatArray:
        """Centres (T, m, 3) m of all POINTS, for postures (T, nq)."""
        return self._body.points(q, self._links, self._local)

    def orientations(self, q: FloatArray) -> FloatArray:
        """Orientations (T, 3, 4) wxyz of ORIENTED, for postures (T, nq)."""
        return self._body.orientations(q, self._oriented)
