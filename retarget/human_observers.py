"""What a virtual human observes itself and its surroundings with: the lines of the paper, or a capsule on every
segment."""

from typing import Literal

import numpy as np

from retarget.human import Human
from retarget.observer_pairs import PairRules
from retarget.observers import Observers, ShapeRow, assemble, geom_shape
from retarget.priorities import ObserverSettings
from retarget.scalar_rotations import arc
from retarget.scene_shapes import ShapeKind

__all__ = ["human_observers"]

NEUTRAL = "attractor"
"""Posture in which pairs that touch are dropped: arms away from the trunk."""
LIMBS = (("shoulder", "elbow"), ("elbow", "wrist"), ("hip", "knee"), ("knee", "ankle"))
"""Ends of the paper's eight lines, four on the upper and four on the lower limbs: joints by name, each side."""
HEAD = "head"

Worn = Literal["none", "lines", "lines_and_head", "capsules"]


def human_observers(human: Human, settings: ObserverSettings, worn: Worn | None = None) -> Observers | None:
    """The observers of a human of this size; None where the settings want none. worn: instead of the settings' choice.

    Raises ConfigError: parts far apart along the body touch in the neutral posture.
    """
    worn = settings.human if worn is None else worn
    if worn == "none":
        return None
    names = {geom.name: geom for geom in human.body.geoms}
    links, rows = {}, {}
    if worn == "capsules":
        for name, geom in names.items():
            row = geom_shape(geom)
            assert row is not None, "a human is made of capsules and balls"
            links[name], rows[name] = geom.body, row
    else:
        for near, far in LIMBS:
            for side in ("l", "r"):
                name = f"{side}_{near}"
                links[name], rows[name] = human.body.body_index(name), _line(human, f"{side}_{far}")
    if worn == "lines_and_head":
        geom = names[HEAD]
        row = geom_shape(geom)
        assert row is not None, "a head is a ball"
        links[HEAD], rows[HEAD] = geom.body, row
    margin = 0.01 if settings.margin is None else settings.margin
    zones = dict.fromkeys(rows, (settings.influence, margin))
    rules = PairRules(neutral=human.posture(NEUTRAL), where="virtual human")
    return assemble(human.body, links, rows, zones, rules)


def _line(human: Human, far: str) -> ShapeRow:
    """Line from a link's joint to the next."""
    end = human.dimensions.of(far)
    half = 0.5 * float(np.linalg.norm(end))
    x, y, z = end.tolist()
    return ShapeKind.CAPSULE, (0.0, half, 0.0), 0.5 * end, np.array(arc((0.0, 0.0, 1.0), (x, y, z)))
