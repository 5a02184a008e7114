"""Inverse kinematics: strict levels with inequalities, on any MJCF or URDF.

The public names below are the library of docs/ik.md. The other modules compile priority files, and know of robots.
"""

from retarget.ik.solver import CentreOfMass, HalfSpaces, KeepClear, Orientation, Position, Posture, Solver
from retarget.model.body import load_body, load_body_text

__all__ = [
    "CentreOfMass",
    "HalfSpaces",
    "KeepClear",
    "Orientation",
    "Position",
    "Posture",
    "Solver",
    "load_body",
    "load_body_text",
]
