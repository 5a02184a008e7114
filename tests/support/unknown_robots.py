"""Robots that the project does not know: a URDF humanoid of another topology than the shipped ones, and parts of it.

No package that is installed here brings a URDF of a humanoid, so this one is ours. It faces y instead of x, its base is
the chest, with a waist of two joints below it, legs that begin with the pitch of the hip and have no ankle roll, arms
of four joints that hang down, forearms ahead, and one neck joint.
"""

import random
import re
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from xml.sax.saxutils import quoteattr

import numpy as np
from scipy.spatial import ConvexHull

from retarget.model.body_file import compile_body, compile_body_text
from retarget.schema.catalogue import shipped_folder
from retarget.setup.frames import Anatomy, Posed, find_anatomy, find_frames
from retarget.setup.import_robot import Imported, import_robot
from retarget.setup.links import propose_links
from retarget.setup.tree import Tree, read_tree

SHIPPED = tuple(sorted(path.parent.name for path in (shipped_folder() / "robots").glob("*/robot.yaml")))

Vector = tuple[float, float, float]
ZERO: Vector = (0.0, 0.0, 0.0)


@dataclass(frozen=True)
class Part:
    """A link and the joint that moves it: a box of `size`, m, around `middle`, of `mass`, kg."""

    name: str
    parent: str
    at: Vector
    axis: Vector
    limits: tuple[float, float]
    size: Vector
    middle: Vector = ZERO
    mass: float = 0.1
    kind: str = "revolute"
    extra: str = field(default="")


def side_parts(side: str, s: float) -> list[Part]:
    """Leg and arm of one side; s: 1 left, -1 right. The robot faces +y, so its left is -x."""
    x = -s
    return [
        Part(f"{side}1", "hips", (0.05 * x, 0, -0.03), (1, 0, 0), (-0.6, 1.9), (0.04, 0.04, 0.04), mass=0.12),
        Part(f"{side}2", f"{side}1", ZERO, (0, 1, 0), (-0.5, 0.5), (0.03, 0.05, 0.03)),
        Part(f"{side}3", f"{side}2", ZERO, (0, 0, x), (-0.8, 0.8), (0.05, 0.05, 0.09), (0, 0, -0.07), 0.2),
        Part(f"{side}4", f"{side}3", (0, 0, -0.14), (-1, 0, 0), (-0.05, 2.2), (0.045, 0.05, 0.1), (0, 0, -0.065), 0.2),
        Part(f"{side}5", f"{side}4", (0, 0, -0.14), (1, 0, 0), (-1.2, 1.2), (0.07, 0.14, 0.02), (0, 0.02, -0.03), 0.1),
        Part(f"{side}6", "chest", (0.08 * x, 0, 0.1), (1, 0, 0), (-1.5, 3.0), (0.03, 0.03, 0.03)),
        Part(f"{side}7", f"{side}6", (0.03 * x, 0, 0), (0, x, 0), (-0.3, 2.6), (0.03, 0.03, 0.03)),
        Part(f"{side}8", f"{side}7", ZERO, (0, 0, 1), (-1.5, 1.5), (0.035, 0.035, 0.06), (0, 0, -0.05)),
        Part(f"{side}9", f"{side}8", (0, 0, -0.1), (1, 0, 0), (-1.4, 1.2), (0.03, 0.1, 0.03), (0, 0.06, 0)),
    ]


TRUNK = [
    Part("waist", "chest", (0, 0, -0.05), (0, 0, 1), (-1.0, 1.0), (0.06, 0.06, 0.03), (0, 0, -0.02), 0.15),
    Part("hips", "waist", (0, 0, -0.05), (1, 0, 0), (-0.2, 0.5), (0.12, 0.08, 0.03), (0, 0, -0.005), 0.3),
    Part("face", "chest", (0, 0, 0.16), (0, 0, 1), (-1.2, 1.2), (0.08, 0.08, 0.08), (0, 0.01, 0.06), 0.2),
]
HUMANOID = [*TRUNK, *side_parts("p", 1.0), *side_parts("q", -1.0)]
"""Names say nothing of left and right."""
ARM = [
    Part("turn", "base", (0, 0, 0.06), (0, 0, 1), (-2.5, 2.5), (0.06, 0.06, 0.06), (0, 0, 0.03)),
    Part("lift", "turn", (0, 0, 0.07), (0, 1, 0), (-1.8, 1.8), (0.04, 0.04, 0.2), (0, 0, 0.1)),
    Part("bend", "lift", (0, 0, 0.2), (0, 1, 0), (-2.4, 2.4), (0.04, 0.04, 0.16), (0, 0, 0.08)),
    Part("hand", "bend", (0, 0, 0.16), (0, 1, 0), (-1.8, 1.8), (0.03, 0.06, 0.06), (0, 0, 0.04)),
]
"""A fixed arm on a table."""


