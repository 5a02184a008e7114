"""The four postures of a drafted profile, by how far arms and legs are from the trunk and how deep the knees bend."""

from dataclasses import dataclass

from retarget.importing.arm_posture import arm_posture
from retarget.importing.leg_posture import stand
from retarget.importing.posed import Posed

__all__ = ["CROUCHES", "SPREADS", "Postures", "find_postures"]

SPREADS = (0.3, 0.5, 0.75, 1.1)
"""[rad] How far upper arms are from the side, tried one after the other until nothing touches."""
CROUCHES = (0.5, 0.58, 0.66, 0.74, 0.82, 0.9)
"""Shares of the stretched leg, deepest first, tried for the posture at rest."""
ARMS = {"neutral": (0.0, 0.0, 0.6), "stand": (0.0, 0.1, 0.9), "rest": (0.05, 0.0, 0.5), "attractor": (0.25, 0.5, 1.0)}
"""What is added to the spread, how far ahead the upper arm is, and how far the elbow bends, rad."""
LEGS = {"neutral": 0.968, "stand": 0.955, "attractor": 0.87}
"""Shares of the stretched leg."""


@dataclass(frozen=True)
class Postures:
    """angles: posture -> joint -> rad. flat: whether it stands in them as meant. crouch: share of the leg at rest."""

    angles: dict[str, dict[str, float]]
    stands: bool
    crouch: float


def find_postures(posed: Posed, *, spread: float, crouches: tuple[float, ...] = CROUCHES, soles: bool) -> Postures:
    """All four. soles: whether it stands; crouches: tried for the rest, the first in which it stands counts."""
    angles: dict[str, dict[str, float]] = {}
    stands, crouch = True, 1.0
    for name, (further, ahead, bend) in ARMS.items():
        arms = arm_posture(posed, spread=spread + further, ahead=ahead, bend=bend)
        legs: dict[str, float] = {}
        if soles and name != "rest":
            standing = stand(posed, arms, share=LEGS[name])
            legs, stands = standing.angles, stands and standing.stands
        elif soles:
            for crouch in crouches:
                standing = stand(posed, arms, share=crouch)
                legs = standing.angles
                if standing.stands:
                    break
        angles[name] = _whole(posed, {**arms, **legs})
    return Postures(angles, stands, crouch)


def _whole(posed: Posed, angles: dict[str, float]) -> dict[str, float]:
    """With the joints whose limits leave 0 out, inside them; in the order of the body."""
    whole = {}
    for node in posed.tree.nodes[1:]:
        angle = angles.get(node.joint, posed.inside(node.joint, 0.0))
        if angle != 0.0:
            low, high = posed.limits[node.joint]
            whole[node.joint] = min(max(round(angle, 3), low), high)
    return whole
