"""Short ways to drive a gate in tests: what is sent for a target, refused or not, and where that was."""

from hardware.arrays import FloatArray
from retarget.safety.gate import Gate


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
