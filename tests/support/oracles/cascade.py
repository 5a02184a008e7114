"""The strict hierarchy as a cascade of quadratic programs: each level with what the levels above reached fixed.

The programs go to two well-kept solvers (quadprog, daqp); the better answer of each level is kept, after its active set
has been solved once more to rounding. Levels are rank-deficient and the solvers want a definite Hessian: proximal-point
steps bridge that.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import daqp
import numpy as np
import quadprog
from numpy.typing import NDArray

from oracles.optimality import find_multipliers, row_basis
from oracles.problem import Array, Hierarchy, Level

FEASIBLE = 1e-9
PROXIMAL = (1e-5, 1e-8, 1e-11)  # rows have norm 1; the smaller, the faster, the less stable
PROXIMAL_STEPS = 10


@dataclass(frozen=True)
class Rows:
    """Hard rows `lower <= A x <= upper` at the present point."""

    A: Array
    lower: Array
    upper: Array

    def stacked(self, A: Array, lower: Array, upper: Array) -> Rows:
        """These rows and more below."""
        join = np.concatenate
        return Rows(np.vstack([self.A, A]), join([self.lower, lower]), join([self.upper, upper]))

    def subset(self, keep: NDArray[np.bool_]) -> Rows:
        """The rows marked in `keep`."""
        return Rows(self.A[keep], self.lower[keep], self.upper[keep])

    def along(self, N: Array, at: Array) -> Rows:
        """These rows in coordinates z of x = at + N z, of unit length; rows that no z changes are left out."""
        rows, value = self.A @ N, self.A @ at
        length = np.linalg.norm(rows, axis=1)
        kept = length > 1e-10 * np.linalg.norm(self.A, axis=1)
        # `at` is feasible up to rounding, and z = 0 must be feasible exactly.
        lower, upper = np.minimum(self.lower - value, 0.0), np.maximum(self.upper - value, 0.0)
        return Rows(rows[kept] / length[kept, None], lower[kept] / length[kept], upper[kept] / length[kept])


@dataclass(frozen=True)
class LevelProgram:
    """min ||A z - b||^2 + ||s||^2, soft rows hold up to s, hard rows hold: one level in the space left, z."""

    A: Array
    b: Array
    soft: Rows
    hard: Rows

    def cost(self, z: Array) -> float:
        """Half the squared slack at z."""
        residual, value = self.A @ z - self.b, self.soft.A @ z
        excess = np.minimum(value - self.soft.lower, 0.0) + np.maximum(value - self.soft.upper, 0.0)
        return 0.5 * float(residual @ residual + excess @ excess)

    def infeasibility(self, z: Array) -> float:
        """Worst violation of a hard row at z."""
        value = self.hard.A @ z
        low, high = np.max(self.hard.lower - value, initial=0.0), np.max(value - self.hard.upper, initial=0.0)
        return float(max(low, high))


QuadraticSolver = Callable[[Array, Array, Array, Array, Array], Array]


def by_quadprog(H: Array, f: Array, A: Array, lower: Array, upper: Array) -> Array:
    """Goldfarb-Idnani."""
    low, high = np.isfinite(lower), np.isfinite(upper)
    rows = np.vstack([A[low], -A[high]])
    bound = np.concatenate([lower[low], -upper[high]])
    return np.asarray(quadprog.solve_qp(H, -f, rows.T.copy(), bound)[0])


def by_daqp(H: Array, f: Array, A: Array, lower: Array, upper: Array) -> Array:
    """Dual active set; infinite bounds are 1e30 there."""
    low, high = np.maximum(lower, -1e30), np.minimum(upper, 1e30)
    sense = np.zeros(len(low), dtype=np.int32)
    x, _, flag, _ = daqp.solve(H, f, A, high, low, sense, primal_tol=1e-11, dual_tol=1e-12, eps_prox=0.0)
    if flag < 1:
        raise ValueError(f"daqp gave up with flag {flag}")
    return np.asarray(x)


SOLVERS: tuple[QuadraticSolver, ...] = (by_quadprog, by_daqp)


def solve_level(program: LevelProgram) -> Array:
    """Best z of all solvers; z = 0 is feasible and stays the answer when every solver fails."""
    best = np.zeros(program.A.shape[1])
    if len(best) == 0:
        return best
    for solver in SOLVERS:
        for rho in PROXIMAL:
            best = descend(program, solver, best, rho)
    return best


def descend(program: LevelProgram, solver: QuadraticSolver, z: Array, rho: float) -> Array:
    """Proximal-point steps from z while they gain."""
    for _ in range(PROXIMAL_STEPS):
        try:
            step = polish(program, proximal_step(program, solver, z, rho), z)
        except ValueError:
            break
        gain = program.cost(z) - program.cost(step)
        if gain <= 0.0 or program.infeasibility(step) > FEASIBLE:
            break
        z = step
        if gain <= 1e-14 * program.cost(z):
            break
    return z


def proximal_step(program: LevelProgram, solver: QuadraticSolver, centre: Array, rho: float) -> Array:
    """Minimise the level's cost + rho/2 ||z - centre||^2 with `solver`; variables are (z - centre, s)."""
    r, k = program.A.shape[1], len(program.soft.lower)
    H = np.zeros((r + k, r + k))
    H[:r, :r] = program.A.T @ program.A + rho * np.eye(r)
    H[r:, r:] = np.eye(k)
    f = np.concatenate([program.A.T @ (program.A @ centre - program.b), np.zeros(k)])
    soft, hard = program.soft, program.hard
    A = np.vstack([np.hstack([soft.A, np.eye(k)]), np.hstack([hard.A, np.zeros((len(hard.A), k))])])
    at = np.concatenate([soft.A @ centre, hard.A @ centre])
    lower, upper = np.concatenate([soft.lower, hard.lower]) - at, np.concatenate([soft.upper, hard.upper]) - at
    step = solver(H, f, A, lower, upper)[:r]
    if not np.all(np.isfinite(step)):
        raise ValueError("the solver's answer is not finite")
    return centre + step


