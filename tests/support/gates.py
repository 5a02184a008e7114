"""Short ways to drive a gate in tests: what is sent for a target, refused or not, and where that was."""

from collections.abc import Callable
from typing import cast

from hardware.arrays import FloatArray
from retarget.safety.clearance import PathClearance
from retarget.safety.gate import Gate

PathCheck = Callable[[FloatArray, FloatArray], bool]
"""In place of a `PathClearance`: from two paths (k, n) rad to whether the first is clear."""


def as_clearance(check: PathCheck | None) -> PathClearance | None:
    """A function as the collision check of a gate."""
    return cast("PathClearance | None", check)


def admit(gate: Gate, target: FloatArray) -> FloatArray:
    """What is sent for a target, rad (n,): its goal, or the next one of the braking trajectory."""
    return (gate.check(target) or gate.brake()).joints


def sent(gate: Gate) -> FloatArray:
    """What was sent last, rad (n,)."""
    assert gate.goal is not None
    return gate.goal.joints


def held(gate: Gate) -> FloatArray:
    """The posture that it holds, rad (n,)."""
    assert gate.goal is not None
    return gate.goal.posture
