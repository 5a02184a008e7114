"""Inverse kinematics: strict levels of tasks and inequalities on any MJCF or URDF, and robots' stances and stops.

Bodies and priority files come in; solvers, postures and stop paths go out. The public names below are the library of
docs/ik.md. May import schema and model.
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
