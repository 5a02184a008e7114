"""The observed cases: bodies and motions, our side in its variants, and the peers on the same self pairs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from benchmarks.measure import TIMES, Outcome, outcome, play
from benchmarks.motion import Motion, crouch_and_reach
from benchmarks.observed_body import Watched, watched_human, watched_op3
from benchmarks.ours import Activation, observed
from benchmarks.recording import SETTLE, followed, recording
from benchmarks.side import MakeSide, check_distances, peers
from retarget.human.calibration import calibrate
from retarget.sources.open import open_source

BASE = "retarget, all"
"""The side of ours that peers are compared with: a damper on every pair, no obstacle."""
FREE = "retarget, no observers"


@dataclass(frozen=True)
class Observed:
    """One row. pairs: that this side looks at."""

    outcome: Outcome
    worn: str
    pairs: int


def cases(frames: int, recorded: Path | None) -> list[tuple[Watched, Motion]]:
    """Human with lines and with capsules, and OP3; each crouches and reaches, and does what a recording asks."""
    found: list[tuple[Watched, Motion]] = []
    for watched in (watched_human("lines_and_head"), watched_human("capsules"), watched_op3()):
        found.append((watched, crouch_and_reach(watched.body, frames)))
    if recorded is not None:
        source = open_source(recorded)
        size = calibrate(source)
        performer = watched_human("lines_and_head", size)
        motion = recording(performer.body, source)
        found += [(performer, motion), (watched_human("capsules", size), motion)]
        body, motion = followed(watched_op3().body, source)
        found.append((watched_op3(body), motion))
    return [(watched, settled(watched, motion)) for watched, motion in found]


def settled(watched: Watched, motion: Motion) -> Motion:
    """The same from a posture in which the body does not touch itself: PlaCo finds no solution from one in which it
    does."""
    side = observed(BASE, watched, "all")(watched.body, motion)
    side.aim(motion.com[0], motion.points[0])
    for _ in range(SETTLE):
        side.solve()
    return replace(motion, start=side.posture())


def entries(watched: Watched) -> list[MakeSide]:
    """Ours without observers and with them, and the peers that are installed."""
    ways: tuple[Activation, ...] = ("closest", "all") if watched.body.name == "human" else ("all",)
    found: list[MakeSide] = [observed(FREE, watched, None)]
    return [*found, *(observed(f"retarget, {way}", watched, way) for way in ways), *peers(watched)]


def run_observed(watched: Watched, motion: Motion, sides: Sequence[MakeSide], *, repeats: int = 1) -> list[Observed]:
    """Every side frame by frame, turn by turn; times are medians over the repeats."""
    runs = [_once(watched, motion, sides) for _ in range(repeats)]
    rows = []
    for same in zip(*runs, strict=True):
        times = {field: float(np.median([getattr(one, field) for one in same])) for field in TIMES}
        pairs = 0 if same[0].side == FREE else len(watched.observers.pairs)
        rows.append(Observed(replace(same[0], **times), watched.worn, pairs))
    return rows


def _once(watched: Watched, motion: Motion, sides: Sequence[MakeSide]) -> list[Outcome]:
    running, spent, postures = play(watched.body, motion, sides)
    for side in running:
        if hasattr(side, "distances"):
            check_distances(side.name, side.distances(), watched, side.posture())
    return [outcome(watched.body, motion, side, spent[:, s], postures[s]) for s, side in enumerate(running)]
