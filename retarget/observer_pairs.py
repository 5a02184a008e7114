"""Which observers are looked at together: not those of one link or of neighbours, not what the profile ignores, and
not what touches at rest (paper, "Handling self collisions")."""

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from retarget import _solver, rotations
from retarget.body import BodyModel, IntArray
from retarget.errors import ConfigError, Problem
from retarget.rotations import FloatArray

if TYPE_CHECKING:
    from retarget.observers import Observers

__all__ = ["DroppedPair", "PairRules", "checked_pairs", "placed", "steps_between"]

NEAR_LINKS = 2
"""Links that are so many steps apart along the body may touch at rest and are then never looked at; what is farther
apart and touches is a fault of the neutral posture or of the shapes."""

NEVER_NEAR = "never near"
"""How the reason begins of a pair that a fit found to stay apart; it says nothing more of interest."""

AT_HOME = 0.75
"""Most of a pair's distance at rest that may be margin. Asked for more, a body could never rest: nothing below would
move."""


@dataclass(frozen=True)
class DroppedPair:
    """Two observers, by name, that are not looked at together, and why. neighbours: on links that one joint parts."""

    first: str
    second: str
    reason: str
    neighbours: bool = False


@dataclass(frozen=True, eq=False)
class PairRules:
    """neutral: posture (nq,) in which pairs that touch are dropped. resting: others in which the body is at home: a
    pair's margin is at most a share of its distance in any of them. ignored: links, and why. where: for messages."""

    neutral: FloatArray
    resting: tuple[FloatArray, ...] = ()
    ignored: tuple[tuple[int, int, str], ...] = field(default=())
    where: str = ""


def checked_pairs(
    body: BodyModel, observers: "Observers", rules: PairRules
) -> tuple[IntArray, tuple[DroppedPair, ...], FloatArray]:
    """Pairs (p, 2) that are looked at, those that are not, and most that each of the first keeps (p,) m. Raises
    ConfigError: far along the body, and touching at rest."""
    ignored = {frozenset(pair[:2]): pair[2] for pair in rules.ignored}
    checked, dropped = [], []
    for first, second in zip(*np.triu_indices(len(observers.names), 1), strict=True):
        links = int(observers.links[first]), int(observers.links[second])
        steps = steps_between(body, *links)
        if steps == 0:
            continue
        reason = "neighbours along the body" if steps == 1 else ignored.get(frozenset(links))
        if reason is None:
            checked.append((first, second))
        else:
            dropped.append(DroppedPair(observers.names[first], observers.names[second], reason, steps == 1))
    pairs = np.array(checked, dtype=np.int64).reshape(-1, 2)
    distance = _distances(body, observers, pairs, rules.neutral)
    touching = distance <= 0.0
    problems = []
    for (first, second), depth in zip(pairs[touching], -distance[touching], strict=True):
        names = observers.names[first], observers.names[second]
        steps = steps_between(body, int(observers.links[first]), int(observers.links[second]))
        if steps > NEAR_LINKS:
            problems.append(_far_apart(names, steps, depth, rules.where))
        dropped.append(DroppedPair(*names, f"touch by {1e3 * depth:.1f} mm in the neutral posture"))
    if problems:
        raise ConfigError.from_problems(problems)
    pairs = np.ascontiguousarray(pairs[~touching])
    resting = [_distances(body, observers, pairs, q) for q in (rules.neutral, *rules.resting)]
    margin = AT_HOME * np.maximum(np.min(resting, axis=0), 0.0)
    return pairs, tuple(dropped), margin


def placed(body: BodyModel, observers: "Observers", q: FloatArray) -> tuple[FloatArray, FloatArray]:
    """World positions (..., n, 3) and orientations (..., n, 4) wxyz of the observers' frames in postures (..., nq)."""
    solver, links, rows = body.solver_body(), observers.links.tolist(), np.ascontiguousarray(np.atleast_2d(q))
    position = solver.points(rows, links, np.ascontiguousarray(observers.positions))
    quat = rotations.multiply(solver.orientations(rows, links), observers.quats)
    return (position, quat) if q.ndim > 1 else (position[0], quat[0])


def _distances(body: BodyModel, observers: "Observers", pairs: IntArray, q: FloatArray) -> FloatArray:
    """Signed distance (p,) m of each pair in a posture (nq,)."""
    position, quat = placed(body, observers, q)
    kinds, sizes = observers.kinds, observers.sizes
    a, b = (np.ascontiguousarray(column) for column in pairs.T)
    return _solver.shape_distances(kinds[a], sizes[a], position[a], quat[a], kinds[b], sizes[b], position[b], quat[b])[
        0
    ]


def steps_between(body: BodyModel, first: int, second: int) -> int:
    """How many links with joints lie on the way from one link to another: 0 for links that never move apart."""
    return len(body.links_between(first, second).intersection(body.joint_body.tolist()))


def _far_apart(names: tuple[str, str], steps: int, depth: float, where: str) -> Problem:
    return Problem(
        "parts that are far apart along the body touch in the neutral posture",
        where=where,
        found=f"{names[0]} and {names[1]}, {steps} joints apart, {1e3 * depth:.1f} mm deep",
        allowed=f"a touch of parts at most {NEAR_LINKS} joints apart",
        next_step="Move the neutral posture, draw the shapes tighter, or ignore the pair with a reason",
    )
