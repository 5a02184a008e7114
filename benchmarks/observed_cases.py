"""The observed cases: bodies and motions, our side in its variants, and the peers on the same self pairs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from benchmarks.bodies import Floats
from benchmarks.measure import TIMES, Outcome, outcome, play
from benchmarks.motion import Motion, crouch_and_reach
from benchmarks.observed_body import (
    NOTHING,
    StaticObstacles,
    Watched,
    scene_distances,
    self_distances,
    watched_human,
    watched_op3,
)
from benchmarks.observed_obstacles import size_of, sphere_at_hand
from benchmarks.ours import Activation, observed
from benchmarks.recording import SETTLE, followed, recording
from benchmarks.side import MakeSide, check_distances, peers
from retarget.human.calibration import calibrate
from retarget.sources.open import open_source

BASE = "retarget, all"
"""The side of ours that peers are compared with: a damper on every pair, no obstacle."""
CLEAR, INSIDE = 0.4, -0.6
"""How near the hand comes to the obstacle beside its way, and to the one in it, in radii of the obstacle."""


@dataclass(frozen=True, eq=False)
class Entry:
    """One side of a case."""

    make: MakeSide
    around: StaticObstacles = NOTHING
    looks: bool = True


@dataclass(frozen=True)
class Observed:
    """One row. pairs: that this side looks at; near: of them within influence, mean over frames. Clearances, mm, are
    the smallest in the postures of this side, by our own distances; None: farther than influence, or nothing there."""

    outcome: Outcome
    worn: str
    pairs: int
    near: float
    self_mm: float | None
    scene_mm: float | None


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


def entries(watched: Watched, motion: Motion) -> list[Entry]:
    """Ours without observers, with them, and with an obstacle at the right hand; then the peers that are installed."""
    ways: tuple[Activation, ...] = ("closest", "all") if watched.body.name == "human" else ("all",)
    free = Entry(observed("retarget, no observers", watched, None), looks=False)
    postures = play(watched.body, motion, [free.make])[2][0]
    found = [free, *(Entry(observed(f"retarget, {way}", watched, way)) for way in ways)]
    for place, share in (("beside", CLEAR), ("in", INSIDE)):
        sphere = sphere_at_hand(watched, postures, share * size_of(watched))
        for way in ways:
            name = f"retarget, {way}, sphere {place} the hand's way"
            found.append(Entry(observed(name, watched, way, sphere), sphere))
    return [*found, *(Entry(peer) for peer in peers(watched))]


def run_observed(watched: Watched, motion: Motion, sides: Sequence[Entry], *, repeats: int = 1) -> list[Observed]:
    """Every side frame by frame, turn by turn; times are medians over the repeats."""
    runs = [_once(watched, motion, sides) for _ in range(repeats)]
    rows = []
    for same in zip(*runs, strict=True):
        times = {field: float(np.median([getattr(row.outcome, field) for row in same])) for field in TIMES}
        rows.append(replace(same[0], outcome=replace(same[0].outcome, **times)))
    return rows


def _once(watched: Watched, motion: Motion, sides: Sequence[Entry]) -> list[Observed]:
    running, spent, postures = play(watched.body, motion, [side.make for side in sides])
    for side in running:
        if hasattr(side, "distances"):
            check_distances(side.name, side.distances(), watched, side.posture())
    return [
        _row(watched, side, outcome(watched.body, motion, running[s], spent[:, s], postures[s]), postures[s])
        for s, side in enumerate(sides)
    ]


def _row(watched: Watched, side: Entry, done: Outcome, postures: Floats) -> Observed:
    seen = watched.observers
    itself = self_distances(watched, postures)
    zone = np.maximum(seen.influence[seen.pairs[:, 0]], seen.influence[seen.pairs[:, 1]])
    near = (itself <= zone).sum(axis=1).mean()
    scene_mm = None
    if len(side.around.kinds):
        scene = scene_distances(watched, postures, side.around)
        inside = scene <= np.maximum(seen.influence, side.around.influence)[:, None]
        near += inside.sum(axis=(1, 2)).mean()
        scene_mm = 1e3 * float(scene.min()) if inside.any() else None
    return Observed(
        outcome=done,
        worn=watched.worn,
        pairs=(len(seen.pairs) + len(seen.names) * len(side.around.kinds)) if side.looks else 0,
        near=float(near),
        self_mm=1e3 * float(itself.min()) if (itself <= zone).any() else None,
        scene_mm=scene_mm,
    )
