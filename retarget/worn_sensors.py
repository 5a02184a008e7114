"""The sensors that a performer wears, read out of a source's samples."""

from dataclasses import dataclass

import numpy as np

from retarget import rotations
from retarget.frames import BoolArray, SensorSample
from retarget.human import Human
from retarget.human_dimensions import POINTS
from retarget.human_joints import HUMAN_JOINTS
from retarget.performer import Performer
from retarget.rotations import FloatArray

__all__ = ["SensorTurn", "WornSensors"]


@dataclass(frozen=True, eq=False, slots=True)
class SensorTurn:
    """A sensor's orientation. forward: its x axis on the ground. link (4,): wxyz of the link that it sits on, world."""

    sensor: str
    forward: tuple[float, float]
    link: FloatArray


class WornSensors:
    """k sensors in the performer's order; a sensor that the source does not have is never valid.

    `joints` (k): index in POINTS of the joint that each sits on. `oriented`: rows whose orientation is used.
    """

    def __init__(self, performer: Performer, human: Human, rest: FloatArray | None) -> None:
        """rest (18, 4): orientation of each link in the pose where sensors are the identity, as
        `calibration.rest_orientations` gives it; None: the links hang as in the human's own zero posture."""
        self.names = tuple(performer.sensors)
        self.joints = [POINTS.index(sensor.joint) for sensor in performer.sensors.values()]
        self.oriented = [self.names.index(name) for name in performer.oriented]
        self._rest = [self._rest_of(human, performer.sensors[name].joint, rest) for name in performer.oriented]
        self._sample_names: tuple[str, ...] = ()
        self._columns = np.zeros(0, dtype=np.int64)
        self._exists: BoolArray = np.zeros(len(self.names), dtype=bool)

    def read(self, sample: SensorSample) -> tuple[FloatArray, BoolArray]:
        """Positions (k, 3) m and which of them are valid (k,)."""
        if sample.names is not self._sample_names:
            self._sample_names = sample.names
            names = sample.names
            self._columns = np.array([names.index(name) if name in names else 0 for name in self.names], dtype=np.int64)
            self._exists = np.array([name in sample.names for name in self.names])
        position = sample.position.take(self._columns, axis=0)
        known = np.logical_and.reduce(np.isfinite(position), axis=1)
        return position, sample.valid.take(self._columns) & self._exists & known

    def weights(self, sample: SensorSample) -> FloatArray | None:
        """How far who was lost has come back (k,); None: everybody has. Call `read` with this sample first."""
        return None if sample.weight is None else sample.weight.take(self._columns)

    def orientations(self, sample: SensorSample) -> list[SensorTurn]:
        """Every orientation that is used and known. Call `read` with this sample first."""
        found = []
        for row, rest in zip(self.oriented, self._rest, strict=True):
            column = self._columns[row]
            turn = sample.orientation[column]
            if self._exists[row] and sample.valid[column] and np.isfinite(turn).all():
                w, x, y, z = turn.tolist()
                forward = (1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y + w * z))
                link = turn if rest is None else rotations.multiply(turn, rest)
                found.append(SensorTurn(self.names[row], forward, link))
        return found

    @staticmethod
    def _rest_of(human: Human, joint: str, rest: FloatArray | None) -> FloatArray | None:
        """Rest orientation (4,) of the link that carries a joint; None for the identity."""
        if rest is None:
            return None
        link = human.body.body_names[human.body.frame(joint).body]
        row = rest[[one.name for one in HUMAN_JOINTS].index(link)]
        return None if np.allclose(row, rotations.IDENTITY) else row
