"""What a reconstruction yields each tick: a posture of the virtual human, and where its parts are."""

from dataclasses import dataclass, field

import numpy as np

from retarget._solver import Probe
from retarget.carrying_feet import Carrying
from retarget.human import Human
from retarget.human_dimensions import POINTS
from retarget.record import ModeArray
from retarget.rotations import FloatArray

__all__ = ["ORIENTED", "HumanPosture", "PostureReader"]

ORIENTED: tuple[str, ...] = ("pelvis", "chest", "head")
"""Parts whose orientation is told."""


def _no_modes() -> ModeArray:
    return np.zeros(0, dtype=np.uint8)


@dataclass(frozen=True, eq=False, slots=True)
class HumanPosture:
    """One posture, world frame.

    q (nq,): as the solver has it. joint_names: m canonical names; joints (m, 3): their centres, m. orientations (3, 4):
    wxyz of ORIENTED; the identity stands upright and faces x. centre_of_mass (3,) m. sensor_error (k,) m: distance of
    each worn sensor's joint from where it was last measured, NaN where it is missing. balance_error: distance of the
    centre of mass from its goal, m; NaN where there is none. heading: unit vector on the ground. observer_modes (o,):
    0 free, 1 preventive, 2 reactive. carrying: which feet carry.
    """

    q: FloatArray
    joint_names: tuple[str, ...]
    joints: FloatArray
    orientations: FloatArray
    centre_of_mass: FloatArray
    sensor_error: FloatArray
    balance_error: float
    heading: tuple[float, float]
    observer_modes: ModeArray = field(default_factory=_no_modes)
    carrying: Carrying = Carrying.BOTH

    def joint(self, name: str) -> FloatArray:
        """Centre (3,) m of one joint."""
        return np.asarray(self.joints[self.joint_names.index(name)])

    def orientation(self, name: str) -> FloatArray:
        """Orientation (4,) wxyz of one of ORIENTED."""
        return np.asarray(self.orientations[ORIENTED.index(name)])


class PostureReader:
    """Joint centres, orientations and the centre of mass of a human's postures."""

    def __init__(self, human: Human) -> None:
        self._body = human.body.solver_body()
        frames = [human.body.frame(name) for name in POINTS]
        self._links = [frame.body for frame in frames]
        self._local = np.array([frame.position for frame in frames])
        self._oriented = [human.body.frame(name).body for name in ORIENTED]
        self._probe = Probe(self._body, self._links, self._local, self._oriented)

    def read(self, q: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Of one posture (nq,): joints (m, 3) m, orientations (3, 4) wxyz, and centre of mass (3,) m."""
        return self._probe.read(q)

    def joints(self, q: FloatArray) -> FloatArray:
        """Centres (T, m, 3) m of all POINTS, for postures (T, nq)."""
        return self._body.points(q, self._links, self._local)

    def orientations(self, q: FloatArray) -> FloatArray:
        """Orientations (T, 3, 4) wxyz of ORIENTED, for postures (T, nq)."""
        return self._body.orientations(q, self._oriented)

    def centre_of_mass(self, q: FloatArray) -> FloatArray:
        """Centres of mass (T, 3) m, for postures (T, nq)."""
        return self._body.centre_of_mass(q)
