"""Solids in arrays; from their definitions alone: support functions, depths of points, brute-force distances."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from oracles.problem import Array
from retarget import _solver

CAPSULE, CYLINDER, BOX, HALF_SPACE = range(4)
NAMES = ("capsule", "cylinder", "box", "half-space")


@dataclass(frozen=True)
class Solids:
    """N solids: kind (N,), MuJoCo's size (N, 3) in m, position (N, 3) in m, quaternion wxyz (N, 4)."""

    kind: NDArray[np.int64]
    size: Array
    pos: Array
    quat: Array

    def __getitem__(self, index: NDArray[Any] | slice) -> "Solids":
        return Solids(self.kind[index], self.size[index], self.pos[index], self.quat[index])

    @property
    def arguments(self) -> tuple[NDArray[np.int64], Array, Array, Array]:
        return self.kind, self.size, self.pos, self.quat

    @property
    def matrix(self) -> Array:
        """(N, 3, 3), from the frame of a solid to the world."""
        found: Array = Rotation.from_quat(self.quat, scalar_first=True).as_matrix()
        return found

    def moved(self, shift: Array) -> "Solids":
        return Solids(self.kind, self.size, np.ascontiguousarray(self.pos + shift), self.quat)


def one(
    kind: int, size: tuple[float, ...], pos: tuple[float, ...] = (0, 0, 0), turn: tuple[float, ...] = (0, 0, 0)
) -> Solids:
    """A single solid; `turn` is a rotation vector in degrees."""
    quat = Rotation.from_rotvec(turn, degrees=True).as_quat(scalar_first=True)
    rows = (np.array([values], dtype=float) for values in ((*size, 0.0, 0.0, 0.0)[:3], pos, quat))
    return Solids(np.array([kind]), *rows)


def nearest(a: Solids, b: Solids) -> tuple[Array, Array, Array, Array]:
    """What is tested: distance (N,), points of a and of b, and normal, each (N, 3)."""
    return _solver.shape_distances(*a.arguments, *b.arguments)


def together(parts: list[Solids]) -> Solids:
    return Solids(*(np.concatenate([getattr(p, name) for p in parts]) for name in ("kind", "size", "pos", "quat")))


def support(solids: Solids, n: Array) -> Array:
    """Largest n . x (N,) over the points x of each solid, for unit n (N, 3); of a half-space only along its own z."""
    local = np.einsum("nji,nj->ni", solids.matrix, n)
    r, h = solids.size[:, 0], solids.size[:, 1]
    along, across = np.abs(local[:, 2]), np.hypot(local[:, 0], local[:, 1])
    kinds = [r + h * along, r * across + h * along, np.sum(solids.size * np.abs(local), axis=1), np.zeros(len(n))]
    found: Array = np.einsum("ni,ni->n", solids.pos, n) + np.choose(solids.kind, kinds)
    return found


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


TURNS = np.array([[1, 0, 0, 0], [1, 1, 0, 0], [1, 0, 1, 0], [1, 0, 0, 1], [1, 1, 1, 1]]) * 1.0


def random_pairs(kinds: tuple[int, int], manner: str, n: int, rng: np.random.Generator) -> tuple[Solids, Solids]:
    """N pairs: `free`; `aligned` (quarter turns, often concentric); `tilted` (parallel but for 1e-14 to 1e-2 rad)."""
    a, b = (random_solids(kind, n, rng) for kind in kinds)
    shift = rng.normal(size=(n, 3)) * rng.choice([0.1, 0.3, 0.6], (n, 1))
    quat_a, quat_b = a.quat, b.quat
    if manner == "aligned":
        quat_a, quat_b = (TURNS[rng.integers(len(TURNS), size=n)] for _ in range(2))
        shift = shift * rng.choice([0.0, 1.0], (n, 3))
    if manner == "tilted":
        quat_a = quat_b + rng.normal(size=(n, 4)) * 10.0 ** rng.uniform(-14.0, -2.0, (n, 1))
    return Solids(a.kind, a.size, shift, quat_a), Solids(b.kind, b.size, b.pos, quat_b)


