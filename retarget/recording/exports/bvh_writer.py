"""BVH: a body's tree as a skeleton, y up, z forward, centimetres.

Rotations of zero give the pose of the body with all joints at zero. A joint whose link slides, or turns about another
point than its origin, has position channels too.
"""

from dataclasses import dataclass, replace
from typing import IO

import numpy as np

from retarget import rotations
from retarget.recording.motion import CM, Links, Motion, links_of, quaternion_columns
from retarget.types import FloatArray

STUB = 0.02
"""Length, m, of a last bone of unknown length."""
_ARM = {"collar": "Shoulder", "shoulder": "Arm", "elbow": "ForeArm", "wrist": "Hand", "hand": "HandMiddle1"}
_LEG = {"hip": "UpLeg", "knee": "Leg", "ankle": "Foot", "toe": "ToeBase"}
HUMAN = {"pelvis": "Hips", "spine": "Spine", "chest": "Spine1", "neck": "Neck", "head": "Head"} | {
    f"{letter}_{part}": side + name
    for letter, side in (("l", "Left"), ("r", "Right"))
    for part, name in (_ARM | _LEG).items()
}
"""BVH names of the parts of the virtual human."""
HEAD_JOINT = 0.6
"""Share of the distance from the neck to the centre of the head at which BVH tools expect the head joint. Its bone ends
as far above the centre."""


@dataclass(frozen=True, eq=False)
class Node:
    """A joint of the skeleton: a point `local` (3,) m of a link. parent: index of a node, -1 for the root. end (3,) m:
    end of its bone."""

    name: str
    link: int
    parent: int
    local: FloatArray
    end: FloatArray


def nodes_of(motion: Motion) -> tuple[Node, ...]:
    """The first link and its descendants, depth first. Every link of a robot is a joint; the virtual human has
    HumanIK's joints, with head, hands and toes."""
    body, human = motion.body, motion.is_human
    nodes: list[Node] = []

    def add(link: int, parent: int) -> None:
        own = len(nodes)
        # The bone ends at the farthest frame on the link, or twice as far as its centre of mass.
        sites = [frame.position for frame in body.frames if frame.body == link]
        bone = max(sites, key=np.linalg.norm) if sites else 2.0 * body.com[link]
        bone = bone if np.linalg.norm(bone) >= STUB else np.array([0.0, 0.0, STUB])
        nodes.append(Node(_name(body.body_names[link], nodes, human), link, parent, np.zeros(3), bone))
        for frame in body.frames:
            if human and frame.body == link and frame.name in HUMAN:
                joint = HEAD_JOINT if frame.name == "head" else 1.0
                end = 2.0 * (1.0 - joint) * frame.position
                nodes.append(Node(HUMAN[frame.name], link, own, joint * frame.position, end))
        for child in np.flatnonzero(body.parent == link).tolist():
            if child:
                add(child, own)

    add(1, -1)
    return tuple(nodes)


def _name(link: str, taken: list[Node], human: bool) -> str:
    """A unique name without blanks and braces, which any reader takes."""
    if human and link in HUMAN:
        return HUMAN[link]
    name = "".join(letter if letter.isalnum() or letter in "_-.:" else "_" for letter in link) or "link"
    while any(name == node.name for node in taken):
        name += "_"
    return name


ORDER = "zxy"
"""Order of the rotation channels."""
AXES = [1, 2, 0]
"""World axes of x, y and z of the file: left, up, forward."""
CONSTANT_M = 1e-6
"""Motion, m, in its parent's frame below which a joint has a constant offset."""
BVH_DECIMALS = 6
"""Decimals of a number, cm or degrees: 10 nm."""


@dataclass(frozen=True, eq=False)
class BvhSkeleton:
    """Joints (b) of `nodes`, file axes and cm. offsets, ends (b, 3): at rest, and of bones. places (T, b, 3) and turns
    (T, b, 4): in the parent joint's frame."""

    nodes: tuple[Node, ...]
    offsets: FloatArray
    places: FloatArray
    turns: FloatArray
    ends: FloatArray

    def moves(self, joint: int) -> bool:
        """True if a joint has position channels."""
        off = np.abs(self.places[:, joint] - self.offsets[joint])
        return self.nodes[joint].parent < 0 or bool(off.max() > CM * CONSTANT_M)


