"""The cycles of a recording: arrays with a row per cycle, made before the first cycle and written in place.

A cycle is a tick of the run: its input, the goal that was sent, and its row of the record. Cycle 0 of a robot is its
arming.
"""

from dataclasses import dataclass, fields
from enum import IntEnum, IntFlag

import numpy as np
from numpy.typing import NDArray

from retarget.run.record import room
from retarget.types import BoolArray, FloatArray, RunState

READINGS = 8
"""Readings of the clock for which a cycle has room. Two are used: both are the time of its tick."""
STATES_OF_RUN = {state: place for place, state in enumerate(RunState)}
"""Numbers of the states of a run."""


class Asked(IntFlag):
    """Parts of the input of a tick that are true or false."""

    STOP = 1
    """The operator asked for a stop."""
    TORQUE_OFF = 2
    """The operator asked for torque off at once."""
    OVER = 4
    """The performance was over."""
    PAUSED = 8
    """The operator paused the robot."""
    APPROACH = 16
    """The robot might go on with its approach."""
    OUTSIDE = 32
    """The robot had a fault that its servos do not report, such as a fall; the events hold cause and reason."""


class Done(IntEnum):
    """What became of a read, a write or a sample."""

    NOT = 0
    WELL = 1
    FAILED = 2
    """The bus failed. Of a sample: no valid one was there."""


@dataclass(frozen=True)
class Shape:
    """Numbers of sensors, servos, columns of q that no servo moves, columns of the human's q, its joints, landmarks,
    observers of the robot and of the human, and of values that describe where a simulated body really is."""

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
    """Cycles, a row each. Units as in `Record` and `ServoStates`.

    index (T,): number of the cycle, 0 is that of arming. time (T,) s: of its tick, on the run's clock. clock (T,
    READINGS) s: readings of the clock, `readings` (T,) of them. asked (T,): `Asked`. tick (T,): of the performance.
    sampled, read, written (T,): `Done`. goal (T, n) ticks. kept (T,): the pipeline has a row of it; then phase (T,),
    gated, no_command, q (T, n) rad as sent, before rounding, rest (T, r): the other columns of q, and so on. cost (T,
    3) s of thread CPU of both stages and of wall time of the tick. truth (T, t): numbers of `run_result.truth_names`.
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
    error_rate: FloatArray
    written: NDArray[np.uint8]
    goal: NDArray[np.int64]
    state: NDArray[np.uint8]
    kept: BoolArray
    phase: NDArray[np.int8]
    gated: BoolArray
    no_command: BoolArray
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
        return room(cls, rows, wide)

    def __len__(self) -> int:
        return len(self.index)

    @property
    def now(self) -> FloatArray:
        """Times (T,), s, on the run's clock, at which the inputs of the ticks were there. Recordings of before a tick
        had one time hold all readings of the clock: one before the servos were read, one after it, and others."""
        return np.where(self.readings > 1, self.clock[:, 1], self.clock[:, 0])

    def taken(self, rows: NDArray[np.intp]) -> "Cycles":
        """Copy the rows of these numbers."""
        return Cycles(**{one.name: getattr(self, one.name)[rows] for one in fields(self)})
