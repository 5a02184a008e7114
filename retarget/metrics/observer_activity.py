"""How calm and how busy collision observers were, from their modes at every tick."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from retarget.rotations import FloatArray

__all__ = ["FREE", "PREVENTIVE", "REACTIVE", "ModeSwitches", "ObserverActivity", "nearest", "observer_activity"]

FREE, PREVENTIVE, REACTIVE = 0, 1, 2
"""Modes: nothing near; the approach of the part is damped; the part is pushed out."""


@dataclass(frozen=True)
class ModeSwitches:
    """Changes of mode per second: mean over the observers, and of the worst one, by name; None: none changed."""

    mean: float
    worst: float
    name: str | None


@dataclass(frozen=True)
class ObserverActivity:
    """switches: from any mode to any other. activations: how often an observer became active, all together.

    active, reactive: share of the ticks in which any observer was.
    """

    switches: ModeSwitches
    activations: int
    active: float
    reactive: float


def observer_activity(modes: NDArray[np.uint8], names: tuple[str, ...], dt: float) -> ObserverActivity | None:
    """From the modes (T, n) of observers, `dt` s apart; None without ticks or observers."""
    ticks, count = modes.shape
    if count != len(names):
        raise ValueError(f"{len(names)} names for {count} observers")
    if not ticks or not count:
        return None
    changed = modes[1:] != modes[:-1]
    per_second = changed.sum(axis=0) / (max(ticks - 1, 1) * dt)  # (n,) [1/s]
    worst = int(np.argmax(per_second))
    name = names[worst] if per_second[worst] > 0.0 else None
    begun = np.vstack([modes[:1] != FREE, (modes[1:] != FREE) & (modes[:-1] == FREE)])
    return ObserverActivity(
        switches=ModeSwitches(float(per_second.mean()), float(per_second[worst]), name),
        activations=int(np.count_nonzero(begun)),
        active=float((modes != FREE).any(axis=1).mean()),
        reactive=float((modes == REACTIVE).any(axis=1).mean()),
    )


def nearest(distances: FloatArray) -> float | None:
    """The smallest of recorded observer distances, m, of any shape; NaN and inf: not known. None: none is known."""
    known = distances[np.isfinite(distances)]
    return float(known.min()) if known.size else None
