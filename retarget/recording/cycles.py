"""What the tick hands to the recorder: arrays with a row per cycle, made before the first and written in place."""

from dataclasses import dataclass, fields
from enum import IntEnum, IntFlag
from typing import Any

import numpy as np
from numpy.typing import NDArray

from retarget.frames import BoolArray
from retarget.rotations import FloatArray

__all__ = ["READINGS", "Asked", "Cycles", "Done", "Shape"]

READINGS = 8
"""Readings of the clock that are kept of a cycle: it takes five at most."""


class Asked(IntFlag):
    """What was asked before a cycle, and answered with yes."""

    STOP = 1
    """Somebody asked for a stop."""
    CUT = 2
    """Somebody asked for torque off at once."""
    OVER = 4
    """The stream was at its end."""
    PAUSED = 8
    """Somebody holds the robot on purpose."""
    APPROACH = 16
    """The robot might go on with its approach."""
    OUTSIDE = 32
    """Whoever was asked stopped the guard instead of answering."""


class Done(IntEnum):
    """What became of a read, a write or a sample."""

    NOT = 0
    WELL = 1
    FAILED = 2
    """The bus failed; of a sample: there was none that can be trusted."""


@dataclass(frozen=True)
class Shape:
    """How many there are: sensors, servos, columns of q that no servo moves, q of the human, its joints, landmarks,
    observers of the robot, and of the human; and numbers that tell the truth about a simulated body."""

    sensors: int
    servos: int
    rest: int
    human: int
    joints: int
    landmarks: int
    observers: int
    human_observers: int
    truth: int = 0


@dataclass(frozen=True, eq=False)
class Cycles:
    """Cycles, a row each: from the end of one tick to the end of the next. Units as in `Record` and `ServoStates`.

    index (T,): number of the cycle, 0 is that of arming. time (T,) s: when its tick began, on the run's clock. clock
    (T, READINGS) s: what the clock said, `readings` (T,) times. asked (T,): `Asked`. tick (T,): of the performance.
    sampled, read, written (T,): `Done`. goal (T, n) ticks. kept (T,): the pipeline has a row of it; then
    phase (T,), gated, unled, q (T, n) rad as sent, before rounding, rest (T, r): the other columns of q, and so on.
    cost (T, 3) s of thread CPU of both stages and of wall time of the tick. truth (T, t): see `beside.Truth`.
    """

    index: NDArray[np.int64]
    time: FloatArray
    clock: FloatArray
    readings: NDArray[np.uint8]
    asked: NDArray[np.uint32]
    tick: NDArray[np.int64]
    sampled: NDArray[np.uint8]
    settled: FloatArray
    sensor_position: FloatArray
    sensor_orientation: FloatArray
    sensor_valid: BoolArray
    sensor_weight: FloatArray
    weighted: BoolArray
    read: NDArray[np.uint8]
    bus_time: FloatArray
    position: NDArray[np.int64]
    velocity: FloatArray
    current: FloatArray
    voltage: FloatArray
    temperature: FloatArray
    error: NDArray[np.uint8]
    alert: NDArray[np.uint8]
    age: FloatArray
    valid: BoolArray
    driven: BoolArray
    retries: NDArray[np.int64]
    rough: FloatArray
    written: NDArray[np.uint8]
    goal: NDArray[np.int64]
    state: NDArray[np.uint8]
    kept: BoolArray
    phase: NDArray[np.int8]
    gated: BoolArray
    unled: BoolArray
    q: FloatArray
    rest: FloatArray
    landmarks: FloatArray
    observer_modes: NDArray[np.uint8]
    human_q: FloatArray
    human_joints: FloatArray
    human_observer_modes: NDArray[np.uint8]
    cost: FloatArray
    truth: FloatArray

    @classmethod
    def empty(cls, rows: int, shape: Shape) -> "Cycles":
        """Room for so many cycles."""
        k, n = shape.sensors, shape.servos
        wide: dict[str, tuple[int, ...]] = dict.fromkeys(
            ("position", "velocity", "current", "voltage", "temperature", "error", "alert", "age", "valid", "driven"),
            (n,),
        )
        wide |= {"clock": (READINGS,), "goal": (n,), "q": (n,), "rest": (shape.rest,), "cost": (3,)}
        wide |= {"sensor_position": (k, 3), "sensor_orientation": (k, 4), "sensor_valid": (k,), "sensor_weight": (k,)}
        wide |= {"landmarks": (shape.landmarks, 3), "observer_modes": (shape.observers,)}
        wide |= {"human_q": (shape.human,), "human_joints": (shape.joints, 3)}
        wide |= {"human_observer_modes": (shape.human_observers,), "truth": (shape.truth,)}
        return cls(**{one.name: np.zeros((rows, *wide.get(one.name, ())), _kind(one.type)) for one in fields(cls)})

    def __len__(self) -> int:
        return len(self.index)

    def taken(self, rows: NDArray[np.intp]) -> "Cycles":
        """Copies of some rows."""
        return Cycles(**{one.name: getattr(self, one.name)[rows] for one in fields(self)})


def _kind(annotation: Any) -> np.dtype[Any]:
    """The dtype of an array type such as NDArray[np.int64]."""
    kind: np.dtype[Any] = np.dtype(annotation.__args__[1].__args__[0])
    return kind
