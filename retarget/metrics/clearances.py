"""How near the last stage's body came to itself and to its scene in a run: on its own geoms, and on its observers."""

from dataclasses import dataclass

import numpy as np

from retarget.body import BodyModel
from retarget.metrics.clearance import Clearance, PlacedBody, place_body
from retarget.metrics.observer_clearance import observer_clearance
from retarget.report import Clearances
from retarget.rotations import FloatArray
from retarget.run_result import RunResult

__all__ = ["RunClearances", "clearances"]

NEUTRAL = "attractor"
"""The human's posture in which pairs that touch are left out."""
MM = 1e3


@dataclass(frozen=True)
class RunClearances:
    """geoms, observers: smallest distances. penetrating, deep: ticks, one that does both counts twice; None: nothing to
    compare. closest: two links;
    closest_obstacle: a link and an obstacle."""

    geoms: Clearances
    observers: Clearances
    penetrating: int | None
    deep: int | None
    closest: tuple[str, str] | None
    closest_obstacle: tuple[str, str] | None


def clearances(run: RunResult) -> RunClearances:
    """Of the postures that were sent to a robot, or else of the reconstructed human."""
    body, q, placed, to_itself = _body(run)
    to_scene = None if run.scene is None else placed.to_scene(run.scene, np.maximum(run.record.time, 0.0))
    parts = [part for part in (to_itself, to_scene) if part is not None and part.smallest is not None]
    seen: tuple[float | None, float | None] = (None, None)
    if run.observers is not None:
        seen = observer_clearance(body, run.observers, q, scene=run.scene, times=run.record.time)
    return RunClearances(
        geoms=Clearances(_mm(to_itself.smallest), None if to_scene is None else _mm(to_scene.smallest)),
        observers=Clearances(_mm(seen[0]), _mm(seen[1])),
        penetrating=_sum([part.penetrating for part in parts]),
        deep=_sum([part.deep for part in parts]),
        closest=to_itself.pair,
        closest_obstacle=None if to_scene is None else to_scene.pair,
    )


def _body(run: RunResult) -> tuple[BodyModel, FloatArray, PlacedBody, Clearance]:
    """The body, its postures (T, nq), and itself in them."""
    robot, sent = run.robot, run.record.robot
    if robot is not None and sent is not None:
        profile = robot.profile
        placed = place_body(profile.body_path, sent.q, root=profile.root)
        ignored = [entry.pair for entry in profile.ignore_pairs]
        return (
            robot.body,
            sent.q,
            placed,
            placed.to_itself(neutral=robot.posture(profile.postures.neutral), ignored=ignored),
        )
    q = run.record.human.q
    placed = place_body(run.human.mjcf, q)
    return run.human.body, q, placed, placed.to_itself(neutral=run.human.posture(NEUTRAL))


def _sum(counts: list[int]) -> int | None:
    return sum(counts) if counts else None


def _mm(metres: float | None) -> float | None:
    return None if metres is None else MM * metres