def write_bvh(motion: Motion, stream: IO[bytes]) -> None:
    """Write a motion. Raises InputError for unevenly spaced rows."""
    skeleton, rate = _skeleton(motion), motion.rate_hz
    lines = ["HIERARCHY", *_block(skeleton, 0, 0)]
    lines += ["MOTION", f"Frames: {len(skeleton.places)}", f"Frame Time: {1.0 / rate:.9f}"]
    stream.write(("\n".join(lines) + "\n").encode())
    np.savetxt(stream, _channels(skeleton), fmt=f"%.{BVH_DECIMALS}f")


def _skeleton(motion: Motion) -> BvhSkeleton:
    upright = np.zeros((1, motion.body.nq))
    upright[0, quaternion_columns(motion.body)] = 1.0
    nodes, links, rest = nodes_of(motion), links_of(motion), links_of(replace(motion[:1], q=upright))
    position, stand = _points(nodes, links), _points(nodes, rest)[0]
    rows = [node.link - 1 for node in nodes]
    # A joint's frame is the link's rotation from rest, so that all frames are parallel at rest.
    turn = rotations.multiply(links.orientation[:, rows], rotations.conjugate(rest.orientation[0, rows]))
    turn = turn[..., [0, *(1 + axis for axis in AXES)]]
    offsets, places, turns = np.zeros_like(stand), position.copy(), turn.copy()
    for joint, node in enumerate(nodes):
        if node.parent >= 0:
            back = rotations.conjugate(turn[:, node.parent])
            offsets[joint] = stand[joint] - stand[node.parent]
            places[:, joint] = rotations.rotate(back, position[:, joint] - position[:, node.parent])
            turns[:, joint] = rotations.multiply(back, turn[:, joint])
    ends = rotations.rotate(rest.orientation[0, rows], np.array([node.end for node in nodes]))
    return BvhSkeleton(nodes, offsets, places, turns, CM * ends[:, AXES])


def _points(nodes: tuple[Node, ...], links: Links) -> FloatArray:
    """Positions (T, b, 3) of all joints, file axes, cm."""
    rows = [node.link - 1 for node in nodes]
    local = rotations.rotate(links.orientation[:, rows], np.array([node.local for node in nodes]))
    return np.asarray(CM * (links.position[:, rows] + local)[..., AXES])


def _block(skeleton: BvhSkeleton, joint: int, depth: int) -> list[str]:
    tab = "\t" * depth
    turns = [f"{axis.upper()}rotation" for axis in ORDER]
    channels = ["Xposition", "Yposition", "Zposition", *turns] if skeleton.moves(joint) else turns
    lines = [
        f"{tab}{'JOINT' if depth else 'ROOT'} {skeleton.nodes[joint].name}",
        f"{tab}{{",
        f"{tab}\tOFFSET {_numbers(skeleton.offsets[joint])}",
        f"{tab}\tCHANNELS {len(channels)} {' '.join(channels)}",
    ]
    children = [child for child, node in enumerate(skeleton.nodes) if node.parent == joint]
    for child in children:
        lines += _block(skeleton, child, depth + 1)
    if not children:
        lines += [f"{tab}\tEnd Site", f"{tab}\t{{", f"{tab}\t\tOFFSET {_numbers(skeleton.ends[joint])}", f"{tab}\t}}"]
    return [*lines, f"{tab}}}"]


def _numbers(values: FloatArray) -> str:
    return " ".join(f"{value:.{BVH_DECIMALS}f}" for value in values)


def _channels(skeleton: BvhSkeleton) -> FloatArray:
    parts = []
    for joint in range(len(skeleton.nodes)):
        if skeleton.moves(joint):
            parts.append(skeleton.places[:, joint])
        angles = rotations.to_euler(skeleton.turns[:, joint], ORDER)
        parts.append(np.rad2deg(np.unwrap(angles, axis=0)))  # no jump from 180 to -180 degrees between two frames
    return np.hstack(parts)
