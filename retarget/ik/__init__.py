"""Inverse kinematics: strict levels of tasks and inequalities on any MJCF or URDF.

Bodies and priority files come in; solvers, stances and stop paths go out. The names below are the library of
docs/ik.md. May import `model` and all below it.
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
