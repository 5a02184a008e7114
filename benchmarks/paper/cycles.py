"""Crouch cycles of a performer, found by the height of the head."""

from itertools import pairwise

import numpy as np

from retarget.types import FloatArray

LOWERED = 0.15
"""A crouch: the head comes lower than its usual height by more than this share of the height."""


def crouch_cycles(head_height: FloatArray) -> list[slice]:
    """Frames of each cycle: from the highest head before a crouch to the highest after it. Heights (T,) m."""
    low = head_height < (1.0 - LOWERED) * np.percentile(head_height, 90)
    edges = np.flatnonzero(np.diff(np.concatenate([[False], low, [False]]).astype(int)))
    crouches = edges.reshape(-1, 2)
    if not len(crouches):
        return []
    tops = [0]
    for (_, out), (into, _) in pairwise(crouches.tolist()):
        tops.append(out + int(np.argmax(head_height[out : into + 1])))
    tops.append(len(head_height))
    return [slice(a, b) for a, b in pairwise(tops)]
