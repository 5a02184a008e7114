"""Postures of a drafted robot without self-contact: stand, neutral, rest and attractor."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from retarget.arithmetic import norm
from retarget.ik.least_squares import least_squares
from retarget.setup.frames import Angles, LimbNodes, Posed, wrist_of
from retarget.setup.links import pitch_joints
from retarget.setup.tree import UP
from retarget.types import FloatArray

ARM_REST, LEG_REST = 0.02, 0.003
"""Weights that keep joints near 0, so that joints without another goal stay there."""
BEND = 0.9
"""Initial bend of the knee, rad."""
FLAT, OVER = 0.01, 0.02
"""Tolerances of a standing posture: tilt of a sole, rad, and twice the errors of centre of mass and leg, as shares of
the leg's length."""
SPREADS = (0.3, 0.5, 0.75, 1.1)
"""Angles of upper arms from the side, rad, tried in this order until nothing touches."""
CROUCHES = (0.5, 0.58, 0.66, 0.74, 0.82, 0.9)
"""Shares of the stretched leg that are tried for the posture at rest."""
ARMS = {"neutral": (0.0, 0.0, 0.6), "stand": (0.0, 0.1, 0.9), "attractor": (0.25, 0.5, 1.0), "rest": (0.05, 0.0, 0.5)}
"""Angles of the arms, rad: additional spread, upper arm ahead, and bend of the elbow."""
LEGS = {"neutral": 0.968, "stand": 0.955, "attractor": 0.87}
"""Shares of the stretched leg."""


def leg_length(posed: Posed, side: str = "l") -> float:
    """Length of the stretched leg from hip to ankle, m."""
    at = posed.place({}).positions
    path = np.array([at[name] for part in ("hip", "knee", "ankle") if (name := f"{side}_{part}") in at])
    return float(np.linalg.norm(np.diff(path, axis=0), axis=1).sum())


@dataclass(frozen=True)
class FoundPosture:
    """A posture, rad by joint. stands: True if it is within FLAT and OVER."""

    angles: dict[str, float]
    stands: bool


def find_posture(posed: Posed, *, spread: float, ahead: float, bend: float, share: float | None) -> FoundPosture:
    """Find a posture with an upright trunk by least squares. Arms hang, `spread` to the side and `ahead` to the front,
    with elbows bent by `bend`, rad. share: desired distance of hip and ankle as a share of `leg_length`, on flat soles
    with the centre of mass over their middle; None leaves the legs at 0."""
    anatomy, zero = posed.anatomy, posed.place({}).positions
    arms, legs = anatomy.arms, anatomy.legs if share is not None else {}
    weights, start = _joints(posed, legs)
    joints = list(weights)
    if not joints:
        return FoundPosture(_whole(posed, {}), stands=share is None)
    low, high = np.array([posed.limits[joint] for joint in joints]).T
    middle, near = np.clip(0.0, low, high), np.array(list(weights.values()))
    hands = {side: _hand_targets(posed, side, zero, spread, ahead, bend) for side in arms}
    longest = {side: max(leg_length(posed, side), 1e-6) for side in legs}

    def off(angles: FloatArray) -> FloatArray:
        placed = posed.place(dict(zip(joints, angles.tolist(), strict=True)))
        at, parts = placed.positions, [near * (angles - middle)]
        for targets, length in hands.values():
            parts += [(at[name] - target) / length for name, target in targets.items()]
        return np.concatenate([*parts, *legs_off(placed.axes, at, placed.centre_of_mass)])

    def legs_off(axes: dict[str, FloatArray], at: dict[str, FloatArray], mass: FloatArray) -> list[FloatArray]:
        found = []
        for side, length in longest.items():
            sole, hip, ankle = axes[f"{side}_sole"], at[f"{side}_hip"], at[f"{side}_ankle"]
            tilt = [sole[:, 2] @ anatomy.forward, sole[:, 2] @ anatomy.left]
            over = float((mass - 0.5 * (at["l_sole"] + at["r_sole"])) @ anatomy.forward) / length
            reach, aside = norm(hip - ankle) / length - float(share or 0.0), (ankle - hip) @ anatomy.left / length
            behind = max(0.0, float(sole[:, 2] @ -UP))  # upside down
            found.append(
                np.array([*tilt, 2.0 * over, 2.0 * reach, sole[:, 0] @ anatomy.left, 0.3 * aside, 10.0 * behind])
            )
        return found

    first = np.array([start.get(joint, 0.0) for joint in joints])
    angles = dict(
        zip(joints, least_squares(off, np.clip(first, low, high), lower=low, upper=high).tolist(), strict=True)
    )
    placed = posed.place(angles)
    left = [np.abs(one) for one in legs_off(placed.axes, placed.positions, placed.centre_of_mass)]
    stands = all(one[:2].max() <= FLAT and one[2:4].max() <= OVER for one in left)
    return FoundPosture(_whole(posed, angles), stands)


