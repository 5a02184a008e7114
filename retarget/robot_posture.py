"""What the robot's stage yields each tick: a posture, what was asked of it, and what it reaches."""

from dataclasses import dataclass

from retarget.record import ModeArray
from retarget.rotations import FloatArray

__all__ = ["RobotPosture"]


@dataclass(frozen=True, eq=False, slots=True)
class RobotPosture:
    """One posture of the robot, in its own world: origin on the ground between the soles, x forward.

    q (nq,): root_position (3,) m, root_quaternion (4,) wxyz (fixed robots: where the body file has it) and joints.
    joint_positions (n,): rad, servo order. landmarks_asked, landmarks_reached (k, 3): m, in order of landmark_names.
    centre_of_mass (3,) m; support_distance: m inside the support polygon of the soles, infinite without soles.
    observer_modes (o,): 0 free, 1 preventive, 2 reactive, in the order of the profile.
    """

    q: FloatArray
    joint_positions: FloatArray
    root_position: FloatArray
    root_quaternion: FloatArray
    landmark_names: tuple[str, ...]
    landmarks_asked: FloatArray
    landmarks_reached: FloatArray
    centre_of_mass: FloatArray
    support_distance: float
    observer_modes: ModeArray