def urdf(
    parts: list[Part], *, base: str, size: Vector, effort: float = 2.5, speed: float = 5.0, middle: Vector = ZERO
) -> str:
    """URDF of a tree of parts on a base, a box of `size` m around `middle` and 0.8 kg."""
    lines = [f'<robot name="stranger">{_link(base, size, middle, 0.8)}']
    for part in parts:
        low, high = part.limits
        lines.append(_link(part.name, part.size, part.middle, part.mass))
        lines.append(
            f'<joint name="j_{part.name}" type={quoteattr(part.kind)}><parent link="{part.parent}"/>'
            f'<child link="{part.name}"/><origin xyz="{_text(part.at)}"/><axis xyz="{_text(part.axis)}"/>'
            f'<limit lower="{low}" upper="{high}" effort="{effort}" velocity="{speed}"/>{part.extra}</joint>'
        )
    return "\n".join([*lines, "</robot>"])


def humanoid(parts: list[Part] | None = None) -> str:
    """The humanoid, or some of it."""
    return urdf(HUMANOID if parts is None else parts, base="chest", size=(0.12, 0.08, 0.16))


def imported(text: str, folder: Path) -> Imported:
    """A body file, URDF or MJCF, as a profile in `new`."""
    path = folder / ("body.urdf" if text.startswith("<robot") else "body.xml")
    path.write_text(text, encoding="utf-8")
    return import_robot(path, folder / "new")


def small_bust() -> str:
    """A chest with two arms of two joints, and nothing else."""
    arms = [
        Part(f"{side}{part}", parent, at, (1, 0, 0), (-1.5, 1.5), size, middle)
        for side, x in (("p", -1.0), ("q", 1.0))
        for part, parent, at, size, middle in (
            ("1", "chest", (0.09 * x, 0.0, 0.08), (0.03, 0.03, 0.1), (0.02 * x, 0.0, -0.03)),
            ("2", f"{side}1", (0.02 * x, 0.0, -0.09), (0.03, 0.1, 0.03), (0.0, 0.06, 0.0)),
        )
    ]
    return humanoid(arms)


def table_arm() -> str:
    """The fixed arm."""
    return urdf(ARM, base="base", size=(0.1, 0.1, 0.06))


# Robots as newcomers bring them, each in the manner of a public one; sizes and names are like theirs, shapes are ours.
#
# A row has a link and its parent, {} for the side, where the joint is, its axis, limits, size and middle of the box,
# and mass. y is mirrored on the right, and of an axis after a ~ x and y.

