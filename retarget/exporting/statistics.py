"""Statistics of one feature over the frames of a dataset, by which trainers normalise."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from retarget.rotations import FloatArray

__all__ = ["Statistics", "statistics_of"]

QUANTILES = (1, 10, 50, 90, 99)


@dataclass(frozen=True, eq=False)
class Statistics:
    """Of d values over T frames. least, most, mean, deviation (d,); quantiles (5, d): of `QUANTILES` percent."""

    least: FloatArray
    most: FloatArray
    mean: FloatArray
    deviation: FloatArray
    quantiles: FloatArray
    count: int

    def entries(self) -> dict[str, list[float] | list[int]]:
        """By the names that LeRobot gives them; the deviation is that of a population."""
        named = {"min": self.least, "max": self.most, "mean": self.mean, "std": self.deviation}
        named |= {f"q{percent:02d}": row for percent, row in zip(QUANTILES, self.quantiles, strict=True)}
        return {**{name: values.tolist() for name, values in named.items()}, "count": [self.count]}


def statistics_of(values: NDArray[np.generic]) -> Statistics:
    """Statistics of values (T, d)."""
    numbers = np.asarray(values, dtype=np.float64)
    return Statistics(
        least=numbers.min(axis=0),
        most=numbers.max(axis=0),
        mean=numbers.mean(axis=0),
        deviation=numbers.std(axis=0),
        quantiles=np.percentile(numbers, QUANTILES, axis=0),
        count=len(numbers),
    )
