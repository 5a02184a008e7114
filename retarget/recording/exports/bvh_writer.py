"""BVH: a body's tree as a skeleton, y up, z forward, centimetres.

With all rotations zero the skeleton stands as the body does with all joints at zero, facing z. A joint whose link
slides, or turns about a point that is not its origin, has position channels too.
"""

from dataclasses import dataclass, replace
from typing import IO

import numpy as np

from retarget import rotations
from retarget.recording.motion import Links, Motion, links_of, quaternion_columns
from retarget.types import FloatArray

# Which parts of a body become joints of a BVH skeleton, what they are called, and where their last bones end.
#
# Of a robot every link is one, at its origin and under its own name. The virtual human's joints have the names that
# MotionBuilder's HumanIK gave them, which most tools know, and its head, hands and toes are joints as well.

STUB = 0.02
"""Length, m, of a last bone of which nothing says how long it is."""
_ARM = {"collar": "Shoulder", "shoulder": "Arm", "elbow": "ForeArm", "wrist": "Hand", "hand": "HandMiddle1"}
_LEG = {"hip": "UpLeg", "knee": "Leg", "ankle": "Foot", "toe": "ToeBase"}
HUMAN = {"pelvis": "Hips", "spine": "Spine", "chest": "Spine1", "neck": "Neck", "head": "Head"} | {
    f"{letter}_{part}": side + name
    for letter, side in (("l", "Left"), ("r", "Right"))
    for part, name in (_ARM | _LEG).items()
}
"""Parts of the virtual human: their names in the file."""
HEAD_JOINT = 0.6
"""Share of the way from the neck to the centre of the head at which the head's joint stands: below the skull, as tools
and readers of BVH take it. Its bone ends as far above the centre."""


@dataclass(frozen=True, eq=False)
class Node:
    """A joint of the skeleton: a point that is fixed to a link. parent: index of a node, -1 of the root.

    local (3,) m: in the link's frame. end (3,) m: where its bone ends, in the same frame from `local` on, if nothing
    hangs on it.
    """

    name: str
    link: int
    parent: int
    local: FloatArray
    end: FloatArray


def nodes_of(motion: Motion) -> tuple[Node, ...]:
    """The first link and all that hang on it; parents come first, and each joint before those of the next branch."""
    body, human = motion.body, motion.is_human
    nodes: list[Node] = []

    def add(link: int, parent: int) -> None:
        own = len(nodes)
        nodes.append(Node(_name(body.body_names[link], nodes, human), link, parent, np.zeros(3), _end(motion, link)))
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
    """A name that any reader takes: no blanks, no braces, none twice."""
    if human and link in HUMAN:
        return HUMAN[link]
    name = "".join(letter if letter.isalnum() or letter in "_-.:" else "_" for letter in link) or "link"
    while any(name == node.name for node in taken):
        name += "_"
    return name


def _end(motion: Motion, link: int) -> FloatArray:
    """The farthest frame on the link, or twice as far as its centre of mass."""
    sites = [frame.position for frame in motion.body.frames if frame.body == link]
    local = max(sites, key=np.linalg.norm) if sites else 2.0 * motion.body.com[link]
    return local if np.linalg.norm(local) >= STUB else np.array([0.0, 0.0, STUB])


CM = 100.0
ORDER = "zxy"
"""Order of the rotation channels."""
AXES = [1, 2, 0]
"""World axes of x, y and z of the file: left, up, forward. A turn of the axes, no mirror image."""
STILL = 1e-6
"""A joint that moves less than this, m, in its parent's frame has a constant offset."""
DIGITS = 6
"""Decimals of a number in the file, cm or degrees: 10 nm, far below what a recording resolves."""


@dataclass(frozen=True, eq=False)
class BvhSkeleton:
    """Joints (b) as `nodes`, file axes and cm. offsets (b, 3): at rest. places (T, b, 3) and turns (T, b, 4): in the
    parent joint's frame. ends (b, 3): bone ends."""

    nodes: tuple[Node, ...]
    offsets: FloatArray
    places: FloatArray
    turns: FloatArray
    ends: FloatArray

    def moves(self, joint: int) -> bool:
        """Whether a joint has position channels."""
        off = np.abs(self.places[:, joint] - self.offsets[joint])
        return self.nodes[joint].parent < 0 or bool(off.max() > CM * STILL)


def write_bvh(motion: Motion, stream: IO[bytes]) -> None:
    """Write a motion. Raises InputError where rows are not evenly spaced."""
    skeleton, rate = _skeleton(motion), motion.rate_hz
    lines = ["HIERARCHY", *_block(skeleton, 0, 0)]
    lines += ["MOTION", f"Frames: {len(skeleton.places)}", f"Frame Time: {1.0 / rate:.9f}"]
    stream.write(("\n".join(lines) + "\n").encode())
    np.savetxt(stream, _channels(skeleton), fmt=f"%.{DIGITS}f")


def _skeleton(motion: Motion) -> BvhSkeleton:
    nodes, links, rest = nodes_of(motion), links_of(motion), _rest(motion)
    position, stand = _points(nodes, links), _points(nodes, rest)[0]
    rows = [node.link - 1 for node in nodes]
    # A joint's frame is the link's turn from where it is at rest, so that all frames are parallel then.
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


def _rest(motion: Motion) -> Links:
    """The body with every joint at zero, its root at the origin and upright."""
    q = np.zeros((1, motion.body.nq))
    q[0, quaternion_columns(motion.body)] = 1.0
    return links_of(replace(motion[:1], q=q))


def _block(skeleton: BvhSkeleton, joint: int, depth: int) -> list[str]:
    """The lines of a joint and all below it."""
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
    return " ".join(f"{value:.{DIGITS}f}" for value in values)


def _channels(skeleton: BvhSkeleton) -> FloatArray:
    """All channels (T, d): nodes are in the order of the file."""
    parts = []
    for joint in range(len(skeleton.nodes)):
        if skeleton.moves(joint):
            parts.append(skeleton.places[:, joint])
        angles = rotations.to_euler(skeleton.turns[:, joint], ORDER)
        parts.append(np.rad2deg(np.unwrap(angles, axis=0)))  # no jump from 180 to -180 degrees between two frames
    return np.hstack(parts)
