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

from retarget.model.body_file import compile_body, compile_body_text
from retarget.schema.catalogue import shipped_folder
from retarget.setup.frames import Anatomy, Posed, find_anatomy, find_frames
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
    parts: list[Part], *, base: str, size: Vector, effort: float = 2.5, speed: float = 5.0, extra: str = ""
) -> str:
    """URDF of a tree of parts on a base, a box of `size` m and 0.8 kg. extra: more elements."""
    lines = [f'<robot name="stranger">{_link(base, size, ZERO, 0.8)}']
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
