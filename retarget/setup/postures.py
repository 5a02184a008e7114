"""Postures of a drafted robot: stand, neutral, rest and attractor, clear of itself."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from retarget.ik.least_squares import least_squares
from retarget.model.body import BodyModel
from retarget.model.observers import NEAR_LINKS, steps_between
from retarget.setup.fit_observers import MAX_PAIRS, Fit
from retarget.setup.frames import Angles, Posed
from retarget.setup.limbs import UP, arm_roles, leg_roles
from retarget.setup.survey import PlacedShapes
from retarget.types import BoolArray, FloatArray

# Joint angles of arms next to the trunk with bent elbows, for any joints of the arms.

REST = 0.02
"""Weight of staying near the middle of 0: joints that do not matter stay there."""


def arm_posture(posed: Posed, *, spread: float, ahead: float, bend: float) -> dict[str, float]:
    """Angles (rad) of both arms: upper arms down, `spread` out to the side and `ahead` to the front, elbows bent to the
    front by `bend`, rad. As near to that as the arms get; mirrored."""
    anatomy, tree = posed.anatomy, posed.tree
    if not anatomy.arms:
        return {}
    side = "l" if len(anatomy.arms) == 2 else "r"
    arm = anatomy.arms[0]
    joints = [tree.nodes[node].joint for node in arm.nodes]
    last = arm_roles(tree, arm).wrist
    if last is not None:
        joints = joints[: arm.nodes.index(last)]
    zero = posed.place({})
    shoulder, hand = zero.positions[f"{side}_shoulder"], f"{side}_hand"
    elbow = f"{side}_elbow" if f"{side}_elbow" in zero.positions else None
    outward = anatomy.left if side == "l" else -anatomy.left
    upper = float(np.linalg.norm(zero.positions[elbow] - shoulder)) if elbow else 0.0
    lower = float(np.linalg.norm(zero.positions[hand] - (zero.positions[elbow] if elbow else shoulder)))
    length = max(upper + lower, 1e-6)
    at_elbow = shoulder + upper * _down(anatomy.forward, outward, ahead, spread)
    at_hand = at_elbow + lower * _down(anatomy.forward, outward, ahead + bend, spread)

    def off(angles: FloatArray) -> FloatArray:
        there = posed.place(_named(posed, joints, angles)).positions
        parts = [there[hand] - at_hand] + ([there[elbow] - at_elbow] if elbow else [])
        return np.concatenate([part / length for part in parts])

    low, high = _bounds(posed, joints)
    found = _solved(posed, joints, off, np.clip(0.0, low, high), REST)
    return posed.mirrored(_named(posed, joints, found))


def _named(posed: Posed, joints: list[str], angles: FloatArray) -> dict[str, float]:
    return {joint: posed.inside(joint, angle) for joint, angle in zip(joints, angles.tolist(), strict=True)}


def _bounds(posed: Posed, joints: list[str]) -> FloatArray:
    """Lowest and highest angles (2, n), rad."""
    return np.array([posed.limits[joint] for joint in joints]).T


def _solved(
    posed: Posed, joints: list[str], off: Callable[[FloatArray], FloatArray], start: FloatArray, rest: float
) -> FloatArray:
    """Angles (n,) of joints near `start` (n,) where `off` is least. rest: weight of staying near 0, for joints that do
    not matter."""
    low, high = _bounds(posed, joints)
    middle = np.clip(0.0, low, high)
    return least_squares(
        lambda angles: np.concatenate([off(angles), rest * (angles - middle)]), start, lower=low, upper=high
    )


def _down(forward: FloatArray, outward: FloatArray, ahead: float, spread: float) -> FloatArray:
    """Direction (3,) from straight down, `ahead` to the front and `spread` outwards."""
    return np.asarray(np.cos(spread) * (np.sin(ahead) * forward - np.cos(ahead) * UP) + np.sin(spread) * outward)


# Standing: legs bent so far, trunk upright, soles flat, and the centre of mass over the middle of the soles.

BEND = 0.9
"""[rad] of the knee, from which the search starts."""
LEG_REST = 0.003
FLAT, OVER = 0.01, 0.01
"""A sole is flat within so much (rad), the centre of mass over its middle within so much of the leg's length."""