def corners(solids: Solids) -> Array:
    """World points (N, k, 3) that span the core of boxes (k = 8) or capsules (k = 2): one kind at a time."""
    if solids.kind[0] == BOX:
        signs = np.stack(np.meshgrid(*[[-1.0, 1.0]] * 3, indexing="ij"), axis=-1).reshape(8, 3)
        local = signs * solids.size[:, None, :]
    else:
        local = np.array([[0.0, 0.0, -1.0], [0.0, 0.0, 1.0]]) * solids.size[:, None, 1:2]
    found: Array = solids.pos[:, None, :] + np.einsum("nij,nkj->nki", solids.matrix, local)
    return found


def edges(points: Array) -> tuple[Array, Array]:
    """Ends (N, m, 3) of the edges between the corners of one kind: 12 of a box, 1 of a capsule."""
    if points.shape[1] == 2:
        return points[:, :1], points[:, 1:]
    start, end = zip(*[(i, i | bit) for i in range(8) for bit in (1, 2, 4) if not i & bit], strict=True)
    return points[:, start], points[:, end]


def segments_apart(p: Array, q: Array, r: Array, s: Array) -> Array:
    """Distance of segments pq and rs, all (..., 3): the smallest over their lines, and every end against the other."""

    def end_apart(x: Array, p: Array, q: Array) -> Array:
        along = q - p
        length2 = np.sum(along * along, axis=-1)
        share = np.sum((x - p) * along, axis=-1) / np.where(length2 > 0.0, length2, 1.0)
        found: Array = np.linalg.norm(x - p - np.clip(share, 0.0, 1.0)[..., None] * along, axis=-1)
        return found

    best = np.min([end_apart(p, r, s), end_apart(q, r, s), end_apart(r, p, q), end_apart(s, p, q)], axis=0)
    u, v, n = q - p, s - r, np.cross(q - p, s - r)
    n2 = np.sum(n * n, axis=-1)
    with np.errstate(divide="ignore", invalid="ignore"):
        t = np.sum(np.cross(r - p, v) * n, axis=-1) / n2
        w = np.sum(np.cross(r - p, u) * n, axis=-1) / n2
        inside = (n2 > 1e-24) & (t >= 0.0) & (t <= 1.0) & (w >= 0.0) & (w <= 1.0)
        lines = np.abs(np.sum((r - p) * n, axis=-1)) / np.sqrt(n2)
    found: Array = np.where(inside, lines, best)
    return found


def cores_apart(a: Solids, b: Solids) -> Array:
    """Distance (N,) of cores of capsules and boxes that are apart: all edges, and every corner against the other."""
    points_a, points_b = corners(a), corners(b)
    (p, q), (r, s) = edges(points_a), edges(points_b)
    best = segments_apart(p[:, :, None], q[:, :, None], r[:, None], s[:, None]).min(axis=(1, 2))
    for points, other in ((points_a, b), (points_b, a)):
        core = Solids(
            other.kind,
            np.where((other.kind == CAPSULE)[:, None], other.size * [0.0, 1.0, 0.0], other.size),
            other.pos,
            other.quat,
        )
        for k in range(points.shape[1]):
            best = np.minimum(best, np.maximum(depth(core, points[:, k]), 0.0))
    found: Array = best
    return found


def widest_gap(a: Solids, b: Solids, seeds: Array, rounds: int = 60) -> Array:
    """Largest gap (N,) along any direction, found by random search around seeds (N, k, 3)."""
    n, k, _ = seeds.shape
    repeated = [Solids(*(np.repeat(getattr(x, f), k, axis=0) for f in ("kind", "size", "pos", "quat"))) for x in (a, b)]

    def gap(direction: Array) -> Array:
        return -support(repeated[0], -direction) - support(repeated[1], direction)

    direction = seeds.reshape(-1, 3) / np.linalg.norm(seeds.reshape(-1, 3), axis=1, keepdims=True)
    best, step = gap(direction), np.full(n * k, 0.3)
    rng = np.random.default_rng(0)
    for _ in range(rounds):
        tried = direction + step[:, None] * rng.normal(size=direction.shape)
        tried /= np.linalg.norm(tried, axis=1, keepdims=True)
        value = gap(tried)
        better = value > best
        direction[better], best[better] = tried[better], value[better]
        step *= np.where(better, 1.5, 0.8)
    found: Array = best.reshape(n, k).max(axis=1)
    return found
