"""Short ways to drive a gate in tests: what is sent for a target, refused or not, and where that was."""

from collections.abc import Callable
from typing import Protocol, cast

import numpy as np

from hardware.arrays import FloatArray
from hardware.guard import CheckedGoal
from retarget.safety.clearance import PathClearance
from retarget.safety.gate import Gate

PathCheck = Callable[[FloatArray, FloatArray], bool]
"""In place of a `PathClearance`: from two paths (k, n) rad to whether the first is clear."""


def as_clearance(check: PathCheck | None) -> PathClearance | None:
    """A function as the collision check of a gate."""
    look = None if check is None else lambda path, instead, standing, walk=None: check(path, instead)
    return cast("PathClearance | None", look)


class Sent(Protocol):
    """A guard, or a gate that is driven: it knows the goal that was sent last."""

    @property
    def goal(self) -> CheckedGoal | None: ...


class DrivenGate:
    """A gate whose goals are all sent. standing (nq,): as its robot stands."""

    def __init__(self, gate: Gate, start: FloatArray, standing: FloatArray | None = None) -> None:
        self.gate, self.goal = gate, gate.begin(start)
        self.standing = np.zeros(0) if standing is None else standing

    def check(self, target: FloatArray) -> CheckedGoal | None:
        goal = self.gate.check(self.goal, target, standing=self.standing)
        self.goal = goal or self.goal
        return goal

    def brake(self) -> CheckedGoal:
        self.goal = self.gate.brake(self.goal)
        return self.goal


def admit(gate: DrivenGate, target: FloatArray) -> FloatArray:
    """What is sent for a target, rad (n,): its goal, or the next one of the braking trajectory."""
    return (gate.check(target) or gate.brake()).joints


def sent(by: Sent) -> FloatArray:
    """What was sent last, rad (n,)."""
    assert by.goal is not None
    return by.goal.joints


def held(by: Sent) -> FloatArray:
    """The posture that it holds, rad (n,)."""
    assert by.goal is not None
    return by.goal.posture


def displacement(by: Sent) -> FloatArray:
    """The displacement of its joints, rad (n,)."""
    assert by.goal is not None
    return by.goal.displacement
