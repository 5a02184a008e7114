"""All experiments and figures, one after the other: pictures and numbers in a folder."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.paper.body_pictures import figure_3, figure_7, figure_9, figure_10
from benchmarks.paper.chain_runs import ONE, TWO, reaching_chain, yielding_chain
from benchmarks.paper.crouching import Outcome, crouching
from benchmarks.paper.damping_law import damped_points
from benchmarks.paper.plane_pictures import figure_4, figure_5, figure_6
from benchmarks.paper.replay import replay
from benchmarks.paper.table import as_data
from retarget.errors import UsageError
from retarget.frames import SensorFrames
from retarget.model.human_dimensions import POINTS
from retarget.pictures.plots import save_figure
from retarget.schema.priorities import load_priorities
from retarget.sources.open import open_source

NAMES = ("crouching", "jog", "jump", "figure4", "figure5", "figure6")
"""What `--only` takes: experiments 1 to 3 together, and one by one the figures of the paper's other sections."""

Progress = Callable[[int], None]


@dataclass(frozen=True, eq=False)
class Motions:
    """What the experiments are made with; what there is no recording of is left out."""

    crouch: SensorFrames
    jog: SensorFrames | None
    jump: SensorFrames | None


@dataclass
class Results:
    """What came of them. outcomes: of experiments 1 to 3; data: for JSON; pictures: where they are."""

    outcomes: list[Outcome] = field(default_factory=list)
    data: dict[str, Any] = field(default_factory=dict)
    pictures: list[Path] = field(default_factory=list)


def run_experiments(
    motions: Motions,
    folder: Path,
    *,
    only: Sequence[str] = NAMES,
    iterations: int | None = None,
    progress: Progress = lambda done: None,
) -> Results:
    """Run what `only` names, and write a picture for each figure. Raises InputError, OSError."""
    results = Results()
    for name in only:
        if name == "crouching":
            _crouching(motions.crouch, folder, results, iterations=iterations, progress=progress)
        elif name in ("jog", "jump"):
            frames = motions.jog if name == "jog" else motions.jump
            if frames is not None:
                _moving(name, frames, folder, results, iterations=iterations)
        else:
            _in_a_plane(name, folder, results)
    return results


def _crouching(
    frames: SensorFrames,
    folder: Path,
    results: Results,
    *,
    iterations: int | None,
    progress: Progress,
) -> None:
    results.outcomes = list(crouching(frames, iterations=iterations, progress=progress))
    results.data["crouching"] = {"source": frames.source, "runs": [as_data(outcome) for outcome in results.outcomes]}
    free = results.outcomes[0].free.joints
    drawn = {outcome.experiment.number: outcome for outcome in results.outcomes if outcome.priorities == "paper"}
    for name, figure in (
        ("experiment_1", figure_7(frames, drawn[1])),
        ("experiment_2", figure_9(frames, drawn[2], free)),
        ("experiment_3", figure_10(frames, drawn[3], free)),
    ):
        _save(results, figure, folder / f"{name}.png")


def _moving(name: str, frames: SensorFrames, folder: Path, results: Results, *, iterations: int | None) -> None:
    """Jog or jump without obstacles, as in Figure 3."""
    done = replay(frames, load_priorities("paper"), iterations=iterations)
    head = done.joints[:, POINTS.index("head"), 2]
    middle = int(np.argmax(head)) if name == "jump" else len(head) // 2
    half = min(round(0.7 / done.dt), len(head) // 2)
    first = min(max(middle - half, 0), len(head) - 2 * half)
    shown = np.linspace(first, first + 2 * half - 1, 8).round().astype(int).tolist()
    errors = done.errors_mm
    results.data[name] = {
        "source": frames.source,
        "frames": len(done.q),
        "frames_per_s": done.frames_per_s,
        "tracking_mm": {
            sensor: {"mean": float(np.nanmean(errors[:, k])), "max": float(np.nanmax(errors[:, k]))}
            for k, sensor in enumerate(done.sensors)
        },
    }
    title = {"jog": "A jog", "jump": "A vertical jump"}[name]
    _save(results, figure_3(title, frames, done, shown), folder / f"{name}.png")


def _in_a_plane(name: str, folder: Path, results: Results) -> None:
    if name == "figure4":
        points = damped_points()
        figure = figure_4(points)
        results.data[name] = {
            point.name: {"share": point.share, "asked": point.asked.tolist(), "got": point.got.tolist()}
            for point in points
        }
    elif name == "figure5":
        run = yielding_chain()
        figure = figure_5(run)
        results.data[name] = {"min_clearance_mm": 1e3 * float(run.clearance.min())}
    else:
        one, two = reaching_chain(ONE), reaching_chain(TWO)
        figure = figure_6(one, two)
        results.data[name] = {
            label: {
                "min_clearance_mm": 1e3 * float(chain.clearance.min()),
                "most_links_within_influence": int(chain.within.any(axis=2).sum(axis=1).max()),
                "most_links_acting": int((chain.modes == 1).sum(axis=1).max()),
            }
            for label, chain in (("one_obstacle", one), ("two_obstacles", two))
        }
    _save(results, figure, folder / f"{name}.png")


def _save(results: Results, figure: Any, path: Path) -> None:
    save_figure(figure, path)
    results.pictures.append(path)


# Which recordings the experiments use: trials of CMU subject 2, found by name anywhere below a folder.

CROUCH, JOG, JUMP = "02_06", "02_03", "02_04"
"""Reach and crouch cycles (2,235 frames), a jog, a vertical jump."""
SUFFIXES = (".amc", ".bvh", ".c3d")
"""In order of preference: AMC has the recorded skeleton."""


def find_trial(folder: Path, trial: str) -> Path | None:
    """The file of a trial below a folder; None: there is none. Raises UsageError: no folder."""
    if not folder.is_dir():
        raise UsageError(
            "no folder of recordings",
            where="--mocap",
            found=str(folder),
            next_step="Leave --mocap out for the synthetic performer",
        )
    for suffix in SUFFIXES:
        found = sorted(folder.rglob(trial + suffix))
        if found:
            return found[0]
    return None


def read_trial(folder: Path | None, trial: str) -> SensorFrames | None:
    """The frames of a trial; None: no folder was given, or a trial other than CROUCH is not in it. Raises UsageError,
    InputError."""
    path = None if folder is None else find_trial(folder, trial)
    if folder is not None and path is None and trial == CROUCH:
        raise UsageError(
            "the trial of the experiments is not there",
            where="--mocap",
            found=f"no {' or '.join(trial + suffix for suffix in SUFFIXES)} below {folder}",
            next_step="Give the folder of CMU subject 2, or leave --mocap out for the synthetic performer",
        )
    return None if path is None else open_source(path)
