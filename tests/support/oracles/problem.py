"""One linear solve of the strict hierarchy as data: levels of rows, a hard box, and the posture that breaks ties."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Level:
    """Rows of one priority: `C x = e` (m) and `lower <= D x <= upper` (k), each up to a slack to be minimised."""

    C: Array
    e: Array
    D: Array
    lower: Array
    upper: Array

    @staticmethod
    def of(C: Array, e: Array, D: Array | None = None, lower: Array | None = None, upper: Array | None = None) -> Level:
        """A level with the inequality rows left out when not given."""
        none = np.zeros(0)
        return Level(
            C=np.ascontiguousarray(C, dtype=np.float64),
            e=np.asarray(e, dtype=np.float64),
            D=np.zeros((0, C.shape[1])) if D is None else np.ascontiguousarray(D, dtype=np.float64),
            lower=none if lower is None else np.asarray(lower, dtype=np.float64),
            upper=none if upper is None else np.asarray(upper, dtype=np.float64),
        )

    @property
    def limits(self) -> tuple[Array, Array]:
        """Lower and upper limits of all rows (m + k,)."""
        return np.concatenate([self.e, self.lower]), np.concatenate([self.e, self.upper])

    def violation(self, x: Array) -> Array:
        """Signed excess of every inequality row at x (k,): negative below `lower`, positive above `upper`, else 0."""
        value = self.D @ x
        return np.minimum(value - self.lower, 0.0) + np.maximum(value - self.upper, 0.0)

    def slack(self, x: Array) -> Array:
        """Residual of the equality rows and violation of the inequality rows at x (m + k,)."""
        return np.concatenate([self.C @ x - self.e, self.violation(x)])

    def size(self, x: Array) -> float:
        """Length that the slack of this level is measured against: its targets and what its rows reach at x."""
        bounds = np.concatenate([self.lower[np.isfinite(self.lower)], self.upper[np.isfinite(self.upper)]])
        terms = [self.e, self.C @ x, self.D @ x, bounds]
        return float(np.sqrt(sum(float(t @ t) for t in terms)))


@dataclass(frozen=True)
class Hierarchy:
    """Levels in order of priority, box `lo <= x <= hi`, and the tie-break `sum w^2 (x - ref)^2 + ||S x - s||^2`."""

    levels: tuple[Level, ...]
    lo: Array
    hi: Array
    weight: Array
    ref: Array
    soft: tuple[Array, Array] | None = None
    name: str = ""

    @property
    def nv(self) -> int:
        """Number of variables."""
        return len(self.lo)

    @property
    def all_levels(self) -> tuple[Level, ...]:
        """The levels with the tie-break as one more level of equality rows."""
        rows, target = np.diag(self.weight), self.weight * self.ref
        if self.soft is not None:
            rows, target = np.vstack([rows, self.soft[0]]), np.concatenate([target, self.soft[1]])
        return (*self.levels, Level.of(rows, target))

    def first(self, count: int) -> Hierarchy:
        """The same problem with only its `count` highest levels."""
        return Hierarchy(self.levels[:count], self.lo, self.hi, self.weight, self.ref, self.soft, self.name)

    def residuals(self, x: Array) -> Array:
        """Norm of every level's slack at x (p + 1,), the tie-break last."""
        return np.array([np.linalg.norm(level.slack(x)) for level in self.all_levels])

    def sizes(self, x: Array) -> Array:
        """What each level's residual is measured against (p + 1,), see `Level.size`."""
        return np.array([level.size(x) for level in self.all_levels])
