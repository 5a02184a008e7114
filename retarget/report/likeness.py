"""How much a robot looks like its performer: angles between their limbs, how their trunks lean, and how near its joints
could come to that."""

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
    asked_limbs,
    asked_torso,
    longest,
    turned,
)
from retarget.robot.arm_branches import PARTS, arm_postures, chain_to_anchor, position_limits
from retarget.schema.profile_parts import Landmark
from retarget.types import BoolArray, FloatArray

LIMBS = {
    "upper_arms": ("shoulder", "elbow"),
    "forearms": ("elbow", "hand"),
    "thighs": ("hip", "knee"),
    "shanks": ("knee", "ankle"),
}
"""By name: the frames of a robot, and the joints of a human, between which a limb of each side lies."""
ARMS, LEGS = ("upper_arms", "forearms"), ("thighs", "shanks")
OF_HUMAN = {"hand": "wrist"}
"""Where the joint of a human has another name than the frame of a robot."""
LEAN = "trunk_lean"
TRUNK = ("l_hip", "r_hip", "neck")


def limb_angles(
    robot: RobotBody, q: FloatArray, asked: ReferenceMotion, *, recorded: FloatArray | None = None
) -> dict[str, FloatArray]:
    """Angles (T, s) rad, by the name of a limb and for each side, between a robot in postures (T, nq) and the performer
    in their heading; `LEAN` (T, 1): between the leans of their trunks, each from where it is upright.

    recorded (T, m, 3) m, NaN where not known: the performer's joints instead of those of the reconstruction, in the
    same heading. A limb is left out where the robot has no such frames.
    """
    asked_joints = asked.joints if recorded is None else recorded
    lines, human = _robot_limbs(robot, q), _human_limbs(asked, asked_joints)
    found = {limb: _angle(line, human[limb]) for limb, line in lines.items()}
    if _has_trunk(robot):
        stood = plant(robot, robot.profile.postures.stand).q
        lean = _lean(_trunk(robot, q)) - _lean(_trunk(robot, stood[None])) - _performer_lean(asked, asked_joints)
        found[LEAN] = np.minimum(np.linalg.norm(lean, axis=1), np.pi)[:, None]  # nothing leans farther away
    return found


def _performer_lean(asked: ReferenceMotion, joints: FloatArray) -> FloatArray:
    """How far (T, 2) the performer's trunk leans forward and to the left from where they stand upright, rad."""
    at = {name: joints[:, asked.joint_names.index(name)] for name in TRUNK}
    rest = asked.standing
    upright = rest["neck"] - 0.5 * (rest["l_hip"] + rest["r_hip"])
    return _lean(turned(at["neck"] - 0.5 * (at["l_hip"] + at["r_hip"]), asked.heading)) - _lean(upright[None])


STILL_S, MOVES_DEG, STILL_SHARE = 0.5, 10.0, 0.2
"""A performer moves who turns a limb by so many degrees, from where it was at any time within so many s before; a robot
whose limbs turn by less than this share of that does not move."""


def frozen_share(robot: RobotBody, q: FloatArray, asked: ReferenceMotion) -> float | None:
    """Share of the time in which the performer moves, in which the robot in postures (T, nq) does not; None where the
    performer stands still, or the robot has none of these limbs."""
    human, own = _human_limbs(asked, asked.joints), _robot_limbs(robot, q)
    if not own:
        return None
    performer, moved = (
        _turned_lately(np.concatenate([of[limb] for limb in own], axis=1), asked.dt) for of in (human, own)
    )
    moves = performer > np.deg2rad(MOVES_DEG)
    return float((moved[moves] < STILL_SHARE * performer[moves]).mean()) if moves.any() else None