def _joints(posed: Posed, legs: Mapping[str, LimbNodes]) -> tuple[dict[str, float], dict[str, float]]:
    """Weights near 0 of the joints of arms and legs, and initial angles, rad: thigh ahead, shin back, foot flat."""
    tree, left = posed.tree, posed.anatomy.left
    weights, start = dict[str, float](), dict[str, float]()
    for arm in posed.anatomy.arms.values():
        wrist = wrist_of(tree, arm)
        nodes = arm.nodes if wrist is None else arm.nodes[: arm.nodes.index(wrist)]
        weights |= dict.fromkeys((tree.nodes[node].joint for node in nodes), ARM_REST)
    for leg in legs.values():
        weights |= dict.fromkeys((tree.nodes[node].joint for node in leg.nodes), LEG_REST)
        pitches = pitch_joints(tree, leg.nodes, left)
        for node in {*pitches[:1], *pitches[-1:], *([leg.bend] if leg.bend else [])}:
            turn = BEND if node == leg.bend else -0.5 * BEND
            start[tree.nodes[node].joint] = turn * float(np.sign(tree.nodes[node].axis @ left))
    return weights, start


def _hand_targets(
    posed: Posed, side: str, zero: dict[str, FloatArray], spread: float, ahead: float, bend: float
) -> tuple[dict[str, FloatArray], float]:
    """Target positions (3,), m, of elbow and hand, and the length of the arm, m."""
    anatomy = posed.anatomy
    outward = anatomy.left if side == "l" else -anatomy.left
    place, last, targets, length = zero[f"{side}_shoulder"], zero[f"{side}_shoulder"], dict[str, FloatArray](), 1e-6
    for part, turn in (("elbow", ahead), ("hand", ahead + bend)):
        name = f"{side}_{part}"
        if name in zero:
            reach, last = norm(zero[name] - last), zero[name]
            down = np.cos(spread) * (np.sin(turn) * anatomy.forward - np.cos(turn) * UP) + np.sin(spread) * outward
            place, length = place + reach * down, length + reach
            targets[name] = place
    return targets, length


def _whole(posed: Posed, angles: Angles) -> dict[str, float]:
    """Non-zero angles of a posture in the order of the body. Joints whose limits exclude 0 are clamped."""
    whole = {}
    for node in posed.tree.nodes[1:]:
        low, high = posed.limits[node.joint]
        angle = min(max(round(angles.get(node.joint, 0.0), 3), low), high)
        if angle != 0.0:
            whole[node.joint] = angle
    return whole


Touching = Callable[[Angles, Angles], frozenset[frozenset[str]]]
"""The pairs of links that touch in a posture, given the neutral one, see `PlacedShapes.touching`."""


def find_postures(posed: Posed, *, soles: bool, touching: Touching) -> dict[str, FoundPosture]:
    """Find the four postures of a profile. Arms are as near to the trunk, and the rest crouch as deep, as is possible
    without contact. soles: True if the robot stands."""
    best, least = dict[str, FoundPosture](), np.inf
    for spread in SPREADS if posed.anatomy.arms else SPREADS[:1]:
        found = {
            name: find_posture(posed, spread=spread + more, ahead=ahead, bend=bend, share=LEGS[name] if soles else None)
            for name, (more, ahead, bend) in ARMS.items()
            if name in LEGS
        }
        neutral = found["neutral"].angles
        hits = len(frozenset().union(*(touching(one.angles, neutral) for one in found.values())))
        if hits < least:
            best, least, chosen = found, hits, spread
        if not hits:
            break
    neutral, (more, ahead, bend) = best["neutral"].angles, ARMS["rest"]
    known = touching(neutral, neutral)
    for share in CROUCHES if soles else (None,):
        rest = find_posture(posed, spread=chosen + more, ahead=ahead, bend=bend, share=share)
        if rest.stands and touching(rest.angles, neutral) <= known:
            break
    return best | {"rest": rest}
