"""Which parts of a body become joints of a BVH skeleton, what they are called, and where their last bones end.

Of a robot every link is one, at its origin and under its own name. The virtual human's joints have the names that
MotionBuilder's HumanIK gave them, which most tools know, and its head, hands and toes are joints as well.
"""

from dataclasses import dataclass

import numpy as np

from retarget.exporting.motion import Motion
from retarget.rotations import FloatArray

__all__ = ["Node", "nodes_of"]

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
    body, human = motion.body, motion.robot == "human"
    nodes: list[Node] = []

    def add(link: int, parent: int) -> None:
        own = len(nodes)
        nodes.append(Node(_name(body.body_names[link], nodes, human), link, parent, np.zeros(3), _end(motion, link)))
        for frame in body.frames:
            if human and frame.body == link and frame.name in HUMAN:
                nodes.append(Node(HUMAN[frame.name], link, own, frame.position, np.zeros(3)))
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
