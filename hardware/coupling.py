"""Two joints that two servos turn together, as data: a differential such as the waist of a humanoid."""

import math
from dataclasses import dataclass

MAX_CONDITION = 1e3
"""Worst ratio of the largest to the smallest turn of the joints by one of the servos; beyond it they are stuck."""


@dataclass(frozen=True)
class Coupling:
    """joint angles of `joints` = `matrix` @ shaft angles of the servos of `joints`, rad, both in this order.

    A shaft angle is `direction * (tick - zero_tick) * model.tick_rad`: at the zero ticks of both servos both joints are
    at 0. Rows of the matrix are joints, columns servos. Both servos carry the same Coupling.
    """

    joints: tuple[str, str]
    matrix: tuple[tuple[float, float], tuple[float, float]]

    @property
    def determinant(self) -> float:
        """Of the matrix."""
        (a, b), (c, d) = self.matrix
        return a * d - b * c

    @property
    def inverse(self) -> tuple[tuple[float, float], tuple[float, float]]:
        """shaft angles = inverse @ joint angles. ZeroDivisionError for a singular matrix: see `problems`."""
        (a, b), (c, d) = self.matrix
        size = self.determinant
        return ((d / size, -b / size), (-c / size, a / size))

    @property
    def condition(self) -> float:
        """Ratio of the singular values of the matrix, at least 1; inf for a singular one."""
        squares = sum(value * value for row in self.matrix for value in row)
        size = abs(self.determinant)
        if not 0.0 < size < math.inf:
            return math.inf
        mean = squares / (2.0 * size)  # of the ratio and its inverse: (k + 1/k) / 2
        return mean + math.sqrt(max(mean * mean - 1.0, 0.0))

    def problems(self) -> tuple[str, ...]:
        """Return what is wrong with the coupling by itself, one text per finding; empty when sound."""
        found: list[str] = []
        here = f"coupling of {self.joints[0]} and {self.joints[1]}"
        if self.joints[0] == self.joints[1]:
            found.append(f"{here}: needs two different joints")
        if not all(math.isfinite(value) for row in self.matrix for value in row):
            found.append(f"{here}: the matrix has a number that is not finite")
        elif self.condition > MAX_CONDITION:
            found.append(
                f"{here}: the matrix {self.matrix} is singular or nearly so: the servos cannot set both joints"
            )
        return tuple(found)
