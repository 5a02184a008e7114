"""NPZ for trainers of motion tracking: the keys that whole_body_tracking (BeyondMimic) and mjlab load, and GMR's."""

from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

from retarget.exporting.links import angular_velocity, links_of, rate_of_change
from retarget.exporting.motion import Motion

__all__ = ["trainer_arrays", "write_trainer_npz"]

Arrays = dict[str, NDArray[Any]]


def write_trainer_npz(motion: Motion, stream: IO[bytes]) -> None:
    """Write the arrays of `trainer_arrays`. Raises InputError where rows are not evenly spaced."""
    np.savez(stream, allow_pickle=False, **trainer_arrays(motion))


def trainer_arrays(motion: Motion) -> Arrays:
    """Evenly spaced rows (T), float32, SI units.

    fps (1,); joint_names (n,), joint_pos and joint_vel (T, n); body_names (b,), body_pos_w (T, b, 3), body_quat_w
    (T, b, 4) **wxyz**, body_lin_vel_w and body_ang_vel_w (T, b, 3) of every link's origin, world. As GMR names them:
    root_pos (T, 3), root_rot (T, 4) **xyzw**, dof_pos (T, n). Velocities are central differences. Raises InputError
    where rows are not evenly spaced.
    """
    rate, links, joints = motion.rate_hz, links_of(motion), motion.joints
    arrays = {
        "joint_pos": joints,
        "joint_vel": rate_of_change(joints, rate),
        "body_pos_w": links.position,
        "body_quat_w": links.orientation,
        "body_lin_vel_w": rate_of_change(links.position, rate),
        "body_ang_vel_w": angular_velocity(links.orientation, rate),
        "root_pos": motion.root_position,
        "root_rot": motion.root_quaternion[:, [1, 2, 3, 0]],
        "dof_pos": joints,
    }
    return {
        "fps": np.array([int(rate) if rate.is_integer() else rate]),
        "joint_names": np.array(motion.joint_names),
        "body_names": np.array(links.names),
        **{key: values.astype(np.float32) for key, values in arrays.items()},
    }
