"""Likeness of a robot to its performer: angles between their limbs and trunks, and the best that its joints allow."""

from collections.abc import Callable, Mapping

import numpy as np

from retarget.ik.support_polygon import Stance, plant
from retarget.model.body_file import compile_body
from retarget.model.robot import RobotBody
from retarget.report.clearance import compared_pairs, moving_geoms
from retarget.report.tracking import (
    EVERY,
    ReferenceMotion,
    as_carried,
    limb_references,
    longest,
    torso_rotation,
    turned,
)
from retarget.robot.arm_branches import PARTS, arm_postures, chain_to_anchor, position_limits
from retarget.schema.profile_parts import Landmark
from retarget.types import BoolArray, FloatArray

LIMB_ENDS = {
    "upper_arms": ("shoulder", "elbow"),
    "forearms": ("elbow", "hand"),
    "thighs": ("hip", "knee"),
    "shanks": ("knee", "ankle"),
}
"""Frames of a robot, and joints of a human, between which a limb of each side lies."""
ARMS, LEGS = ("upper_arms", "forearms"), ("thighs", "shanks")
OF_HUMAN = {"hand": "wrist"}
"""Names of human joints that differ from those of robot frames."""
LEAN = "trunk_lean"
TRUNK_POINTS = ("l_hip", "r_hip", "neck")


def limb_angles(
    robot: RobotBody, q: FloatArray, reference: ReferenceMotion, *, recorded: FloatArray | None = None
) -> dict[str, FloatArray]:
    """Angles (T, s) rad between the limbs of robot and performer, by limb and side, in their headings. `LEAN` (T, 1):
    between the leans of their trunks, each from upright.

    q: postures (T, nq). recorded (T, m, 3) m: joints instead of the reconstructed ones. Limbs without robot frames are
    left out.
    """
    joints = reference.joints if recorded is None else recorded
    lines, human = _robot_limbs(robot, q), _human_limbs(reference, joints)
    found = {limb: _angle(line, human[limb]) for limb, line in lines.items()}
    if _has_trunk(robot):
        stood = plant(robot, robot.profile.postures.stand).q
        lean = _lean(_trunk(robot, q)) - _lean(_trunk(robot, stood[None])) - _performer_lean(reference, joints)
        found[LEAN] = np.minimum(np.linalg.norm(lean, axis=1), np.pi)[:, None]  # nothing leans farther away
    return found


def _performer_lean(reference: ReferenceMotion, joints: FloatArray) -> FloatArray:
    at = {name: joints[:, reference.joint_names.index(name)] for name in TRUNK_POINTS}
    rest = reference.standing
    upright = rest["neck"] - 0.5 * (rest["l_hip"] + rest["r_hip"])
    return _lean(turned(at["neck"] - 0.5 * (at["l_hip"] + at["r_hip"]), reference.heading)) - _lean(upright[None])


MOVES_S, MOVES_DEG, STILL_SHARE = 0.5, 10.0, 0.2
"""A performer moves if a limb turned by MOVES_DEG within MOVES_S. A robot is frozen if its limbs then turned by less
than STILL_SHARE of that."""


def frozen_share(robot: RobotBody, q: FloatArray, reference: ReferenceMotion) -> float | None:
    """Share of the performer's moving time in which the robot, in postures (T, nq), is frozen; None if nothing moves,
    or the robot has no such limbs."""
    human, own = _human_limbs(reference, reference.joints), _robot_limbs(robot, q)
    if not own:
        return None
    performer, moved = (
        _turned_lately(np.concatenate([of[limb] for limb in own], axis=1), reference.dt) for of in (human, own)
    )
    moves = performer > np.deg2rad(MOVES_DEG)
    return float((moved[moves] < STILL_SHARE * performer[moves]).mean()) if moves.any() else None