def _turned_lately(lines: FloatArray, dt: float) -> FloatArray:
    """How far (T - w,) rad any of lines (T, k, 3) turned from where it was within the last w rows, `STILL_S`."""
    window = min(max(round(STILL_S / dt), 1), len(lines) - 1)
    steps = sorted({max(window // part, 1) for part in (1, 2, 4)})
    now = lines[window:]
    return np.asarray(
        np.max([_angle(now, lines[window - step : len(lines) - step]).max(axis=1) for step in steps], axis=0)
    )


LEG_AWAY_DEG = 45.0
"""A thigh or shank that is farther off than this is not where the performer's is: one that is level is 90 from one that
hangs."""


def legs_away(angles: Mapping[str, FloatArray], dt: float) -> dict[str, float]:
    """Longest time, s, that each thigh and shank was more than `LEG_AWAY_DEG` off, by its name. angles: of
    `limb_angles`, `dt` s apart."""
    found = {}
    for limb in (limb for limb in LEGS if limb in angles):
        for side, off in zip("lr", np.degrees(angles[limb]).T, strict=True):
            found[f"{side}_{limb.removesuffix('s')}"] = dt * longest(off > LEG_AWAY_DEG)
    return found


def _robot_limbs(robot: RobotBody, q: FloatArray) -> dict[str, FloatArray]:
    """Both lines (T, 2, 3) m of each limb of which a robot has the frames, in postures (T, nq)."""
    lines = {}
    for limb, parts in LIMBS.items():
        first, last = (tuple(f"{side}_{part}" for side in "lr") for part in parts)
        if set(first + last) <= set(robot.profile.frames):
            lines[limb] = robot.points(q, last) - robot.points(q, first)
    return lines


def _human_limbs(asked: ReferenceMotion, joints: FloatArray) -> dict[str, FloatArray]:
    """Both lines (T, 2, 3) m of each limb of the performer, in their heading."""
    lines = {}
    for limb, parts in LIMBS.items():
        first, last = (
            joints[:, [asked.joint_names.index(f"{side}_{OF_HUMAN.get(part, part)}") for side in "lr"]]
            for part in parts
        )
        lines[limb] = turned(last - first, asked.heading)
    return lines


def _has_trunk(robot: RobotBody) -> bool:
    return set(TRUNK) <= set(robot.profile.frames)


def _trunk(robot: RobotBody, q: FloatArray) -> FloatArray:
    """From the middle of the hips to the neck (T, 3), m."""
    left, right, neck = np.moveaxis(robot.points(q, TRUNK), 1, 0)
    return np.asarray(neck - 0.5 * (left + right))


def _lean(line: FloatArray) -> FloatArray:
    """How far (T, 2) lines (T, 3) lean forward and to the left, rad."""
    return np.arctan2(line[:, :2], line[:, 2:])


def _angle(a: FloatArray, b: FloatArray) -> FloatArray:
    """Angles (...) rad between lines (..., 3)."""
    return np.asarray(np.arctan2(np.linalg.norm(np.cross(a, b), axis=-1), np.sum(a * b, axis=-1)))


# How like the performer the robot's joints would allow it to be: the best posture of each arm, by a search.
#
# What the solver weighs of an arm is the distance between lines: the whole arm, the upper arm, the forearm, each by its
# length and weight. So a posture of the arm is a point in space, its lines one after the other, and so is what is
# asked; the best posture is the nearest one that the limits of the joints allow and in which the arm meets neither the
# trunk nor itself. The trunk is where it is asked. Postures spread over all ranges show where the nearest one lies, and
# random steps that become smaller and smaller find it from the best of these. One arm does not know of the other, nor
# of the legs, nor of speeds, so no robot does better with its trunk as asked.

SPREAD = 20_000
"""Postures of an arm, spread over its ranges: 4 to 15 degrees apart for three to four joints."""
STARTS, DRAWS, ROUNDS = 6, 12, 24
"""Postures from which a search begins; steps that are drawn in each round, of which the best is taken; rounds."""
FIRST_STEP, SHRINKING = 0.15, 0.8
"""Step of the first round, as a share of each joint's range, and of each round after it as a share of the one before.
The last ones are below a degree's tenth."""
BLOCK = 64
"""So many instants are searched together, which bounds the memory."""


def best_angles(robot: RobotBody, asked: ReferenceMotion, weights: Mapping[str, float]) -> dict[str, FloatArray]:
    """As `limb_angles` of the arms and the lean of the trunk, at one tick in `EVERY`, for the best posture of each arm.

    weights: of limbs by name, as in a priority file; 1 for others. Empty where the robot has no landmarks for hands.
    """
    stance = plant(robot, robot.profile.postures.stand)
    turn = asked_torso(robot, stance, asked)
    lines = _robot_limbs(robot, stance.q[None])
    if turn is None or not set(ARMS) <= set(lines):
        return {}
    rows = np.flatnonzero(np.isfinite(turn).all(axis=(1, 2)))[::EVERY]
    if not rows.size:
        return {}
    turn = turn[rows]
    human, found = _human_limbs(asked, asked.joints), {limb: np.empty((len(rows), 2)) for limb in ARMS}
    for column, side in enumerate("lr"):
        limbs = asked_limbs(_arm(robot, side), asked)
        wanted = np.stack([as_carried(turn, line[rows]) for line in limbs.values()], axis=1)
        q = best_postures(robot, stance, side, wanted, weights)
        for limb, line in _robot_limbs(robot, q).items():
            if limb in ARMS:
                found[limb][:, column] = _angle(line[:, column], as_carried(turn, human[limb][rows, column]))
    if _has_trunk(robot):
        trunk = _trunk(robot, stance.q[None])
        lean = _lean(np.einsum("tij,j->ti", turn, trunk[0])) - _lean(trunk) - _performer_lean(asked, asked.joints)[rows]
        found[LEAN] = np.minimum(np.linalg.norm(lean, axis=1), np.pi)[:, None]  # nothing leans farther away
    return found


def best_postures(
    robot: RobotBody, stance: Stance, side: str, wanted: FloatArray, weights: Mapping[str, float]
) -> FloatArray:
    """Postures (t, nq) of the arm of a side, the rest in its stance, whose lines are nearest to those wanted (t, k, 3)
    m: of the landmarks `PARTS` that the profile has, as the trunk of the stance sees them."""
    landmark, arm, chance = f"{side}_hand", _arm(robot, side), np.random.default_rng(0)
    scale = np.array([weights.get(name, 1.0) / entry.robot_length for name, entry in arm.items()])
    frames, anchors = tuple(entry.frame for entry in arm.values()), tuple(entry.anchor[0] for entry in arm.values())
    moving = robot.body.joint_dof[list(chain_to_anchor(robot, landmark))]
    columns, (lower, upper) = robot.body.scalar_joints()[1][moving], position_limits(robot)
    low, high = lower[moving], upper[moving]
    clear = arm_clearance(robot, stance, landmark)

    def points(q: FloatArray) -> FloatArray:
        """The lines of an arm in postures (n, nq), one after the other (n, 3 k)."""
        return np.asarray(scale[:, None] * (robot.points(q, frames) - robot.points(q, anchors))).reshape(len(q), -1)

    spread = arm_postures(robot, stance, landmark, SPREAD)
    spread = spread[clear(spread)]
    seen, goals = points(spread), (scale[:, None] * wanted).reshape(len(wanted), -1)
    best = []
    for goal in np.array_split(goals, range(BLOCK, len(goals), BLOCK)):
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
    """The landmarks of the arm of a side, by name."""
    marks = robot.profile.landmarks
    return {name: marks[name] for part in PARTS if (name := f"{side}_{part}") in marks}


def arm_clearance(robot: RobotBody, stance: Stance, landmark: str) -> Callable[[FloatArray], BoolArray]:
    """Of postures (n, nq): whether (n,) the limb of a landmark meets neither itself nor the links that carry it.

    Geoms of the body's own file, and pairs of links, as the report compares them.
    """
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
