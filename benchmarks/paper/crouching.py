"""Experiments 1 to 3 of the paper: reach and crouch cycles, free, past a cylinder, and up under a sphere.

Each runs with Table 1 and lines (`paper`), and with our own levels and capsules on every segment (`human_clear`). What
they came to is measured on the postures, outside of the solver: on the observers that were worn, and on the capsules.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from benchmarks.paper.observed_distances import ObservedDistances, observed_distances
from benchmarks.paper.placement import FOREARM, HEAD, clear_cylinder, cycles_on_hold, hindering_sphere
from benchmarks.paper.replay import Replay, replay
from retarget.frames import SensorFrames
from retarget.model.observers import Observers, ObserverSet, human_observers
from retarget.schema.priorities import load_priorities
from retarget.schema.scene import Scene
from retarget.types import FloatArray

CONFIGURATIONS = ("paper", "human_clear")
"""Priority files; the first is the paper's."""
PENETRATION = 1e-3
"""Deeper than this, m, is penetration."""
PAPER_FPS = (52.6, 42.5, 40.6)
"""Table 2: frames per second of experiments 1 to 3 on a 1.8 GHz Sempron of 2006."""


@dataclass(frozen=True)
class Experiment:
    """Number in the paper, what stands around, which of the body is hindered by it, and what `paper` wears."""

    number: int
    scene: Scene | None
    evidence: str | None
    worn: ObserverSet

    @property
    def paper_fps(self) -> float:
        """Frames per second that the paper reports."""
        return PAPER_FPS[self.number - 1]


@dataclass(frozen=True, eq=False)
class Collisions:
    """Of a motion beside itself and a scene. clearance: least distance, m; frames: deeper than PENETRATION."""

    own_clearance: float
    own_frames: int
    scene_clearance: float
    scene_frames: int

    @classmethod
    def of(cls, distances: ObservedDistances) -> "Collisions":
        """Of all frames."""
        own, scene = distances.least_own, distances.least_scene
        return cls(
            own_clearance=float(own.min()),
            own_frames=int(np.count_nonzero(own < -PENETRATION)),
            scene_clearance=float(scene.min()),
            scene_frames=int(np.count_nonzero(scene < -PENETRATION)),
        )


@dataclass(frozen=True, eq=False)
class Outcome:
    """One experiment with one configuration.

    replay, free: with observers and without. on_observers, on_capsules: of `replay`, judged on what was worn and on
    capsules round every segment; free_on_observers, free_on_capsules: the same of `free`. cycles: crouch cycles in
    which the hand or the head is HINDERED deep in `free`. distances (T,) m: of the hindered part to the scene, of the
    whole body to itself where nothing is hindered; free_distances: the same of `free`.
    """

    experiment: Experiment
    priorities: str
    worn: ObserverSet
    replay: Replay
    free: Replay
    on_observers: Collisions
    on_capsules: Collisions
    free_on_observers: Collisions
    free_on_capsules: Collisions
    cycles: int
    distances: FloatArray
    free_distances: FloatArray


def crouching(
    frames: SensorFrames,
    *,
    configurations: Sequence[str] = CONFIGURATIONS,
    iterations: int | None = None,
    progress: Callable[[int], None] = lambda done: None,
) -> Iterator[Outcome]:
    """The outcomes, experiment by experiment, with the paper's configuration and those that follow it.

    Raises InputError: no place for an obstacle.
    """
    free = {
        name: replay(frames, load_priorities(name), iterations=iterations, progress=progress) for name in configurations
    }
    motion = free[configurations[0]]
    experiments = (
        Experiment(1, None, None, "lines"),
        Experiment(2, clear_cylinder(motion), FOREARM, "lines"),
        Experiment(3, hindering_sphere(motion), HEAD, "lines_and_head"),
    )
    for experiment in experiments:
        for name in configurations:
            worn: ObserverSet = experiment.worn if name == CONFIGURATIONS[0] else "capsules"
            replayed = replay(
                frames,
                load_priorities(name),
                observed=worn,
                scene=experiment.scene,
                iterations=iterations,
                progress=progress,
            )
            yield _outcome(experiment, name, worn, replayed, free[name])


def _outcome(experiment: Experiment, priorities: str, worn: ObserverSet, replayed: Replay, free: Replay) -> Outcome:
    assert replayed.observers is not None
    settings = load_priorities(priorities).observers.model_copy(update={"human": "capsules"})
    capsules = human_observers(replayed.human, settings)
    assert capsules is not None

    def looked(motion: Replay, observers: Observers) -> ObservedDistances:
        return observed_distances(motion.human.body, observers, motion.q, experiment.scene)

    seen, whole = looked(replayed, replayed.observers), looked(replayed, capsules)
    free_seen, free_whole = looked(free, replayed.observers), looked(free, capsules)
    part = experiment.evidence
    free_distances = free_whole.least_own if part is None else free_seen.of(part)
    return Outcome(
        experiment=experiment,
        priorities=priorities,
        worn=worn,
        replay=replayed,
        free=free,
        on_observers=Collisions.of(seen),
        on_capsules=Collisions.of(whole),
        free_on_observers=Collisions.of(free_seen),
        free_on_capsules=Collisions.of(free_whole),
        cycles=0 if part is None else cycles_on_hold(free, -free_distances),
        distances=whole.least_own if part is None else seen.of(part),
        free_distances=free_distances,
    )