def polish(program: LevelProgram, z: Array, centre: Array) -> Array:
    """Solve the active set found at z by least squares; z itself when that leaves the hard rows or costs more."""
    value = program.hard.A @ z
    near = 1e-8 * (1.0 + np.abs(value))
    low, high = value - program.hard.lower < near, program.hard.upper - value < near
    bound = np.where(low, program.hard.lower, program.hard.upper)[low | high]
    held = program.hard.A[low | high]
    value = program.soft.A @ z
    under, over = value < program.soft.lower, value > program.soft.upper
    rows = np.vstack([program.A, program.soft.A[under | over]])
    target = np.concatenate([program.b, np.where(under, program.soft.lower, program.soft.upper)[under | over]])
    answer = z
    for start in (z, centre):
        snapped = start + np.linalg.lstsq(held, bound - held @ start, rcond=1e-11)[0] if len(held) else start
        basis = row_basis(held)
        space = np.eye(len(z)) - basis.T @ basis
        trial = snapped + space @ np.linalg.lstsq(rows @ space, target - rows @ snapped, rcond=1e-11)[0]
        feasible = program.infeasibility(trial) <= max(1e-12, program.infeasibility(answer))
        if feasible and program.cost(trial) <= program.cost(answer):
            answer = trial
    return answer


def solve_cascade(problem: Hierarchy) -> Array:
    """Lexicographic optimum (nv,) of a hierarchy, the tie-break last."""
    x = np.clip(np.zeros(problem.nv), problem.lo, problem.hi)
    fixed = np.zeros((0, problem.nv))
    hard = Rows(np.eye(problem.nv), problem.lo, problem.hi)
    still = problem.lo == problem.hi
    fixed, hard = hard.A[still], hard.subset(~still)
    for level in problem.all_levels:
        N = null_basis(fixed)
        program = level_program(level, x, N, hard)
        x = np.clip(x + N @ solve_level(program), problem.lo, problem.hi)
        fixed, hard = fix_level(level, x, fixed, hard)
    return x


def level_program(level: Level, x: Array, N: Array, hard: Rows) -> LevelProgram:
    """The program of one level around x in the space N; its rows are scaled together to norm 1."""
    A, D = level.C @ N, level.D @ N
    scale = max(float(np.linalg.norm(np.vstack([A, D]), 2)), 1e-12) if N.size else 1.0
    at = level.D @ x
    soft = Rows(D / scale, (level.lower - at) / scale, (level.upper - at) / scale)
    return LevelProgram(A / scale, (level.e - level.C @ x) / scale, soft, hard.along(N, x))


def fix_level(level: Level, x: Array, fixed: Array, hard: Rows) -> tuple[Array, Rows]:
    """Rows for the levels below: equality rows, violated rows and bounds that x leans on are fixed from here on."""
    violation = level.violation(x)
    broken = np.abs(violation) > FEASIBLE
    gradient = level.C.T @ (level.C @ x - level.e) + level.D.T @ violation
    value = hard.A @ x
    near = FEASIBLE * (1.0 + np.abs(value))
    low, high = value - hard.lower < near, hard.upper - value < near
    met = low | high
    sign = np.where(low, 1.0, -1.0)[met, None]
    multipliers = np.zeros(len(value))
    multipliers[met] = find_multipliers(gradient, fixed, sign * hard.A[met]).signed
    # A bound with a positive multiplier is met by every optimum of this level.
    leaning = multipliers > 1e-7 * (1.0 + float(np.linalg.norm(gradient)))
    both = low & high
    fixed = np.vstack([fixed, level.C, level.D[broken], hard.A[leaning | both]])
    rest = hard.subset(~(leaning | both))
    return fixed, rest.stacked(level.D[~broken], level.lower[~broken], level.upper[~broken])


def null_basis(rows: Array) -> Array:
    """Orthonormal basis (n, r) of the directions that change none of the rows."""
    basis = row_basis(rows)
    n = rows.shape[1]
    if len(basis) == 0:
        return np.eye(n)
    complete, _ = np.linalg.qr(basis.T, mode="complete")
    return np.asarray(complete[:, len(basis) :])
