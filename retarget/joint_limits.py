"""Limits of a body's degrees of freedom."""

from dataclasses import dataclass

from retarget.rotations import FloatArray

__all__ = ["JointLimits"]


@dataclass(frozen=True, eq=False)
class JointLimits:
    """Limits per DoF, each (nv,): position (rad or m), velocity per s, acceleration per s^2; infinite for no limit."""

    lower: FloatArray
    upper: FloatArray
    max_velocity: FloatArray
    max_acceleration: FloatArray
