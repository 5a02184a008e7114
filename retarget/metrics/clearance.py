"""How close a body came to itself, on the geoms of its own file: an independent look at what was sent."""

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from retarget.body_file import Root, compile_body
from retarget.rotations import FloatArray

__all__ = ["Clearance", "self_clearance"]

LOOKS = ((0.01, 1), (0.05, 1), (1.0, 20))
"""How far is looked, m, and in one posture of how many; further only when nothing came so near."""
TOUCH_M = 1e-6
"""Deeper than this, m, counts as penetration."""


@dataclass(frozen=True)
class Clearance:
    """smallest: distance, m, negative inside; None: no pair to compare. penetrating: number of postures.

    pair: the two links that came closest.
    """

    smallest: float | None
    penetrating: int
    pair: tuple[str, str] | None


def self_clearance(
    path: Path,
    postures: FloatArray,
    *,
    root: Root,
    neutral: FloatArray,
    ignored: Iterable[tuple[str, str]] = (),
) -> Clearance:
    """Look at every posture (T, nq) of the body file at `path`.

    Not compared: geoms of one link, of a link and its parent, of `ignored` pairs of links, of pairs that the file
    excludes, and of pairs that already touch in the posture `neutral` (nq,).
    """
    import mujoco

    model = compile_body(path, root=root).model
    data = mujoco.MjData(model)
    # Every geom of the body may meet every other, whatever the file says of contacts, and none the world's.
    model.geom_contype[:] = model.geom_conaffinity[:] = np.asarray(model.geom_bodyid) > 0
    # MuJoCo's own filter for parents lets the children of a base that is fixed to the world through.
    parents = {_pair(link, parent) for link, parent in enumerate(model.body_parentid)}
    skipped = parents | _skipped(model, ignored) | _touching(mujoco, model, data, neutral)
    look = _Look(mujoco, model, data, skipped)
    if not look.has_pairs():
        return Clearance(None, 0, None)
    for distance, every in LOOKS:
        found = look.at(postures[::every], distance)
        if found.smallest is not None:
            return found
    return Clearance(None, 0, None)


class _Look:
    """MuJoCo's collision detection over postures, without the pairs (sorted link numbers) that are skipped."""

    def __init__(self, mujoco: Any, model: Any, data: Any, skipped: set[tuple[int, int]]) -> None:
        self._mujoco = mujoco
        self._model = model
        self._data = data
        self._link = np.asarray(model.geom_bodyid)
        self._skip = np.zeros((model.nbody, model.nbody), dtype=np.bool_)
        for first, second in skipped:
            self._skip[first, second] = self._skip[second, first] = True

    def has_pairs(self) -> bool:
        """Whether any two geoms are ever compared."""
        links = np.unique(self._link[self._link > 0])
        return bool(np.triu(~self._skip[np.ix_(links, links)], 1).any())

    def at(self, postures: FloatArray, distance: float) -> Clearance:
        """The smallest distance up to `distance` m over postures (T, nq)."""
        self._model.geom_margin[:] = (
            distance / 2.0
        )  # MuJoCo adds the margins of both geoms (before 4.0 it took the larger)
        smallest, pair, penetrating = np.inf, None, 0
        for q in postures:
            self._data.qpos[:] = q
            self._mujoco.mj_kinematics(self._model, self._data)
            self._mujoco.mj_collision(self._model, self._data)
            if not self._data.ncon:
                continue
            contact = self._data.contact
            links = self._link[contact.geom]  # (contacts, 2)
            depth = np.where(self._skip[links[:, 0], links[:, 1]], np.inf, contact.dist)
            closest = int(np.argmin(depth))
            penetrating += bool(depth[closest] < -TOUCH_M)
            if depth[closest] < smallest:
                smallest, pair = float(depth[closest]), links[closest]
        if pair is None:
            return Clearance(None, 0, None)
        return Clearance(smallest, penetrating, (self._name(pair[0]), self._name(pair[1])))

    def _name(self, link: int) -> str:
        return str(self._model.body(int(link)).name)


def _skipped(model: Any, ignored: Iterable[tuple[str, str]]) -> set[tuple[int, int]]:
    """Sorted link numbers of pairs that are given by name."""
    return {_pair(model.body(first).id, model.body(second).id) for first, second in ignored}


def _touching(mujoco: Any, model: Any, data: Any, q: FloatArray) -> set[tuple[int, int]]:
    """Sorted link numbers of pairs that touch in a posture (nq,)."""
    model.geom_margin[:] = 0.0
    data.qpos[:] = q
    mujoco.mj_kinematics(model, data)
    mujoco.mj_collision(model, data)
    links = np.asarray(model.geom_bodyid)
    return {_pair(*links[geoms]) for geoms in data.contact.geom}


def _pair(first: int, second: int) -> tuple[int, int]:
    return (int(min(first, second)), int(max(first, second)))
