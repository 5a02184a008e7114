"""A walk for the tests of sensor validity: sensors that swing, with the noise of real ones, and their judgement."""

from dataclasses import dataclass, field

import numpy as np

from retarget.frames import SensorFrames
from retarget.live.sensor_validity import SensorValidity, StateArray, ValidityState
from retarget.rotations import from_rotation_vector, multiply
from retarget.types import BoolArray, FloatArray

NAMES = ("head", "l_wrist", "r_wrist", "l_ankle", "r_ankle", "pelvis")
HOME = np.array([[0, 0, 1.6], [0, 0.3, 0.9], [0, -0.3, 0.9], [0, 0.12, 0.1], [0, -0.12, 0.1], [0, 0, 1.0]])
SWING = np.array([0.02, 0.25, -0.25, -0.3, 0.3, 0.03])
LAG = 0.005
"""s from capture to judgement."""


@dataclass
class Stream:
    """What a sender sent; tests change it."""

    time: FloatArray
    position: FloatArray
    orientation: FloatArray
    tracked: BoolArray
    names: tuple[str, ...] = NAMES


@dataclass
class Judged:
    """The judgement of a stream: states and usable (T, k), messages with the row at which they came."""

    validity: SensorValidity
    states: StateArray
    usable: BoolArray
    messages: list[tuple[int, str]] = field(default_factory=list)

    def alarms(self) -> set[ValidityState]:
        return {ValidityState(state) for state in np.unique(self.states)} - {ValidityState.FRESH}


def noisy(
    position: FloatArray, orientation: FloatArray, *, seed: int = 0, metres: float = 0.002
) -> tuple[FloatArray, FloatArray]:
    """The track with the noise of an optical or a consumer system: `metres`, and 0.1 degree."""
    random = np.random.default_rng(seed)
    turn = from_rotation_vector(random.normal(0.0, np.radians(0.1), position.shape))
    return position + random.normal(0.0, metres, position.shape), multiply(orientation, turn)


def walk(seconds: float = 2.0, rate: float = 100.0, *, swing: float = 1.0, noise: bool = True) -> Stream:
    """A walk of one step a second; `swing` 0: standing."""
    time = 5.0 + np.arange(0.0, seconds, 1.0 / rate)
    phase = swing * np.sin(2.0 * np.pi * time)[:, None] * SWING
    position = HOME + np.stack([phase, np.zeros_like(phase), 0.2 * np.abs(phase)], axis=-1)
    orientation = from_rotation_vector(np.stack([np.zeros_like(phase), -2.0 * phase, np.zeros_like(phase)], axis=-1))
    if noise:
        position, orientation = noisy(position, orientation)
    return Stream(time, position, orientation, np.ones(phase.shape, dtype=bool))


def recorded(frames: SensorFrames, rate: float, *, metres: float) -> Stream:
    """A recording as from a sender of `rate` Hz, with noise and with stamps that are off by up to 2 ms."""
    frames = frames.resample(np.arange(0.0, frames.duration_s, 1.0 / rate))
    position, orientation = noisy(frames.position, frames.orientation, metres=metres)
    late = np.random.default_rng(1).uniform(0.0, 0.002, len(frames))
    return Stream(5.0 + frames.time + late, position, orientation, frames.valid.copy(), frames.names)


def judge(stream: Stream, validity: SensorValidity | None = None) -> Judged:
    validity = validity or SensorValidity(stream.names)
    rows = np.arange(len(stream.names))
    judged = Judged(
        validity, np.zeros(stream.tracked.shape, dtype=np.uint8), np.zeros(stream.tracked.shape, dtype=bool)
    )
    for i, time in enumerate(stream.time.tolist()):
        judged.usable[i] = validity.take(
            rows, time, position=stream.position[i], orientation=stream.orientation[i], tracked=stream.tracked[i]
        )
        judged.states[i] = validity.judge(time + LAG)
        judged.messages += [(i, text) for text in validity.messages()]
    return judged
