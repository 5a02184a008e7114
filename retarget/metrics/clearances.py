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
    compare. closest: two links; closest_obstacle: a link and an obstacle;
    closest_ground: a link and the ground.
    """

    geoms: Clearances
    observers: Clearances
    penetrating: int | None
    deep: int | None
    closest: tuple[str, str] | None
    closest_obstacle: tuple[str, str] | None
    closest_ground: tuple[str, str] | None


def clearances(run: RunResult) -> RunClearances:
    """Of the postures that were sent to a robot, or else of the reconstructed human."""
    body, q, placed, to_itself = _body(run)
    to_scene = to_ground = Clearance(None, 0, None)
    if run.scene is not None:
        times = np.maximum(run.record.time, 0.0)
        to_scene = placed.to_scene(run.scene, times)
        if run.robot is not None:
            soles = [run.robot.body.body_names[sole.body] for sole in run.robot.soles]
            to_ground = placed.to_ground(run.scene, times, soles=soles)
    parts = [part for part in (to_itself, to_scene, to_ground) if part.smallest is not None]
    seen: tuple[float | None, float | None, float | None] = (None, None, None)
    if run.observers is not None:
        seen = observer_clearance(body, run.observers, q, scene=run.scene, times=run.record.time)
    return RunClearances(
        geoms=Clearances(_mm(to_itself.smallest), _mm(to_scene.smallest), _mm(to_ground.smallest)),
        observers=Clearances(*(_mm(distance) for distance in seen)),
        penetrating=_sum([part.penetrating for part in parts]),
        deep=_sum([part.deep for part in parts]),
        closest=to_itself.pair,
        closest_obstacle=to_scene.pair,
        closest_ground=to_ground.pair,
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
