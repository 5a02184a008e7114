"""The virtual human as MJCF text, written from one person's dimensions.

Links are named for the joint at their near end, so that a link's origin is that joint's centre; hinges are
`<joint>_<motion>`. Sites are the points that no joint carries: head, hands, toes, and the soles. Shapes are capsules
and a sphere, massless: masses and inertias stand in <inertial>.
"""

import numpy as np

from retarget.anthropometry import FRACTIONS, SEGMENTS, TRUNK_LEVELS, Segment
from retarget.human_dimensions import HumanDimensions
from retarget.human_joints import ENDS, HUMAN_JOINTS, HumanJoint
from retarget.rotations import FloatArray

__all__ = ["human_mjcf"]

_HEADER = """<mujoco model="human">
  <compiler angle="degree" autolimits="true" boundmass="1e-6" boundinertia="1e-9"/>
  <default>
    <geom type="capsule" mass="0" rgba="0.75 0.7 0.65 1"/>
    <site size="0.01"/>
  </default>
  <worldbody>"""

_RADII: dict[str, float] = {
    "pelvis": 0.055,
    "spine": 0.065,
    "chest": 0.065,
    "neck": 0.032,
    "collar": 0.035,
    "shoulder": 0.026,
    "elbow": 0.021,
    "wrist": 0.019,
    "hip": 0.034,
    "knee": 0.023,
    "ankle": 0.020,
}
"""Radius of each link's capsule as a share of stature.

Thighs and shanks taper: their capsules are as thick as the knee and as the middle of the shank, so that legs which
pass each other as people's do need not part for it."""

_HEAD_RADIUS = 0.062
"""Radius of the head's sphere as a share of stature: from the ear canal (0.936) to the vertex."""


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
        lines.append(
            f'{indent}  <joint name="{joint.name}_{hinge.motion}" axis="{_text(joint.axis(hinge))}" '
            f'range="{hinge.lower_deg:g} {hinge.upper_deg:g}"/>'
        )
    lines += [f"{indent}  {line}" for line in _inertial(joint, dimensions) + _shapes(joint, dimensions)]
    lines += [f"{indent}  {line}" for line in _sites(joint, dimensions)]
    for child in HUMAN_JOINTS:
        if child.parent == joint.name:
            _write_link(lines, child, dimensions, depth=depth + 1)
    lines.append(f"{indent}</body>")


def _inertial(joint: HumanJoint, dimensions: HumanDimensions) -> list[str]:
    kind = _kind(joint.name)
    for segment in SEGMENTS:
        if segment.body == kind:
            return [_segment_inertial(joint, segment, dimensions)]
    return []


def _segment_inertial(joint: HumanJoint, segment: Segment, dimensions: HumanDimensions) -> str:
    """Mass, centre of mass and inertia of a thick rod: radius of gyration across it, its radius about it."""
    start, end = (_segment_point(name, joint, dimensions) for name in (segment.start, segment.end))
    length = float(np.linalg.norm(end - start))
    along = (end - start) / length if length > _POINT_M else np.array([0.0, 0.0, 1.0])
    mass = segment.mass * dimensions.mass
    radius = _RADII[segment.body] * dimensions.stature
    gyration = segment.gyration if segment.gyration is not None else np.sqrt(1.0 / 12.0)  # a uniform rod's
    across = mass * ((gyration * length) ** 2 + radius**2 / 4.0)
    about = mass * radius**2 / 2.0
    inertia = across * (np.eye(3) - np.outer(along, along)) + about * np.outer(along, along)
    full = np.array([inertia[0, 0], inertia[1, 1], inertia[2, 2], inertia[0, 1], inertia[0, 2], inertia[1, 2]])
    com = start + segment.com * (end - start)
    return f'<inertial pos="{_text(com)}" mass="{mass:.10g}" fullinertia="{_text(full)}"/>'


def _segment_point(name: str, joint: HumanJoint, dimensions: HumanDimensions) -> FloatArray:
    """Point (3,) of a segment's table entry in the link's frame, in the rest posture."""
    if name == _kind(joint.name):
        return np.zeros(3)
    if name in ("hips", "l4_l5", "t12_l1", "c7_t1"):
        share = 0.0 if name == "hips" else getattr(TRUNK_LEVELS, name)
        return _trunk_point(share, dimensions) - _from_pelvis(joint.name, dimensions)
    side = joint.name[:2] if joint.name[1] == "_" else ""
    return dimensions.of(side + name)


def _trunk_point(share: float, dimensions: HumanDimensions) -> FloatArray:
    """Point (3,) at a share of the way from the middle of the hips to that of the shoulders, from the pelvis."""
    hips = 0.5 * (_from_pelvis("l_hip", dimensions) + _from_pelvis("r_hip", dimensions))
    shoulders = 0.5 * (_from_pelvis("l_shoulder", dimensions) + _from_pelvis("r_shoulder", dimensions))
    return np.asarray(hips + share * (shoulders - hips))


def _from_pelvis(name: str, dimensions: HumanDimensions) -> FloatArray:
    parents = {joint.name: joint.parent for joint in HUMAN_JOINTS}
    point = np.zeros(3)
    while parents[name]:
        point = point + dimensions.of(name)
        name = parents[name]
    return point


def _shapes(joint: HumanJoint, dimensions: HumanDimensions) -> list[str]:
    """Capsule of the link, from its joint to the next; across the hips for the pelvis."""
    kind = _kind(joint.name)
    radius = _RADII[kind] * dimensions.stature
    if kind == "pelvis":
        start, end = dimensions.of("l_hip"), dimensions.of("r_hip")
    else:
        ends = [child.name for child in HUMAN_JOINTS if child.parent == joint.name]
        ends += [name for name, parent in ENDS if parent == joint.name]
        start, end = np.zeros(3), dimensions.of(ends[0])
    shapes = [_capsule(joint.name, start, end, radius)]
    if kind == "neck":
        size = _HEAD_RADIUS * dimensions.stature
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
    ahead = np.array([toe[0], toe[1], 0.0]) / np.hypot(toe[0], toe[1])
    reach = np.hypot(toe[0], toe[1]) + FRACTIONS.toe_tip * stature - radius
    back = -FRACTIONS.heel_back * stature + radius
    level = np.array([0.0, 0.0, height])
    return ahead * back + level, ahead * reach + level


def _capsule(name: str, start: FloatArray, end: FloatArray, radius: float) -> str:
    if np.linalg.norm(end - start) < _POINT_M:  # some files leave a link of the trunk out
        return f'<geom name="{name}" type="sphere" pos="{_text(start)}" size="{radius:.6g}"/>'
    return f'<geom name="{name}" fromto="{_text(start)} {_text(end)}" size="{radius:.6g}"/>'


def _sites(joint: HumanJoint, dimensions: HumanDimensions) -> list[str]:
    sites = [(name, dimensions.of(name)) for name, parent in ENDS if parent == joint.name]
    if _kind(joint.name) == "ankle":
        below = np.array([0.0, 0.0, -FRACTIONS.ankle_height * dimensions.stature])
        sites.append((joint.name[:2] + "sole", below))
    return [f'<site name="{name}" pos="{_text(position)}"/>' for name, position in sites]


def _kind(name: str) -> str:
    """Joint name without its side."""
    return name[2:] if name[1] == "_" else name


def _text(values: FloatArray) -> str:
    return " ".join(f"{value:.12g}" for value in values)
