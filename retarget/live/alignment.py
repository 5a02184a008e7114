"""Where the stream's world lies in ours: the floor at z = 0, the performer at the origin, facing x when calibrated."""

from dataclasses import dataclass, field, replace

import numpy as np

from retarget import rotations
from retarget.anthropometry import FRACTIONS
from retarget.errors import InputError
from retarget.rotations import FloatArray

__all__ = ["Alignment", "align", "facing_of"]

PAIRS = ("ankle", "wrist", "hip", "shoulder", "knee", "elbow")
"""Left and right of these tell where forward is, as the vector from right to left."""
NARROWEST_M = 0.05
"""Left and right nearer than this tell no direction."""


@dataclass(frozen=True, eq=False)
class Alignment:
    """World = turn by `yaw` (rad, about z) of what is told, from `origin` (3,) m, which becomes (0, 0, 0)."""

    yaw: float = 0.0
    origin: FloatArray = field(default_factory=lambda: np.zeros(3))

    def __post_init__(self) -> None:
        cosine, sine = np.cos(self.yaw), np.sin(self.yaw)
        object.__setattr__(self, "_matrix", np.array([[cosine, sine, 0.0], [-sine, cosine, 0.0], [0.0, 0.0, 1.0]]))
        half = 0.5 * self.yaw
        turn = np.array([np.cos(half), 0.0, 0.0, np.sin(half)])
        object.__setattr__(self, "_product", rotations.multiply(turn, np.eye(4)))

    _matrix: FloatArray = field(init=False, repr=False)  # row vectors are multiplied by it, and by the product
    _product: FloatArray = field(init=False, repr=False)

    def positions(self, told: FloatArray) -> FloatArray:
        """Positions (..., 3) m of the stream's world -> ours."""
        return np.asarray((told - self.origin) @ self._matrix)

    def orientations(self, told: FloatArray) -> FloatArray:
        """Orientations (..., 4) wxyz of the stream's world -> ours."""
        return np.asarray(told @ self._product)

    def turned(self, yaw: float, about: FloatArray) -> "Alignment":
        """As this, and then turned by `yaw` rad about the vertical through a point (3,) m of our world."""
        about = np.array([about[0], about[1], 0.0])
        # The point that comes to lie at the origin: p with turn(yaw) @ (R (p - o) - about) + about = 0.
        cosine, sine = np.cos(yaw), np.sin(yaw)
        back = np.array([[cosine, sine, 0.0], [-sine, cosine, 0.0], [0.0, 0.0, 1.0]])
        return replace(self, yaw=self.yaw + yaw, origin=self.origin + self._matrix @ (about - back @ about))


def align(names: tuple[str, ...], position: FloatArray, *, where: str = "") -> Alignment:
    """The alignment in which somebody who stands upright right now faces x, on the floor, above the origin.

    names: k canonical sensors; position (k, 3) m, of the stream's world, z up, NaN where unknown. Without ankles the
    stream's own floor is believed. Raises InputError where left and right tell no direction.
    """
    at = {name: point for name, point in zip(names, position, strict=True) if np.isfinite(point).all()}
    forward = facing_of(at)
    if forward is None:
        raise InputError(
            "left and right tell no direction",
            where=where,
            found=", ".join(at) or "no sensor",
            allowed="both ankles or both wrists, apart",
            next_step="Stand upright, feet a little apart, arms beside the body or straight out. If you do, see which "
            "axis is upward in what is sent (of Motive: ?up=z)",
        )
    ankles = [at[name] for name in ("l_ankle", "r_ankle") if name in at]
    middle = np.mean(ankles or list(at.values()), axis=0)
    floor = 0.0
    if len(ankles) == 2 and "head" in at:
        above = at["head"][2] - middle[2]
        floor = middle[2] - FRACTIONS.ankle_height / (FRACTIONS.head_height - FRACTIONS.ankle_height) * above
    return Alignment(yaw=-float(np.arctan2(forward[1], forward[0])), origin=np.array([middle[0], middle[1], floor]))


def facing_of(at: dict[str, FloatArray]) -> FloatArray | None:
    """Where an upright person faces on the floor, (2,), of length 1, from sensors (3,) by name; None: nothing tells."""
    left = np.zeros(2)
    for part in PAIRS:
        if f"l_{part}" in at and f"r_{part}" in at:
            left += (at[f"l_{part}"] - at[f"r_{part}"])[:2]
    length = float(np.hypot(*left))
    return None if length < NARROWEST_M else np.array([left[1], -left[0]]) / length
