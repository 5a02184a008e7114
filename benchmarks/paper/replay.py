"""A motion through the reconstruction, frame by frame: postures, what observers did, and what each frame cost."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from hardware.clock import MonotonicClock, thread_cpu
from retarget.frames import SensorFrames, SensorSample
from retarget.human.calibration import calibrate
from retarget.human.reconstruction import Reconstructor
from retarget.model.human import Human, PostureReader, build_human
from retarget.model.human_dimensions import POINTS
from retarget.model.observers import Observers, ObserverSet
from retarget.model.scene_state import SceneState
from retarget.schema.performer import load_performer
from retarget.schema.priorities import Priorities
from retarget.schema.scene import Scene
from retarget.types import FloatArray, HumanPosture, ModeArray

PERFORMER = "five"
"""Head, wrists and ankles, as in the paper."""


@dataclass(frozen=True, eq=False)
class Replay:
    """T reconstructed postures.

    postures: all of them; q (T, nq); joints (T, m, 3) m of `POINTS`; errors_mm (T, k) of `sensors`; balance_mm (T,):
    distance of the centre of mass from its goal; modes (T, n): 0 free, 1 preventive, 2 reactive, of each observer;
    switches (n,): changes of mode; cpu_s (T,): thread CPU time of each frame; wall_s: of all of them together; the
    first frame is many, because it settles. dt: s per frame.
    """

    human: Human
    sensors: tuple[str, ...]
    observers: Observers | None
    postures: tuple[HumanPosture, ...]
    q: FloatArray
    joints: FloatArray
    errors_mm: FloatArray
    balance_mm: FloatArray
    modes: ModeArray
    switches: FloatArray
    cpu_s: FloatArray
    wall_s: float
    dt: float

    @property
    def frames_per_s(self) -> float:
        """Frames per second of wall time."""
        return len(self.q) / self.wall_s

    @property
    def duration_s(self) -> float:
        """Length of the motion, s."""
        return len(self.q) * self.dt

    @property
    def left(self) -> FloatArray:
        """Unit vector (3,), level, to the performer's left at the start: as the sensed ankles and wrists lie."""
        first = dict(zip(POINTS, self.joints[0], strict=True))
        across = first["l_ankle"] - first["r_ankle"] + first["l_wrist"] - first["r_wrist"]
        across[2] = 0.0
        return np.asarray(across / max(float(np.linalg.norm(across)), 1e-9))


def replay(
    frames: SensorFrames,
    priorities: Priorities,
    *,
    sensors: str = PERFORMER,
    observed: ObserverSet = "none",
    scene: Scene | None = None,
    iterations: int | None = None,
    change: Callable[[int, SensorSample], SensorSample] = lambda frame, sample: sample,
    progress: Callable[[int], None] = lambda done: None,
) -> Replay:
    """Reconstruct every frame. sensors: a performer's file; observed: which observers; iterations: N_IK instead of the
    file's; change: may replace each sample."""
    human, performer = build_human(calibrate(frames)), load_performer(sensors)
    observers = priorities.observers.model_copy(update={"human": observed})
    worn = frames.select(tuple(performer.sensors))
    reconstructor = Reconstructor(
        human,
        priorities.model_copy(update={"observers": observers}),
        performer,
        iterations=iterations,
        scene=None if scene is None else SceneState(scene),
    )
    steps = np.diff(worn.time).tolist()
    samples = [SensorSample(worn.names, *row) for row in zip(worn.position, worn.orientation, worn.valid, strict=True)]
    postures, cpu = [], np.zeros(len(samples))
    clock = MonotonicClock()
    begun = clock.now()
    for k, sample in enumerate(samples):
        sample, before = change(k, sample), thread_cpu()
        postures.append(reconstructor.step(sample, steps[k - 1]) if k else reconstructor.start(sample))
        cpu[k] = thread_cpu() - before
        if k % 50 == 0:
            progress(k)
    wall = clock.now() - begun
    q = np.array([posture.q for posture in postures])
    modes = np.array([posture.observer_modes for posture in postures])
    return Replay(
        human=human,
        sensors=reconstructor.sensors,
        observers=reconstructor.observers,
        postures=tuple(postures),
        q=q,
        joints=PostureReader(human).joints(q),
        errors_mm=1e3 * np.array([posture.sensor_error for posture in postures]),
        balance_mm=1e3 * np.array([posture.balance_error for posture in postures]),
        modes=modes,
        switches=np.count_nonzero(np.diff(modes, axis=0), axis=0).astype(float),
        cpu_s=cpu,
        wall_s=wall,
        dt=1.0 / frames.rate_hz,
    )