@dataclass(frozen=True)
class Standing:
    """angles of the legs, rad. stands: whether soles are flat, the centre of mass is over their middle, and the legs
    have the length asked."""

    angles: dict[str, float]
    stands: bool


def leg_length(posed: Posed) -> float:
    """Distance (m) from hip to ankle along the leg, which is that of the stretched leg."""
    at = posed.place({}).positions
    way = np.array([at[name] for name in ("l_hip", "l_knee", "l_ankle") if name in at])
    return float(np.linalg.norm(np.diff(way, axis=0), axis=1).sum())


def stand(posed: Posed, others: Angles, *, share: float) -> Standing:
    """The legs with hip and ankle `share` of their longest distance apart; others: angles of the other joints, rad."""
    anatomy, tree = posed.anatomy, posed.tree
    leg = anatomy.legs[0]
    joints = [tree.nodes[node].joint for node in leg.nodes]
    longest = leg_length(posed)
    sideways = float(posed.place({}).positions["l_hip"] @ anatomy.left)

    def off(angles: FloatArray) -> FloatArray:
        placed = posed.place({**others, **posed.mirrored(_named(posed, joints, angles))})
        sole, at = placed.axes["l_sole"], placed.positions
        middle = 0.5 * (at["l_sole"] + at["r_sole"])
        ahead = (placed.centre_of_mass - middle) @ anatomy.forward / longest
        reach = float(np.linalg.norm(at["l_hip"] - at["l_ankle"])) / longest - share
        width = (float(at["l_ankle"] @ anatomy.left) - sideways) / longest
        behind = max(0.0, sole[:, 2] @ -UP)  # upside down
        tilt = [sole[:, 2] @ anatomy.forward, sole[:, 2] @ anatomy.left, sole[:, 0] @ anatomy.left]
        return np.array([*tilt, 2.0 * ahead, 2.0 * reach, 0.3 * width, 10.0 * behind])

    found = _solved(posed, joints, off, _bent(posed), LEG_REST)
    left = np.abs(off(found))
    return Standing(
        posed.mirrored(_named(posed, joints, found)), left[:2].max() <= FLAT and left[3:5].max() <= 2.0 * OVER
    )


def _bent(posed: Posed) -> FloatArray:
    """Angles (n,) of the first leg with thigh ahead, shin back and foot flat, from which the search starts."""
    tree, leg, left = posed.tree, posed.anatomy.legs[0], posed.anatomy.left
    roles = leg_roles(tree, leg, left)
    shares = {roles.hip: -0.5, roles.knee: 1.0, roles.ankle: -0.5}
    turn = np.array([shares.get(node, 0.0) * float(np.sign(tree.nodes[node].axis @ left)) for node in leg.nodes])
    low, high = _bounds(posed, [tree.nodes[node].joint for node in leg.nodes])
    return np.clip(BEND * turn, low, high)


SPREADS = (0.3, 0.5, 0.75, 1.1)
"""[rad] How far upper arms are from the side, tried one after the other until nothing touches."""
CROUCHES = (0.5, 0.58, 0.66, 0.74, 0.82, 0.9)
"""Shares of the stretched leg, deepest first, tried for the posture at rest."""
ARMS = {"neutral": (0.0, 0.0, 0.6), "stand": (0.0, 0.1, 0.9), "attractor": (0.25, 0.5, 1.0), "rest": (0.05, 0.0, 0.5)}
"""Angles, rad, of the arms in each posture: what is added to the spread, upper arm ahead, and bend of the elbow."""
LEGS = {"neutral": (0.968,), "stand": (0.955,), "attractor": (0.87,)}
"""Shares of the stretched leg."""


@dataclass(frozen=True)
class Postures:
    """angles: posture -> joint -> rad. flat: whether it stands in them as meant. crouch: share of the leg at rest."""

    angles: dict[str, dict[str, float]]
    stands: bool
    crouch: float


def find_postures(posed: Posed, *, spread: float, crouches: tuple[float, ...] = CROUCHES, soles: bool) -> Postures:
    """Find the four postures of a drafted profile, rad by joint. soles: whether it stands; crouches: tried for the
    rest, the first in which it stands counts."""
    angles: dict[str, dict[str, float]] = {}
    stands, share = True, 1.0
    for name, (further, ahead, bend) in ARMS.items():
        arms = arm_posture(posed, spread=spread + further, ahead=ahead, bend=bend)
        standing = Standing({}, True)
        for share in LEGS.get(name, crouches) if soles else ():
            standing = stand(posed, arms, share=share)
            if standing.stands:
                break
        angles[name] = _whole(posed, {**arms, **standing.angles})
        stands = stands and standing.stands
    return Postures(angles, stands, share)


