"""What the experiments came to: the table of the documentation, and more numbers as JSON."""

import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from benchmarks.paper.crouching import Collisions, Outcome
from benchmarks.table import show_table


def as_data(outcome: Outcome) -> dict[str, Any]:
    """Numbers of one experiment with one configuration; what does not exist is None."""
    replay = outcome.replay
    cpu_us = 1e6 * replay.cpu_s[1:]
    errors = replay.errors_mm
    scene = outcome.experiment.scene
    return {
        "experiment": outcome.experiment.number,
        "priorities": outcome.priorities,
        "observers": {"worn": outcome.worn, "count": len(replay.switches)},
        "scene": None
        if scene is None
        else scene.model_dump(mode="json", by_alias=True, exclude_none=True)["obstacles"],
        "frames": len(replay.q),
        "frames_per_s": replay.frames_per_s,
        "paper_frames_per_s": outcome.experiment.paper_fps,
        "cpu_us": {"p50": float(np.median(cpu_us)), "p99": float(np.percentile(cpu_us, 99))},
        "tracking_mm": {
            name: {"mean": float(np.nanmean(errors[:, k])), "max": float(np.nanmax(errors[:, k]))}
            for k, name in enumerate(replay.sensors)
        },
        "cycles_hindered_without_observers": outcome.cycles,
        "on_observers": _collisions(outcome.on_observers),
        "on_observers_without": _collisions(outcome.free_on_observers),
        "on_capsules": _collisions(outcome.on_capsules),
        "on_capsules_without": _collisions(outcome.free_on_capsules),
        "preventive_frames": int((replay.modes == 1).any(axis=1).sum()),
        "reactive_frames": int((replay.modes == 2).any(axis=1).sum()),
        "mode_switches_per_s": {
            "mean": float(replay.switches.mean() / replay.duration_s),
            "worst": float(replay.switches.max() / replay.duration_s),
        },
    }


def show_outcomes(outcomes: Sequence[Outcome], *, docs: bool) -> None:
    """Print a column for each outcome, mm where no unit is said; negative: inside, with the frames that are."""
    data = [as_data(outcome) for outcome in outcomes]
    heads = ["", *(f"{column['experiment']} {column['priorities']}" for column in data)]
    rows = [[label, *(pick(column) for column in data)] for label, pick in _ROWS]
    show_table("paper", heads, rows, docs=docs)


def _collisions(collisions: Collisions) -> dict[str, Any]:
    return {
        "min_clearance_mm": {
            "self": _mm(collisions.own_clearance),
            "scene": _mm(collisions.scene_clearance),
        },
        "penetrating_frames": {"self": collisions.own_frames, "scene": collisions.scene_frames},
    }


def _mm(distance: float) -> float | None:
    return 1e3 * distance if math.isfinite(distance) else None


def _number(value: float | None, digits: int = 1) -> str:
    return "-" if value is None else f"{value:.{digits}f}"


def _pair(row: dict[str, Any], on: str, what: str) -> str:
    """Least clearance, and the frames that penetrate where there are any."""
    clearance, frames = row[on]["min_clearance_mm"][what], row[on]["penetrating_frames"][what]
    return _number(clearance) + (f" ({frames})" if frames else "")


def _tracking(row: dict[str, Any], *names: str) -> str:
    errors = [row["tracking_mm"][name] for name in names if name in row["tracking_mm"]]
    if not errors:
        return "-"
    return f"{np.mean([e['mean'] for e in errors]):.2f} / {max(e['max'] for e in errors):.0f}"


_ROWS: tuple[tuple[str, Callable[[dict[str, Any]], str]], ...] = (
    ("frames per second", lambda row: _number(row["frames_per_s"], 0)),
    ("Table 2 of the paper (1.8 GHz Sempron)", lambda row: _number(row["paper_frames_per_s"])),
    ("ankles off their sensors, mean / max", lambda row: _tracking(row, "l_ankle", "r_ankle")),
    ("head", lambda row: _tracking(row, "head")),
    ("right wrist", lambda row: _tracking(row, "r_wrist")),
    ("scene, nearest, on the observers worn", lambda row: _pair(row, "on_observers", "scene")),
    ("the same without observers", lambda row: _pair(row, "on_observers_without", "scene")),
    ("self, nearest, on capsules", lambda row: _pair(row, "on_capsules", "self")),
)
