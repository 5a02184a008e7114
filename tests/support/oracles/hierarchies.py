"""Random hierarchies, by seed: each is a plain one with some of the named difficulties put in."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.random import Generator

from oracles.problem import Array, Hierarchy, Level

Change = Callable[[Hierarchy, Generator], Hierarchy]


def plain(rng: Generator, nv: int, levels: int) -> Hierarchy:
    """Full-rank random levels that together may ask for more than `nv` variables have, in a box around zero."""
    rows = [int(rng.integers(1, max(2, min(nv, 12)))) for _ in range(levels)]
    half = rng.uniform(0.2, 2.0, nv)
    return Hierarchy(
        levels=tuple(
            Level.of(rng.normal(size=(m, nv)), rng.normal(size=m) * rng.choice([0.3, 1.0, 3.0])) for m in rows
        ),
        lo=-half * rng.uniform(0.3, 1.0, nv),
        hi=half * rng.uniform(0.3, 1.0, nv),
        weight=rng.uniform(0.3, 2.0, nv),
        ref=rng.normal(size=nv) * 0.3,
    )


def each_level(problem: Hierarchy, change: Callable[[Level], Level]) -> Hierarchy:
    """The problem with every level changed."""
    return replace(problem, levels=tuple(change(level) for level in problem.levels))


def rank_deficient(problem: Hierarchy, rng: Generator) -> Hierarchy:
    """Rows of some levels are combinations of fewer rows; their targets contradict each other."""

    def reduce(level: Level) -> Level:
        m = len(level.e)
        if m < 2 or rng.random() < 0.3:
            return level
        rank = int(rng.integers(1, m))
        return replace(level, C=rng.normal(size=(m, rank)) @ level.C[:rank])

    return each_level(problem, reduce)


def repeated(problem: Hierarchy, rng: Generator) -> Hierarchy:
    """Rows of one level return in lower ones, with the same target or with another."""
    levels = list(problem.levels)
    for k in range(1, len(levels)):
        above = levels[int(rng.integers(k))]
        m = min(len(above.e), 3)
        if m and rng.random() < 0.7:
            target = above.e[:m] + rng.choice([0.0, 1.0]) * rng.normal(size=m)
            levels[k] = replace(
                levels[k], C=np.vstack([levels[k].C, above.C[:m]]), e=np.concatenate([levels[k].e, target])
            )
    return replace(problem, levels=tuple(levels))


def conflicting(problem: Hierarchy, rng: Generator) -> Hierarchy:
    """Targets far out of the box."""
    return each_level(problem, lambda level: replace(level, e=level.e * rng.choice([1.0, 10.0, 100.0])))


def tight(problem: Hierarchy, rng: Generator) -> Hierarchy:
    """A box so narrow that most columns end on a bound."""
    narrow = rng.choice([0.1, 0.01, 1.0], size=problem.nv)
    return replace(problem, lo=problem.lo * narrow, hi=problem.hi * narrow)


def fixed(problem: Hierarchy, rng: Generator) -> Hierarchy:
    """Some columns cannot move at all; rarely none can."""
    share = 1.0 if rng.random() < 0.05 else rng.uniform(0.1, 0.7)
    still = rng.random(problem.nv) < share
    value = np.where(rng.random(problem.nv) < 0.5, 0.0, problem.lo)
    return replace(problem, lo=np.where(still, value, problem.lo), hi=np.where(still, value, problem.hi))


def away(problem: Hierarchy, rng: Generator) -> Hierarchy:
    """Some columns must move: the box does not hold zero, as after a start outside the limits."""
    shift = np.where(rng.random(problem.nv) < 0.3, rng.choice([-3.0, 3.0], size=problem.nv), 0.0)
    return replace(problem, lo=problem.lo + shift, hi=problem.hi + shift)


def inequalities(problem: Hierarchy, rng: Generator) -> Hierarchy:
    """Inequality rows on some levels: one-sided, two-sided, slack, met or out of reach."""

    def add(level: Level) -> Level:
        k = int(rng.integers(0, 7))
        D = rng.normal(size=(k, problem.nv))
        middle = rng.normal(size=k) * rng.choice([0.3, 1.0, 10.0])
        half = rng.uniform(0.0, 1.0, k) * rng.choice([0.0, 1.0], size=k, p=[0.15, 0.85])
        side = rng.integers(0, 3, size=k)
        lower = np.where(side == 1, -np.inf, middle - half)
        upper = np.where(side == 2, np.inf, middle + half)
        return Level.of(level.C, level.e, D, lower, upper)

    return each_level(problem, add)


def opposed(problem: Hierarchy, rng: Generator) -> Hierarchy:
    """A pair of inequality rows that push against each other, in one level or across two, and that no x satisfies."""
    normal = rng.normal(size=problem.nv)
    gap = rng.uniform(0.0, 1.0)

    def push(level: Level, sign: float) -> Level:
        return Level.of(
            level.C,
            level.e,
            np.vstack([level.D, sign * normal]),
            np.append(level.lower, gap),
            np.append(level.upper, np.inf),
        )

    levels = list(problem.levels)
    for sign in (1.0, -1.0):
        at = int(rng.integers(len(levels)))
        levels[at] = push(levels[at], sign)
    return replace(problem, levels=tuple(levels))


def vanishing(problem: Hierarchy, rng: Generator) -> Hierarchy:
    """Rows that reach only one or two columns, so that nothing is left of them when those are clamped or fixed."""

    def thin(level: Level) -> Level:
        C = level.C.copy()
        for row in C[rng.random(len(C)) < 0.5]:
            kept = rng.choice(problem.nv, size=int(rng.integers(1, 3)), replace=False)
            row[np.setdiff1d(np.arange(problem.nv), kept)] = 0.0
        return replace(level, C=C)

    return each_level(problem, thin)


def sparse(problem: Hierarchy, rng: Generator) -> Hierarchy:
    """Every level reaches the columns of one chain, as Jacobians do; a level may be empty."""

    def chain(level: Level) -> Level:
        if rng.random() < 0.1:
            return replace(level, C=level.C[:0], e=level.e[:0])
        start = int(rng.integers(problem.nv))
        column = np.arange(problem.nv)
        on = (column < 3) | ((column >= start) & (column < start + 7))
        return replace(level, C=level.C * on)

    return each_level(problem, chain)


def integer(problem: Hierarchy, rng: Generator) -> Hierarchy:
    """Rows, targets and bounds of small whole numbers: ties, parallel rows and degenerate corners everywhere."""

    def whole(rows: Array) -> Array:
        return np.clip(np.round(rows), -2.0, 2.0)

    def change(level: Level) -> Level:
        return Level(whole(level.C), whole(level.e), whole(level.D), np.floor(level.lower), np.ceil(level.upper))

    changed = each_level(problem, change)
    return replace(changed, lo=np.floor(problem.lo), hi=np.ceil(problem.hi), ref=whole(problem.ref))


def soft(problem: Hierarchy, rng: Generator) -> Hierarchy:
    """A last level that holds tasks beside the posture."""
    m = int(rng.integers(1, 7))
    return replace(problem, soft=(rng.normal(size=(m, problem.nv)), rng.normal(size=m)))


def scaled(problem: Hierarchy, rng: Generator) -> Hierarchy:
    """Levels in other units, up to a thousand times larger or smaller."""

    def units(level: Level) -> Level:
        s = 10.0 ** rng.integers(-3, 4)
        return Level(level.C * s, level.e * s, level.D * s, level.lower * s, level.upper * s)

    return each_level(problem, units)


def near_singular(problem: Hierarchy, rng: Generator) -> Hierarchy:
    """One row of a level is nearly a combination of the others."""

    def bend(level: Level) -> Level:
        C = level.C.copy()
        if len(C) > 1:
            C[-1] = C[0] + 10.0 ** rng.uniform(-5, -2) * C[-1]
        return replace(level, C=C)

    return each_level(problem, bend)


CHANGES: tuple[Change, ...] = (
    sparse,
    vanishing,
    rank_deficient,
    repeated,
    conflicting,
    inequalities,
    opposed,
    tight,
    fixed,
    away,
    soft,
    integer,
    scaled,
)
ROUGH_CHANGES: tuple[Change, ...] = (*CHANGES, near_singular)


def random_hierarchy(seed: int, changes: tuple[Change, ...] = CHANGES, *, share: float = 0.3) -> Hierarchy:
    """A hierarchy of 3 to 57 variables and 1 to 7 levels, with each difficulty put in with probability `share`."""
    rng = np.random.default_rng(seed)
    nv = int(rng.integers(3, 13) if rng.random() < 0.6 else rng.integers(13, 58))
    problem = plain(rng, nv, int(rng.integers(1, 8)))
    chosen = [change for change in changes if rng.random() < share]
    for change in chosen:
        problem = change(problem, rng)
    names = " ".join(change.__name__ for change in chosen)
    return replace(problem, name=f"seed {seed}: nv {nv}, {len(problem.levels)} levels, {names or 'plain'}")
