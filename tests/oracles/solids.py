"""Solids of the distance kernel, in arrays: random pairs, support functions, depth of points. Written from the definitions alone."""

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from oracles.problem import Array

CAPSULE, CYLINDER, BOX, HALF_SPACE = range(4)
NAMES = ("capsule", "cylinder", "box", "half-space")


@dataclass(frozen=True)
class Solids:
    """N solids: kind (N,), MuJoCo's size (N, 3) in m, position (N, 3) in m, quaternion wxyz (N, 4)."""

    kind: Array
    size: Array
    pos: Array
    quat: Array

    def __getitem__(self, index: Array | slice) -> "Solids":
        return Solids(self.kind[index], self.size[index], self.pos[index], self.quat[index])

    @property
    def arguments(self) -> tuple[Array, Array, Array, Array]:
        return self.kind, self.size, self.pos, self.quat

    @property
    def matrix(self) -> Array:
        """(N, 3, 3), from the frame of a solid to the world."""
        return Rotation.from_quat(self.quat, scalar_first=True).as_matrix()

    def moved(self, shift: Array) -> "Solids":
        return Solids(self.kind, self.size, np.ascontiguousarray(self.pos + shift), self.quat)


def together(parts: list[Solids]) -> Solids:
    return Solids(*(np.concatenate([getattr(p, name) for p in parts]) for name in ("kind", "size", "pos", "quat")))


def support(solids: Solids, n: Array) -> Array:
    """Largest n . x (N,) over the points x of each solid, for unit n (N, 3); of a half-space only along its own z."""
    local = np.einsum("nji,nj->ni", solids.matrix, n)
    r, h = solids.size[:, 0], solids.size[:, 1]
    along, across = np.abs(local[:, 2]), np.hypot(local[:, 0], local[:, 1])
    kinds = [r + h * along, r * across + h * along, np.sum(solids.size * np.abs(local), axis=1), np.zeros(len(n))]
    return np.einsum("ni,ni->n", solids.pos, n) + np.choose(solids.kind, kinds)


def depth(solids: Solids, points: Array) -> Array:
    """Signed distance (N,) of points (N, 3) to the surface of each solid: negative within."""
    local = np.einsum("nji,nj->ni", solids.matrix, points - solids.pos)
    r, h = solids.size[:, 0], solids.size[:, 1]
    across = np.hypot(local[:, 0], local[:, 1])
    capsule = np.hypot(across, np.maximum(np.abs(local[:, 2]) - h, 0.0)) - r
    flat = [np.stack([across - r, np.abs(local[:, 2]) - h], axis=1), np.abs(local) - solids.size]
    cylinder, box = (np.linalg.norm(np.maximum(f, 0.0), axis=1) + np.minimum(f.max(axis=1), 0.0) for f in flat)
    return np.choose(solids.kind, [capsule, cylinder, box, local[:, 2]])


def random_solids(kind: int, n: int, rng: np.random.Generator) -> Solids:
    """Sizes from 0 (some exactly) to 0.4 m, turned at random, centred at the origin."""
    size = rng.uniform(0.01, 0.4, (n, 3)) * rng.choice([1.0, 1.0, 1.0, 0.0, 0.02], (n, 3))
    if kind in (CAPSULE, CYLINDER):
        size[:, 2] = 0.0
    if kind == HALF_SPACE:
        size[:] = 0.0
    quat = rng.normal(size=(n, 4))
    quat /= np.linalg.norm(quat, axis=1, keepdims=True)
    return Solids(np.full(n, kind), size, np.zeros((n, 3)), quat)
