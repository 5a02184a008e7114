"""Crouch cycles are found by the head alone."""

from itertools import pairwise

import numpy as np

from benchmarks.paper.cycles import crouch_cycles
from sim.performer import CYCLES, synthetic_performer


def test_the_synthetic_performer_crouches_so_often() -> None:
    frames = synthetic_performer()
    head = frames.position[:, frames.index("head"), 2]
    cycles = crouch_cycles(head)
    assert len(cycles) == CYCLES
    assert cycles[0].start == 0 and cycles[-1].stop == len(frames)
    assert all(a.stop == b.start for a, b in pairwise(cycles))
    assert all(head[cycle].min() < 0.7 * head[0] for cycle in cycles)


def test_who_only_stands_has_no_cycle() -> None:
    assert crouch_cycles(np.full(100, 1.6)) == []
