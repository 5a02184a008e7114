"""Command governor: the largest part of a desired motion from which the robot can still stop.

Goal and last verified stop are blended row by row, with separate shares of the legs and of the other joints: a blend of
paths within limits is within limits, and soles and balance change evenly.

Source: Garone, Di Cairano and Kolmanovsky, "Reference and command governors for systems with constraints", Automatica
75, 2017, with the stop in place of the predicted response.
"""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from hardware.guard import CheckedGoal
from retarget.ik.whole_body_stop import StopPath
from retarget.model.robot import RobotBody
from retarget.safety.gate import Gate
from retarget.safety.standing import StandingCheck
from retarget.types import BoolArray, FloatArray

SHARES = (1.0, 0.5, 0.25)  # of the distance, tried in this order
LEAST = 1e-3  # smaller shares count as none
SECANT_STEPS = 3  # secant steps to the share at which soles and balance are just kept
SECANT_SHARE = 0.98  # factor of that share, as losses are not quite linear in it


class CommandGovernor:
    """Checks the goals of one robot with their stops, as a whole or in part."""

    def __init__(self, robot: RobotBody, gate: Gate, standing: StandingCheck, carrying: BoolArray) -> None:
        """carrying (nv,): mask of the root and the joints of the legs."""
        self._body, self._gate, self._standing, self._carrying = robot.kinematics, gate, standing, carrying
        self._dofs = [robot.body.dof_index(joint) for joint in robot.joint_map.joints]
        self._others = robot.servo_columns[~carrying[self._dofs]]

    def check(self, last: CheckedGoal, stop: StopPath, standing: FloatArray) -> tuple[CheckedGoal, StopPath] | None:
        """The feasible goal and its stop; None if the last verified stop goes on. stop: from the desired posture.
        standing (nq,)."""
        goal = self._passed(last, stop, standing)
        if goal is not None:
            return goal, stop
        rows = last.stop if len(last.stop) else last.posture[None]
        if stop.carries is not None:
            shares, instead = self._beside_walk(stop, rows)
        else:
            instead = StopPath(self._standing.postures(rows, standing), stop.footing)
            shares = self._shares(stop, instead)
        for legs, others in shares:
            part = self._blend(instead, stop, legs, others)
            goal = self._passed(last, part, standing)
            if goal is not None:
                return goal, part
        return None

    def _beside_walk(self, stop: StopPath, rows: FloatArray) -> tuple[Iterator[tuple[float, float]], StopPath]:
        """Shares of the joints beside walking legs, and the path at share 0. Without the legs of the last stop, rows
        (k, n), none."""
        legs = self._carrying[self._dofs]
        count = min(len(rows), len(stop.postures))
        desired = self._standing.joints(stop.postures)
        same = len(rows) >= len(desired) and np.array_equal(rows[:count, legs], desired[:count, legs])
        postures = stop.postures.copy()
        if same:
            postures[:, self._others] = rows[:count, ~legs]
        return iter([(0.0, share) for share in (*SHARES[1:], 0.0)] if same else []), replace(stop, postures=postures)

    def _passed(self, last: CheckedGoal, stop: StopPath, standing: FloatArray) -> CheckedGoal | None:
        target = self._standing.joints(stop.postures[:1])[0]
        return self._gate.check(last, target, stop=stop, standing=standing)

    def _shares(self, stop: StopPath, instead: StopPath) -> Iterator[tuple[float, float]]:
        legs = self._kept(stop, instead)
        for share in SHARES:
            if legs * share > LEAST and (legs < 1.0 or share < 1.0):
                yield legs * share, share
        for share in SHARES:
            yield 0.0, share
        if legs > LEAST:
            yield legs, 0.0

    def _kept(self, stop: StopPath, instead: StopPath) -> float:
        bounds = self._standing.bounds(instead)
        lost, none = self._standing.losses(stop), self._standing.losses(self._blend(instead, stop, 0.0, 1.0))
        share = 1.0
        for _ in range(SECANT_STEPS):
            if lost.within(bounds):
                return share
            slip = _secant(none.slip, lost.slip, bounds.slip)
            share *= SECANT_SHARE * min(slip, _secant(none.shortfall, lost.shortfall, bounds.shortfall))
            if share < LEAST:
                break
            lost = self._standing.losses(self._blend(instead, stop, share, 1.0))
        return share if lost.within(bounds) else 0.0

    def _blend(self, instead: StopPath, stop: StopPath, legs: float, others: float) -> StopPath:
        share = np.where(self._carrying, legs, others)
        here, there, blended = instead.postures, stop.postures, list[FloatArray]()
        for k in range(max(len(here), len(there))):
            a, b = here[min(k, len(here) - 1)], there[min(k, len(there) - 1)]
            blended.append(self._body.integrate(a, share * self._body.difference(a, b)))
        return replace(stop, postures=np.array(blended))


def _secant(none: float, lost: float, bound: float) -> float:
    """The share at which a loss that grows from `none` to `lost` is at its bound."""
    if lost <= bound:
        return 1.0
    return max(bound - none, 0.0) / (lost - none) if lost > none else 0.0
