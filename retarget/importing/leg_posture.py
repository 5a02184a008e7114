"""Standing: legs bent so far, trunk upright, soles flat, and the centre of mass over the middle of the soles."""

from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares

from retarget.importing.limb_roles import leg_roles
from retarget.importing.limbs import UP
from retarget.importing.posed import Angles, Posed
from retarget.rotations import FloatArray

__all__ = ["Standing", "leg_length", "stand"]

BENDS = (0.4, 0.9, 1.6)
"""[rad] of the knee, from which the search starts."""
REST = 0.003
SIGNIFICANT = 1e-3
"""[rad] Less is 0."""
FLAT, OVER = 0.01, 0.01
"""A sole is flat within so much (rad), the centre of mass over its middle within so much of the leg's length."""


@dataclass(frozen=True)
class Standing:
    """angles of the legs, rad. flat (rad): how far the soles are from it, off: how far the centre of mass is from the
    middle of the soles and the legs from the length asked, m."""

    angles: dict[str, float]
    flat: float
    off: float
    length: float

    @property
    def stands(self) -> bool:
        """Whether this is the posture that was asked for."""
        return self.flat <= FLAT and self.off <= OVER * self.length


def leg_length(posed: Posed) -> float:
    """Longest distance (m) from hip to ankle, by the knee alone."""
    joint = _knee(posed)
    low, high = posed.limits[joint] if joint else (0.0, 0.0)
    spans = []
    for angle in np.linspace(low, high, 181):
        there = posed.place({joint: float(angle)} if joint else {}).positions
        spans.append(float(np.linalg.norm(there["l_hip"] - there["l_ankle"])))
    return max(spans)


def stand(posed: Posed, others: Angles, *, share: float) -> Standing:
    """The legs with hip and ankle `share` of their longest distance apart; others: angles of the other joints, rad."""
    anatomy, tree = posed.anatomy, posed.tree
    leg = anatomy.legs[0]
    joints = [tree.nodes[node].joint for node in leg.nodes]
    longest = leg_length(posed)
    low, high = np.array([posed.limits[joint] for joint in joints]).T
    sideways = float(posed.place({}).positions["l_hip"] @ anatomy.left)

    def both(angles: FloatArray) -> dict[str, float]:
        return {**others, **posed.mirrored(dict(zip(joints, angles.tolist(), strict=True)))}

    def parts(angles: FloatArray) -> tuple[FloatArray, FloatArray]:
        placed = posed.place(both(angles))
        sole, at = placed.axes["l_sole"], placed.positions
        tilt = np.array([sole[:, 2] @ anatomy.forward, sole[:, 2] @ anatomy.left, sole[:, 0] @ anatomy.left])
        middle = 0.5 * (at["l_sole"] + at["r_sole"])
        ahead = (placed.centre_of_mass - middle) @ anatomy.forward / longest
        reach = float(np.linalg.norm(at["l_hip"] - at["l_ankle"])) / longest - share
        width = (float(at["l_ankle"] @ anatomy.left) - sideways) / longest
        behind = max(0.0, sole[:, 2] @ -UP)  # upside down
        return tilt, np.array([2.0 * ahead, 2.0 * reach, 0.3 * width, 10.0 * behind])

    def off(angles: FloatArray) -> FloatArray:
        tilt, rest = parts(angles)
        return np.concatenate([tilt, rest, REST * (angles - np.clip(0.0, low, high))])

    best = min(
        (
            least_squares(off, start, bounds=(low - 1e-9, high + 1e-9), max_nfev=80)
            for start in _starts(posed, low, high)
        ),
        key=lambda result: float(result.cost) + _backward_knee(posed, both(result.x)),
    )
    angles = {
        joint: posed.inside(joint, round(float(angle), 3))
        for joint, angle in zip(joints, best.x, strict=True)
        if abs(angle) > SIGNIFICANT
    }
    tilt, rest = parts(np.array([angles.get(joint, posed.inside(joint, 0.0)) for joint in joints]))
    return Standing(
        posed.mirrored(angles), float(np.abs(tilt[:2]).max()), 0.5 * longest * float(np.abs(rest[:2]).max()), longest
    )


def _knee(posed: Posed) -> str | None:
    roles = leg_roles(posed.tree, posed.anatomy.legs[0], posed.anatomy.left)
    return None if roles.knee is None else posed.tree.nodes[roles.knee].joint


def _starts(posed: Posed, low: FloatArray, high: FloatArray) -> list[FloatArray]:
    """Thigh ahead, shin back, foot flat, with the knee bent less and more, from a straight leg."""
    tree, leg, left = posed.tree, posed.anatomy.legs[0], posed.anatomy.left
    roles = leg_roles(tree, leg, left)
    share = {roles.hip: -0.5, roles.knee: 1.0, roles.ankle: -0.5}
    starts = []
    for bend in BENDS:
        turn = [
            bend * share[node] * float(np.sign(tree.nodes[node].axis @ left)) if node in share else 0.0
            for node in leg.nodes
        ]
        starts.append(np.clip(np.array(turn), low, high))
    return starts


def _backward_knee(posed: Posed, angles: Angles) -> float:
    """A large cost where the knee is behind the line from hip to ankle, as a bird's."""
    at = posed.place(angles).positions
    if "l_knee" not in at:
        return 0.0
    knee = (at["l_knee"] - 0.5 * (at["l_hip"] + at["l_ankle"])) @ posed.anatomy.forward
    return 1.0 if knee < -0.02 * float(np.linalg.norm(at["l_hip"] - at["l_ankle"])) else 0.0