DARWIN = """
MP_BACK_{}     MP_BODY       -.02 .06 0          0 0 0    0 0          .001 .001 .001    0 0 0           .001
MP_SHO_{}      MP_BODY       0 .0575 0          ~0 1 0    -2.618 2.618 .03 .02 .03       0 .01 0         .026
MP_ARM_HIGH_{} MP_SHO_{}     0 .0245 -.016      -1 0 0    -2.618 2.618 .035 .03 .05      .005 .025 -.025 .17
MP_ARM_LOW_{}  MP_ARM_HIGH_{} .016 .0424 -.0424 ~0 1 1    -2.618 2.618 .12 .03 .03       .065 0 0        .06
MP_PELVIS_{}   MP_BODY       -.005 .037 -.0907   0 0 -1   -2.618 2.618 .03 .04 .02       0 0 0           .03
MP_THIGH1_{}   MP_PELVIS_{}  0 0 -.0315         -1 0 0    -2.618 2.618 .04 .04 .04       0 0 0           .17
MP_THIGH2_{}   MP_THIGH1_{}  0 0 0              ~0 -1 0   -2.618 2.618 .045 .045 .07     0 0 -.05        .12
MP_TIBIA_{}    MP_THIGH2_{}  0 0 -.093          ~0 -1 0   -2.618 2.618 .064 .065 .1      0 0 -.045       .07
MP_ANKLE1_{}   MP_TIBIA_{}   0 0 -.093          ~0 1 0    -2.618 2.618 .04 .04 .03       0 0 0           .17
MP_ANKLE2_{}   MP_ANKLE1_{}  0 0 0               1 0 0    -2.618 2.618 .1 .06 .01        0 .008 -.0285   .08
"""
GROUND = """
leg_{}_hip_roll       base                  0 .09 .42   1 0 0  -1 1    .05 .05 .05 0 0 0       .5
leg_{}_hip_yaw        leg_{}_hip_roll       0 0 -.04    0 0 1  -1 1    .05 .05 .04 0 0 0       .5
leg_{}_hip_pitch      leg_{}_hip_yaw        0 0 -.02    0 1 0  -1.9 1  .05 .05 .14 0 0 -.08    .8
leg_{}_knee_pitch     leg_{}_hip_pitch      0 0 -.16    0 1 0  0 2.3   .05 .05 .12 0 0 -.08    .5
leg_{}_ankle_pitch    leg_{}_knee_pitch     0 0 -.16    0 1 0  -1.2 1  .03 .03 .02 0 0 0       .1
leg_{}_ankle_roll     leg_{}_ankle_pitch    0 0 0       1 0 0  -.5 .5  .16 .07 .01 .02 0 -.035 .2
arm_{}_shoulder_pitch base                  0 .12 .68   0 1 0  -3 1.5  .05 .05 .05 0 0 0       .3
arm_{}_shoulder_roll  arm_{}_shoulder_pitch 0 .03 0    ~1 0 0  -.2 2.5 .05 .04 .04 0 .01 0     .3
arm_{}_shoulder_yaw   arm_{}_shoulder_roll  0 .01 -.04  0 0 1  -1.5 1.5 .04 .04 .1 0 0 -.06    .3
arm_{}_elbow_pitch    arm_{}_shoulder_yaw   0 0 -.14    0 1 0  -2.2 0  .04 .04 .16 0 0 -.09    .3
"""
MICROBAN = """
{}_leg_yaw     trunk          0 .03 -.03  0 0 1 -1 1     .02 .025 .02   0 0 0           .03
{}_leg_roll    {}_leg_yaw     0 0 -.02    1 0 0 -.6 .6   .025 .025 .025 0 0 0           .03
{}_leg_pitch   {}_leg_roll    0 0 0       0 1 0 -1.7 .8  .025 .03 .05   0 0 -.035       .05
{}_knee        {}_leg_pitch   0 0 -.06    0 1 0 0 2.2    .025 .03 .04   0 0 -.03        .04
{}_ankle_pitch {}_knee        0 0 -.06    0 1 0 -1.2 1.2 .025 .025 .02  0 0 0           .03
{}_ankle_roll  {}_ankle_pitch 0 0 0       1 0 0 -.6 .6   .08 .04 .008   .008 .003 -.022 .03
{}_arm_pitch   trunk          0 .04 .05   0 1 0 -3 3     .02 .02 .02    0 .005 0        .02
{}_arm_roll    {}_arm_pitch   0 .015 0   ~1 0 0 -.3 2.8  .025 .02 .05   0 .003 -.03     .04
{}_elbow       {}_arm_roll    0 .003 -.06 0 1 0 -2.3 0   .02 .02 .055   0 0 -.035       .03
"""


def both_sides(table: str, left: str, right: str) -> list[Part]:
    """The parts of a table on both sides, by the names of the sides."""
    parts = []
    for side, s in ((left, 1.0), (right, -1.0)):
        for row in table.strip().splitlines():
            name, parent, *words = row.replace("{}", side).split()
            turn = s if words[3].startswith("~") else 1.0
            x, y, z, ax, ay, az, low, high, *size, mx, my, mz, mass = (float(word.strip("~")) for word in words)
            kind = "revolute" if low < high else "fixed"
            axis, middle, box = (turn * ax, turn * ay, az), (mx, s * my, mz), (size[0], size[1], size[2])
            parts.append(Part(name, parent, (x, s * y, z), axis, (low, high), box, middle, mass, kind))
    return parts


def darwin_like(folder: Path) -> Path:
    """A small humanoid whose every joint may turn 150 degrees either way, upper arms out and forearms ahead in its zero
    pose, shins with shells that are wide above, and a dummy link of 1 mm at each shoulder; names end in _L and _R."""
    wide = (-2.618, 2.618)
    parts = [
        *both_sides(DARWIN, "L", "R"),
        Part("MP_NECK", "MP_BODY", (0, 0, 0.0205), (0, 0, 1), wide, (0.03, 0.03, 0.03), mass=0.024),
        Part("MP_HEAD", "MP_NECK", (0, 0, 0.03), (0, -1, 0), wide, (0.08, 0.09, 0.08), (0.01, 0, 0.04), 0.158),
    ]
    text = urdf(parts, base="MP_BODY", size=(0.07, 0.09, 0.13), middle=(-0.01, 0, -0.05), effort=2.8, speed=5.6)
    return with_meshes(text, folder, "package://darwin_like/meshes/{}.STL")


def ground_rooted(folder: Path) -> Path:
    """A humanoid without a head whose base link has its origin on the ground, as some CAD exports have it; shapes are
    visual ones only."""
    parts = both_sides(GROUND, "left", "right")
    text = urdf(parts, base="base", size=(0.1, 0.16, 0.26), middle=(0, 0, 0.58), effort=8.0, speed=8.0)
    return with_meshes(text.replace("collision>", "visual>"), folder, "meshes/{}.stl")