def _whole(posed: Posed, angles: dict[str, float]) -> dict[str, float]:
    """The non-zero angles of a posture in the order of the body; joints whose limits exclude 0 are moved inside."""
    whole = {}
    for node in posed.tree.nodes[1:]:
        angle = angles.get(node.joint, posed.inside(node.joint, 0.0))
        if angle != 0.0:
            low, high = posed.limits[node.joint]
            whole[node.joint] = min(max(round(angle, 3), low), high)
    return whole


# Postures in which a drafted robot does not touch itself, in the shapes of its observers.

NEAREST_M = 0.002
"""Parts that are nearer than this to each other in a posture touch."""

Links = tuple[str, str]


def clear_postures(
    body: BodyModel, fitted: Fit, posed: Posed, first: Postures, *, soles: bool
) -> tuple[Postures, tuple[Links, ...]]:
    """Arms as near to the trunk, and the crouch at rest as deep, as nothing touches in the shapes of `fitted`; and the
    pairs of links that touch whatever the arms do.

    body: that was fitted. first: the postures with the arms nearest to the trunk. soles: whether it stands.
    """
    bench = _Bench(body, fitted)
    best, touching, spread = first, bench.touching(first.angles), SPREADS[0]
    for further in SPREADS[1:] if posed.anatomy.arms else ():
        if not touching:
            break
        postures = find_postures(posed, spread=further, soles=soles)
        found = bench.touching(postures.angles)
        if len(found) < len(touching):
            best, touching, spread = postures, found, further
    while soles and bench.touches_at_rest(best.angles):
        crouches = tuple(share for share in CROUCHES if share > best.crouch)
        if not crouches:
            break
        best = find_postures(posed, spread=spread, crouches=crouches, soles=soles)
    return best, touching


class _Bench:
    """The shapes of fitted observers, looked at in any posture."""

    def __init__(self, body: BodyModel, fitted: Fit) -> None:
        observers, self._body, self._shapes = fitted.observers, body, PlacedShapes(body, fitted.observers)
        ignored = {frozenset(verdict.links) for verdict in fitted.ignored[:MAX_PAIRS]}
        looked = {}
        for pair in sorted(record.pair for record in fitted.records):
            first, second = (observers[place] for place in pair)
            if frozenset((first.link_name, second.link_name)) not in ignored:
                looked[pair] = (first.link_name, second.link_name), steps_between(body, first.link, second.link)
        self._pairs = np.array(list(looked), dtype=np.int64).reshape(-1, 2)
        self._links = [links for links, _ in looked.values()]
        self._near: BoolArray = np.array([steps for _, steps in looked.values()], dtype=int) <= NEAR_LINKS

    def touching(self, postures: dict[str, dict[str, float]]) -> tuple[Links, ...]:
        """Pairs of links that keep a run from beginning: they touch, farther apart along the body than neighbours."""
        neutral = self._distances(postures["neutral"])
        found = (neutral <= NEAREST_M) & ~self._near
        for name in ("stand", "attractor"):
            distance = self._distances(postures[name])
            # Neighbours that touch in the neutral posture are never looked at, and others may well be near.
            found |= np.where(self._near, (distance <= 0.0) & (neutral > 0.0), distance <= NEAREST_M)
        return tuple(dict.fromkeys(self._links[place] for place in np.flatnonzero(found)))

    def touches_at_rest(self, postures: dict[str, dict[str, float]]) -> bool:
        """Whether the posture at rest touches where the neutral one does not."""
        rest, neutral = self._distances(postures["rest"]), self._distances(postures["neutral"])
        return bool(((rest <= NEAREST_M) & (neutral > NEAREST_M)).any())

    def _distances(self, angles: Angles) -> FloatArray:
        """Signed distance (p,) m of each pair in a posture."""
        return np.asarray(self._shapes.distances(self._body.posture(angles)[None], self._pairs)[0])