def _turned_lately(lines: FloatArray, dt: float) -> FloatArray:
    """Largest rotation (T - w,) rad of lines (T, k, 3) within the last w rows, `MOVES_S`."""
    window = min(max(round(MOVES_S / dt), 1), len(lines) - 1)
    steps = sorted({max(window // part, 1) for part in (1, 2, 4)})
    now = lines[window:]
    return np.asarray(
        np.max([_angle(now, lines[window - step : len(lines) - step]).max(axis=1) for step in steps], axis=0)
    )


LEG_AWAY_DEG = 45.0
"""Angle of a thigh or shank that is away: half of that between a level and a hanging one."""


def legs_away(angles: Mapping[str, FloatArray], dt: float) -> dict[str, float]:
    """Longest time, s, that each thigh and shank was away. angles: from `limb_angles`, `dt` s apart."""
    found = {}
    for limb in (limb for limb in LEGS if limb in angles):
        for side, off in zip("lr", np.degrees(angles[limb]).T, strict=True):
            found[f"{side}_{limb.removesuffix('s')}"] = dt * longest(off > LEG_AWAY_DEG)
    return found


def _robot_limbs(robot: RobotBody, q: FloatArray) -> dict[str, FloatArray]:
    """Lines (T, 2, 3) m of both sides of each limb of a robot."""
    lines = {}
    for limb, parts in LIMB_ENDS.items():
        first, last = (tuple(f"{side}_{part}" for side in "lr") for part in parts)
        if set(first + last) <= set(robot.profile.frames):
            lines[limb] = robot.points(q, last) - robot.points(q, first)
    return lines


def _human_limbs(reference: ReferenceMotion, joints: FloatArray) -> dict[str, FloatArray]:
    """Lines (T, 2, 3) m of both sides of each limb of the performer, in their heading."""
    lines = {}
    for limb, parts in LIMB_ENDS.items():
        first, last = (
            joints[:, [reference.joint_names.index(f"{side}_{OF_HUMAN.get(part, part)}") for side in "lr"]]
            for part in parts
        )
        lines[limb] = turned(last - first, reference.heading)
    return lines


def _has_trunk(robot: RobotBody) -> bool:
    return set(TRUNK_POINTS) <= set(robot.profile.frames)


def _trunk(robot: RobotBody, q: FloatArray) -> FloatArray:
    left, right, neck = np.moveaxis(robot.points(q, TRUNK_POINTS), 1, 0)
    return np.asarray(neck - 0.5 * (left + right))


def _lean(line: FloatArray) -> FloatArray:
    """Lean (T, 2) rad of lines (T, 3), forward and to the left."""
    return np.arctan2(line[:, :2], line[:, 2:])


def _angle(a: FloatArray, b: FloatArray) -> FloatArray:
    return np.asarray(np.arctan2(np.linalg.norm(np.cross(a, b), axis=-1), np.sum(a * b, axis=-1)))


# Best posture of each arm, by search from postures spread over all ranges, with random steps of falling size. The cost
# is that of the solver: distances between the lines of the whole arm, the upper arm and the forearm, each by its length
# and weight. Joint limits hold, and the arm meets neither the trunk nor itself. The trunk is at its target, and speeds
# and other limbs do not count, so no robot does better.

SPREAD = 20_000
"""Postures spread over an arm: 4 to 15 degrees apart for three to four joints."""
STARTS, DRAWS, ROUNDS = 6, 12, 24
"""Start postures of a search, random steps in each round, and rounds."""
FIRST_STEP, SHRINKING = 0.15, 0.8
"""First step, as a share of each joint's range, and its factor per round. The last steps are below a tenth of a
degree."""
SEARCH_BLOCK = 64
"""Instants that are searched together, which bounds the memory."""


def best_angles(robot: RobotBody, reference: ReferenceMotion, weights: Mapping[str, float]) -> dict[str, FloatArray]:
    """Like `limb_angles`, for the best arms and the trunk, at one tick in `EVERY`. weights: of limbs, 1 for others.
    Empty without landmarks for hands."""
    stance = plant(robot, robot.profile.postures.stand)
    turn = torso_rotation(robot, stance, reference)
    lines = _robot_limbs(robot, stance.q[None])
    if turn is None or not set(ARMS) <= set(lines):
        return {}
    rows = np.flatnonzero(np.isfinite(turn).all(axis=(1, 2)))[::EVERY]
    if not rows.size:
        return {}
    turn = turn[rows]
    human, found = _human_limbs(reference, reference.joints), {limb: np.empty((len(rows), 2)) for limb in ARMS}
    for column, side in enumerate("lr"):
        limbs = limb_references(_arm(robot, side), reference)
        desired = np.stack([as_carried(turn, line[rows]) for line in limbs.values()], axis=1)
        q = best_postures(robot, stance, side, desired, weights)
        for limb, line in _robot_limbs(robot, q).items():
            if limb in ARMS:
                found[limb][:, column] = _angle(line[:, column], as_carried(turn, human[limb][rows, column]))
    if _has_trunk(robot):
        trunk = _trunk(robot, stance.q[None])
        lean = (
            _lean(np.einsum("tij,j->ti", turn, trunk[0]))
            - _lean(trunk)
            - _performer_lean(reference, reference.joints)[rows]
        )
        found[LEAN] = np.minimum(np.linalg.norm(lean, axis=1), np.pi)[:, None]  # nothing leans farther away
    return found


def best_postures(
    robot: RobotBody, stance: Stance, side: str, desired: FloatArray, weights: Mapping[str, float]
) -> FloatArray:
    """Postures (t, nq) of one arm, the rest in its stance, whose lines are nearest to the desired ones (t, k, 3) m of
    the landmarks `PARTS`, in the trunk frame."""
    landmark, arm, chance = f"{side}_hand", _arm(robot, side), np.random.default_rng(0)
    scale = np.array([weights.get(name, 1.0) / entry.robot_length for name, entry in arm.items()])
    frames, anchors = tuple(entry.frame for entry in arm.values()), tuple(entry.anchor[0] for entry in arm.values())
    moving = robot.body.joint_dof[list(chain_to_anchor(robot, landmark))]
    columns, (lower, upper) = robot.body.scalar_joints()[1][moving], position_limits(robot)
    low, high = lower[moving], upper[moving]
    clear = arm_clearance(robot, stance, landmark)

    def points(q: FloatArray) -> FloatArray:
        return np.asarray(scale[:, None] * (robot.points(q, frames) - robot.points(q, anchors))).reshape(len(q), -1)

    spread = arm_postures(robot, stance, landmark, SPREAD)
    spread = spread[clear(spread)]
    seen, goals = points(spread), (scale[:, None] * desired).reshape(len(desired), -1)
    best = []
    for goal in np.array_split(goals, range(SEARCH_BLOCK, len(goals), SEARCH_BLOCK)):
        near = np.array([np.argpartition(np.sum((seen - one) ** 2, axis=1), STARTS)[:STARTS] for one in goal])
        q, step = spread[near.ravel()], FIRST_STEP * (high - low)
        to = np.repeat(goal, STARTS, axis=0)
        cost = np.sum((points(q) - to) ** 2, axis=1)
        for _ in range(ROUNDS):
            tried = np.repeat(q, DRAWS, axis=0)
            moved = tried[:, columns] + step * chance.standard_normal((len(tried), moving.size))
            tried[:, columns] = np.clip(moved, low, high)
            costs = np.sum((points(tried) - np.repeat(to, DRAWS, axis=0)) ** 2, axis=1).reshape(-1, DRAWS)
            least = costs.argmin(axis=1)
            tried, costs = tried[np.arange(len(q)) * DRAWS + least], costs[np.arange(len(q)), least]
            better = np.flatnonzero(costs < cost)
            better = better[clear(tried[better])]
            q[better], cost[better], step = tried[better], costs[better], SHRINKING * step
        first = cost.reshape(-1, STARTS).argmin(axis=1)
        best.append(q[np.arange(len(goal)) * STARTS + first])
    return np.concatenate(best)


def _arm(robot: RobotBody, side: str) -> dict[str, Landmark]:
    marks = robot.profile.landmarks
    return {name: marks[name] for part in PARTS if (name := f"{side}_{part}") in marks}


def arm_clearance(robot: RobotBody, stance: Stance, landmark: str) -> Callable[[FloatArray], BoolArray]:
    """A function of postures (n, nq), true (n,) where the limb of a landmark meets neither itself nor the links that
    carry it, by the geoms of the report."""
    body, profile = robot.body, robot.profile
    chain = {int(body.joint_body[joint]) for joint in chain_to_anchor(robot, landmark)}
    carrying = body.chain_to_root(robot.frame(profile.landmarks[landmark].anchor[0]).body)
    limb = {link for link in range(1, len(body.body_names)) if chain & set(body.chain_to_root(link))}
    model = compile_body(profile.body_path, root=profile.root).model
    own, near = ([model.body(body.body_names[link]).id for link in links] for links in (limb, {*limb, *carrying}))
    geoms = moving_geoms(model, stance.q[None])
    ignored = [entry.pair for entry in profile.ignore_pairs]
    neutral = robot.posture(profile.postures.neutral)
    pairs = compared_pairs(model, geoms.links, geoms.geoms, neutral=neutral, ignored=ignored)
    of = geoms.links[pairs]
    pairs = pairs[np.isin(of, own).any(axis=1) & np.isin(of, near).all(axis=1)]

    def clear(q: FloatArray) -> BoolArray:
        placed, free = moving_geoms(model, q), np.ones(len(q), dtype=np.bool_)
        rows, which = np.nonzero(placed.bounds(pairs)(np.arange(len(q))) < 0.0)
        free[rows[placed.distances(pairs)(rows, which) < 0.0]] = False
        return free

    return clear