def microban_like(folder: Path) -> Path:
    """A humanoid of 19 small servos, which only the names of its meshes tell; no joint states a torque."""
    head = Part("head", "trunk", (0, 0, 0.08), (0, 0, 1), (-1.2, 1.2), (0.05, 0.05, 0.05), (0, 0, 0.03), 0.08)
    parts = [*both_sides(MICROBAN, "left", "right"), head]
    text = urdf(parts, base="trunk", size=(0.05, 0.06, 0.09), middle=(0, 0, 0.025), effort=0.0, speed=0.0)
    return with_meshes(text, folder, "package://assets/{}_xl330.stl")


def with_meshes(text: str, folder: Path, filename: str) -> Path:
    """Write a URDF, whose boxes become the convex hulls of prisms of eight sides, in files; its path. filename: of a
    mesh in the URDF, {} for its number; the files are in meshes/ beside it, in small letters."""
    (folder / "meshes").mkdir(parents=True, exist_ok=True)
    around = np.arange(8) * np.pi / 4.0 + np.pi / 8.0
    ring = np.column_stack([np.cos(around), np.sin(around)]) / (2.0 * np.cos(np.pi / 8.0))
    count = 0

    def replaced(match: re.Match[str]) -> str:
        nonlocal count
        size = np.array(match[1].split(), dtype=float)
        corners = np.concatenate([np.column_stack([ring, np.full(8, z)]) for z in (-0.5, 0.5)]) * size
        hull = ConvexHull(corners)
        rows = np.zeros(len(hull.simplices), dtype=[("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("more", "<u2")])
        inside = np.einsum(
            "ij,ij->i", np.cross(*(np.diff(corners[hull.simplices], axis=1).swapaxes(0, 1))), hull.equations[:, :3]
        )
        rows["corners"] = np.where(
            (inside < 0.0)[:, None, None], corners[hull.simplices][:, ::-1], corners[hull.simplices]
        )
        name = filename.format(count)
        file = folder / "meshes" / name.rsplit("/", 1)[-1].lower()
        file.write_bytes(bytes(80) + len(rows).to_bytes(4, "little") + rows.tobytes())
        count += 1
        return f'<mesh filename="{name}"/>'

    path = folder / "robot.urdf"
    path.write_text(re.sub('<box size="([^"]*)"/>', replaced, text), encoding="utf-8")
    return path


def _link(name: str, size: Vector, middle: Vector, mass: float) -> str:
    x, y, z = (mass / 12.0 * (sum(other**2 for other in size) - own**2) for own in size)
    origin = f'<origin xyz="{_text(middle)}"/>'
    return (
        f'<link name="{name}"><inertial>{origin}<mass value="{mass}"/>'
        f'<inertia ixx="{x}" iyy="{y}" izz="{z}" ixy="0" ixz="0" iyz="0"/></inertial>'
        f'<collision>{origin}<geometry><box size="{_text(size)}"/></geometry></collision></link>'
    )


def _text(values: Vector) -> str:
    return " ".join(f"{value:g}" for value in values)


def shipped_body(robot: str) -> Path:
    """The body file of a shipped robot."""
    return shipped_folder() / "robots" / robot / "body.xml"


def scrambled(robot: str, seed: int = 7) -> str:
    """The body of a shipped robot, whose links, joints and geoms are called anything, and which says nothing else."""
    text = re.sub(r"<!--.*?-->", "", shipped_body(robot).read_text(encoding="utf-8"), flags=re.DOTALL)
    wanted = r'( (?:name|joint|body1|body2)=")([^"]+)"'
    names = sorted({match[1] for match in re.findall(wanted, text)})
    numbers = random.Random(seed).sample(range(1000), len(names))
    new = {name: f"x{number:03d}" for name, number in zip(names, numbers, strict=True)}
    return re.sub(wanted, lambda match: f'{match[1]}{new[match[2]]}"', text).replace(f'model="{robot}"', "")


@cache
def shipped_tree(robot: str) -> Tree:
    """What moves in a shipped robot."""
    return read_tree(compile_body(shipped_body(robot)).model)


@cache
def shipped_anatomy(robot: str) -> Anatomy:
    """Its limbs."""
    return proposed_anatomy(shipped_tree(robot))


def proposed_anatomy(tree: Tree) -> Anatomy:
    """The limbs by the links that are proposed."""
    return find_anatomy(tree, propose_links(tree))


def text_tree(text: str) -> Tree:
    """What moves in MJCF or URDF."""
    return read_tree(compile_body_text(text, source="test").model)


def shipped_posed(robot: str) -> Posed:
    """Kinematics of a shipped robot within the limits of its body."""
    tree, anatomy = shipped_tree(robot), shipped_anatomy(robot)
    limits = {node.joint: (node.lower, node.upper) for node in tree.nodes[1:]}
    return Posed(compile_body(shipped_body(robot)).model, tree, anatomy, find_frames(tree, anatomy), limits)
