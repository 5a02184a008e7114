"""Settings of the One-Euro filter (Casiez, Roussel and Vogel, CHI 2012)."""

from dataclasses import dataclass
from math import isfinite

__all__ = ["OneEuroSettings"]


@dataclass(frozen=True, slots=True)
class OneEuroSettings:
    """min_cutoff: Hz, at rest. beta: Hz by which the cutoff rises per unit of speed (1/m for positions, 1/rad for
    turns). d_cutoff: Hz, of the speed's own filter. Positive and finite; beta may be 0. Raises ValueError otherwise."""

    min_cutoff: float = 0.8
    beta: float = 2.0
    d_cutoff: float = 1.0

    def __post_init__(self) -> None:
        for name, least in (("min_cutoff", 1e-3), ("beta", 0.0), ("d_cutoff", 1e-3)):
            value = getattr(self, name)
            if not (isfinite(value) and value >= least):
                raise ValueError(f"{name} of a One-Euro filter is a number from {least} on; found {value}")

    @property
    def cutoffs(self) -> tuple[float, float, float]:
        """As the compiled filter takes them."""
        return self.min_cutoff, self.beta, self.d_cutoff
