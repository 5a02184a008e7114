"""What one run with observers comes to: clearance on the body's own geoms, and what evading costs."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from benchmarks.bodies import Floats
from benchmarks.collision_placement import chosen_part, scene_distances
from benchmarks.collision_runs import Motion, gated_share
from retarget.model.scene_state import SceneState
from retarget.report.clearance import NEIGHBOURS, Clearance
from retarget.report.motion_metrics import observer_activity
from retarget.report.tracking import path_ratio

MM = 1e3
STEP = 4
"""Every so manyth tick it is looked at whether a hand is near an obstacle."""


@dataclass(frozen=True)
class Numbers:
    """One row. Clearances in mm (negative: inside) with the pair that came closest; `deep`: frames deeper than 1 mm.

    gated: share of ticks. hands_mm: mean error of both. unhindered_mm: by how much the error of a hand is larger than
    in the free run while its arm is there beyond the influence of every obstacle (the worse hand), and in what
    share of the ticks. jerk_p95: rad/s^3; jerk_ratio: against the run without observers. switches: per second, worst
    observer. left_out: links that were not compared and are no neighbours.
    """

    recording: str
    scene: str
    frames: int
    self_mm: float | None
    self_pair: tuple[str, str] | None
    self_deep: int
    scene_mm: float | None
    scene_pair: tuple[str, str] | None
    scene_deep: int
    gated: float | None
    hands_mm: float | None
    unhindered_mm: float | None
    unhindered_share: float | None
    path_ratio: float | None
    jerk_p95: float | None
    jerk_ratio: float | None
    switches: float | None
    busiest: str | None
    stop: str | None
    left_out: tuple[str, ...] = ()


def numbers(recording: str, scene: str, motion: Motion, *, free: Motion | None, without: Motion | None) -> Numbers:
    """A row; free: the same without obstacles; without: the same without obstacles and without observers."""
    itself = motion.body.to_itself(neutral=motion.neutral, ignored=motion.ignored)
    around = motion.run.scene
    fixtures = Clearance(None, 0, None) if around is None else motion.body.to_scene(around, motion.time)
    change, share = (None, None) if free is None or around is None else unhindered(motion, free, around)
    sent = motion.run.record.robot or motion.run.record.human
    modes = sent.observer_modes[motion.first : motion.end]
    activity = observer_activity(modes, motion.run.observer_names, motion.run.clip.dt)
    return Numbers(
        recording=recording,
        scene=scene,
        frames=len(motion.time),
        self_mm=_mm(itself.smallest),
        self_pair=itself.pair,
        self_deep=itself.deep,
        scene_mm=_mm(fixtures.smallest),
        scene_pair=fixtures.pair,
        scene_deep=fixtures.deep,
        gated=gated_share(motion),
        hands_mm=_mm(_mean(hand_errors(motion))),
        unhindered_mm=_mm(change),
        unhindered_share=share,
        path_ratio=path_ratio(motion.asked, motion.reached),
        jerk_p95=motion.jerk,
        jerk_ratio=None if without is None or not without.jerk or motion.jerk is None else motion.jerk / without.jerk,
        switches=None if activity is None else activity.switches.worst,
        busiest=None if activity is None else activity.switches.name,
        stop=motion.run.reason,
        left_out=tuple(f"{p.first}, {p.second}: {p.reason}" for p in itself.left_out if p.reason != NEIGHBOURS),
    )


def hand_errors(motion: Motion) -> Floats:
    """Distance (F, 2) m of each hand from where it was asked, while following; NaN where nothing was asked."""
    return np.asarray(np.linalg.norm(motion.reached - motion.asked, axis=-1))


def unhindered(motion: Motion, free: Motion, scene: SceneState) -> tuple[float | None, float]:
    """By how much, m, unhindered hands are worse than in the free run (the worse hand), and the share of such ticks."""
    ticks = np.arange(0, min(motion.end - motion.first, free.end - free.first), STEP)
    far = beyond_influence(free, ticks, scene)
    change = hand_errors(motion)[ticks] - hand_errors(free)[ticks]
    means = [_mean(change[far[:, side], side]) for side in range(2)]
    known = [mean for mean in means if mean is not None]
    return (max(known) if known else None), float(far.mean()) if far.size else 0.0


def beyond_influence(free: Motion, ticks: NDArray[np.int64], scene: SceneState) -> NDArray[np.bool_]:
    """Whether (F, 2) each arm of the free run is beyond the influence of every obstacle at ticks of following."""
    body, rows, far = free.body, free.first + ticks, []
    for links in whole_arms(free):
        arm = chosen_part(body, rows, np.flatnonzero(np.isin(body.geoms.links, links)))
        distance = scene_distances(arm, scene, free.time[rows])
        far.append((distance > scene.shapes.influence).all(axis=1))
    return np.column_stack(far)


def whole_arms(motion: Motion) -> list[list[int]]:
    """Numbers of the links from each forearm up to where both arms meet."""
    model = motion.body.model
    ways = []
    for links in motion.arms:
        link, way = model.body(links[0]).id, []
        while link:
            way.append(int(link))
            link = model.body_parentid[link]
        ways.append(way)
    return [[link for link in way if link not in other] for way, other in (ways, ways[::-1])]


def _mean(values: Floats) -> float | None:
    known = values[np.isfinite(values)]
    return float(known.mean()) if known.size else None


def _mm(value: float | None) -> float | None:
    return None if value is None else MM * value
