"""Which geoms of a body are compared with each other, and which pairs of links are not, and why."""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from retarget.rotations import FloatArray

__all__ = ["NEIGHBOURS", "LeftOut", "compared_pairs"]

IntArray = NDArray[np.int64]
Pair = tuple[int, int]
NEIGHBOURS = "neighbours along the body"
"""Why a link and its parent are not compared."""
FAR_M = 1e4
"""More than any distance, m."""


@dataclass(frozen=True)
class LeftOut:
    """Two links that are not compared, and why not."""

    first: str
    second: str
    reason: str


def compared_pairs(
    model: Any, links: IntArray, geoms: IntArray, *, neutral: FloatArray, ignored: Iterable[tuple[str, str]] = ()
) -> tuple[IntArray, tuple[LeftOut, ...]]:
    """Rows of `links` and `geoms` (g,) that are compared, (P, 2), and the pairs of links that are not.

    Not compared: geoms of one link, or of links that no joint parts; of a link and its parent; of pairs that the file
    excludes; of `ignored` pairs of links; of pairs of links that touch in the posture `neutral` (nq,).
    """
    reasons = _reasons(model, ignored)
    first, second = np.triu_indices(len(geoms), 1)
    welded = np.asarray(model.body_weldid)[links]
    apart = links[first] != links[second]
    # Links on a base that is fixed to the world are all welded to it, and yet may meet.
    apart &= (welded[first] != welded[second]) | (welded[first] == 0)
    pairs = np.column_stack([first, second])[apart]
    named = np.array([_pair(links[a], links[b]) not in reasons for a, b in pairs], dtype=np.bool_)
    pairs = pairs[named]
    touching = _touching(model, geoms[pairs], neutral)
    for a, b in links[pairs[touching]]:
        reasons[_pair(a, b)] = "touch in the neutral posture"
    kept = np.array([_pair(links[a], links[b]) not in reasons for a, b in pairs], dtype=np.bool_)
    worn = set(links.tolist())
    left_out = [
        LeftOut(str(model.body(a).name), str(model.body(b).name), reason)
        for (a, b), reason in sorted(reasons.items())
        if {a, b} <= worn
    ]
    return pairs[kept], tuple(left_out)


def _reasons(model: Any, ignored: Iterable[tuple[str, str]]) -> dict[Pair, str]:
    """Pairs of links that are left out in every posture."""
    weld, parent = np.asarray(model.body_weldid), np.asarray(model.body_parentid)
    reasons = {}
    for link in range(1, model.nbody):
        reasons[_pair(link, parent[link])] = NEIGHBOURS
        # Of links that no joint parts, all are neighbours of what the joint hangs on.
        for other in range(1, model.nbody):
            if weld[other] and weld[link] != weld[other] and weld[parent[weld[link]]] == weld[other]:
                reasons[_pair(link, other)] = NEIGHBOURS
    for signature in model.exclude_signature:
        reasons[_pair(int(signature) >> 16, int(signature) & 0xFFFF)] = "excluded by the body's file"
    for first, second in ignored:
        reasons[_pair(model.body(first).id, model.body(second).id)] = "ignored by the profile"
    return reasons


def _touching(model: Any, pairs: IntArray, q: FloatArray) -> NDArray[np.bool_]:
    """Which pairs (P, 2) of geoms touch in a posture (nq,)."""
    import mujoco

    data = mujoco.MjData(model)
    data.qpos[:] = q
    mujoco.mj_kinematics(model, data)
    distances = [mujoco.mj_geomDistance(model, data, int(a), int(b), FAR_M, None) for a, b in pairs]
    return np.array(distances) <= 0.0


def _pair(first: int, second: int) -> Pair:
    return (int(min(first, second)), int(max(first, second)))
