"""Standing: whether a robot keeps its soles and its balance on the path of a stop."""

from dataclasses import dataclass

import numpy as np

from retarget._solver import Footing
from retarget.ik.base_pose import plant_roots
from retarget.ik.support_polygon import Stance, footing
from retarget.ik.whole_body_stop import Contact, StopPath, carried_by
from retarget.model.robot import RobotBody
from retarget.types import FloatArray

SOLE_M = 0.001
"""Distance (m) that a corner of a sole may be from its place on the way to a stop."""
BALANCE_M = 0.003
"""Distance (m) inside the outline of the soles that carry that the centre of mass keeps on the way to a stop."""
NO_WORSE_M = 1e-7
"""What is beyond these bounds on the stop that would be followed else may go on, if it gets worse by no more than this,
m: rounding."""


@dataclass(frozen=True)
class Losses:
    """What a robot loses on a path. slip: most that a corner of a sole that carries is off its place, m. shortfall:
    most that the centre of mass falls short of BALANCE_M, m; of a robot at rest it is the capture point."""

    slip: float
    shortfall: float

    def within(self, others: "Losses") -> bool:
        """Whether both are no more than bounds."""
        return self.slip <= others.slip and self.shortfall <= others.shortfall


class StandingCheck:
    """The check of soles and balance of one robot in its stance."""

    def __init__(self, robot: RobotBody, stance: Stance) -> None:
        self._robot, self._soles, self._columns = robot, stance.soles, robot.servo_columns
        self._footings = dict[Contact, Footing]()

    def joints(self, postures: FloatArray) -> FloatArray:
        """The joints (k, n) rad, servo order, of postures (k, nq)."""
        return np.ascontiguousarray(postures[:, self._columns])

    def postures(self, joints: FloatArray, standing: FloatArray) -> FloatArray:
        """Postures (k, nq) with these joints (k, n) rad of a robot whose lower sole stays where it is in `standing`
        (nq,)."""
        before = np.tile(standing, (len(joints), 1))
        rows = before.copy()
        rows[:, self._columns] = joints
        plant_roots(self._robot, before, rows)
        return rows

    def losses(self, stop: StopPath) -> Losses:
        """What is lost on the path of a stop. A robot that no sole carries loses nothing."""
        if not any(stop.contact):
            return Losses(0.0, -np.inf)
        if stop.contact not in self._footings:
            self._footings[stop.contact] = footing(self._robot.kinematics, carried_by(self._soles, stop.contact))
        slip, inside = self._footings[stop.contact].losses(stop.postures)
        return Losses(slip, BALANCE_M - inside)

    def bounds(self, instead: StopPath) -> Losses:
        """The most that may be lost by a robot that would follow `instead`."""
        lost = self.losses(instead)
        return Losses(max(SOLE_M, lost.slip + NO_WORSE_M), max(0.0, lost.shortfall + NO_WORSE_M))

    def holds(self, stop: StopPath, last: FloatArray, standing: FloatArray) -> bool:
        """Whether a robot keeps its soles and its balance on the path of a stop, or loses no more than on the one
        (k, n) that was verified last. standing (nq,): as it stands."""
        lost = self.losses(stop)
        if lost.within(Losses(SOLE_M, 0.0)):
            return True
        instead = standing[None] if not len(last) else self.postures(last, standing)
        return lost.within(self.bounds(StopPath(instead, stop.contact)))
