"""Formats of programs that train or play whole-body motions: arrays, CSV, a pickle, a folder.

Unevenly spaced rows (T) raise InputError. Frames and units are ours unless a format states others. Velocities are
central differences, and signs of quaternions are continuous.
"""

import io
import pickle
from collections import deque
from typing import IO, Any

import numpy as np

from retarget.model.body import BodyModel
from retarget.recording.motion import CM, Motion, angular_velocity, links_of, rate_of_change, sign_aligned
from retarget.recording.npz import Arrays
from retarget.recording.topics import XYZW
from retarget.rotations import conjugate, rotate, to_euler
from retarget.types import FloatArray


def _fps(motion: Motion) -> int | float:
    rate = motion.rate_hz
    return int(rate) if rate.is_integer() else rate


def breadth_first(body: BodyModel) -> tuple[list[int], list[int]]:
    """Indices of `Links` (b,) and of `Motion.joints` (n,) in Isaac's order, breadth first."""
    links, waiting = list[int](), deque([1])
    while waiting:
        link = waiting.popleft()
        links.append(link - 1)
        waiting.extend(child for child in np.flatnonzero(body.parent == link).tolist() if child)
    moved = [int(body.joint_body[body.joint_index(name)]) - 1 for name in body.scalar_names]
    return links, sorted(range(len(moved)), key=lambda joint: links.index(moved[joint]))


def tracking_arrays(motion: Motion, *, is_breadth_first: bool = False) -> Arrays:
    """The keys of whole_body_tracking and mjlab, float32.

    fps (1,); joint_pos and joint_vel (T, n); body_pos_w (T, b, 3), body_quat_w (T, b, 4) **wxyz**, body_lin_vel_w and
    body_ang_vel_w (T, b, 3) of every link's origin, world. Order: of the body file (mjlab), or breadth first (Isaac).
    Names and quaternion_order are for people.
    """
    rate, links, joints = motion.rate_hz, links_of(motion), motion.joints
    turned = sign_aligned(links.orientation)
    of_links, of_joints = list(range(len(links.names))), list(range(joints.shape[1]))
    if is_breadth_first:
        of_links, of_joints = breadth_first(motion.body)
    arrays = {
        "joint_pos": joints[:, of_joints],
        "joint_vel": rate_of_change(joints, rate)[:, of_joints],
        "body_pos_w": links.position[:, of_links],
        "body_quat_w": turned[:, of_links],
        "body_lin_vel_w": rate_of_change(links.position, rate)[:, of_links],
        "body_ang_vel_w": angular_velocity(turned, rate)[:, of_links],
    }
    return {
        "fps": np.array([_fps(motion)]),
        "joint_names": np.array(motion.joint_names)[of_joints],
        "body_names": np.array(links.names)[of_links],
        "quaternion_order": np.array("wxyz"),
        **{key: values.astype(np.float32) for key, values in arrays.items()},
    }


def write_mjlab(motion: Motion, stream: IO[bytes]) -> None:
    """Write `tracking_arrays` in the order of the body file."""
    np.savez(stream, allow_pickle=False, **tracking_arrays(motion))


def write_beyondmimic(motion: Motion, stream: IO[bytes]) -> None:
    """Write `tracking_arrays` breadth first."""
    np.savez(stream, allow_pickle=False, **tracking_arrays(motion, is_breadth_first=True))


def write_holosoma(motion: Motion, stream: IO[bytes]) -> None:
    """Write the NPZ that holosoma trains on, float64.

    fps (1,); joint_pos (T, 7 + n): position and orientation **wxyz** of the root, then joints; joint_vel (T, 6 + n):
    its linear and angular velocity, then joints. body_pos_w, body_quat_w, body_ang_vel_w (T, 1 + b, ...): of links'
    origins, the world first. body_lin_vel_w: of the links' *centres of mass*, as in its own converter.
    """
    rate, links, body = motion.rate_hz, links_of(motion), motion.body
    turned = sign_aligned(links.orientation)
    centres = links.position + rotate(turned, body.com[1:])
    spin = angular_velocity(turned, rate)
    root = sign_aligned(motion.root_quaternion)
    velocities = [rate_of_change(motion.root_position, rate), angular_velocity(root, rate)]
    world = np.zeros((len(motion), 1, 3))
    still = np.tile([1.0, 0.0, 0.0, 0.0], (len(motion), 1, 1))
    np.savez(
        stream,
        allow_pickle=False,
        fps=np.array([_fps(motion)]),
        joint_pos=np.hstack([motion.root_position, root, motion.joints]),
        joint_vel=np.hstack([*velocities, rate_of_change(motion.joints, rate)]),
        body_pos_w=np.concatenate([world, links.position], axis=1),
        body_quat_w=np.concatenate([still, turned], axis=1),
        body_lin_vel_w=np.concatenate([world, rate_of_change(centres, rate)], axis=1),
        body_ang_vel_w=np.concatenate([world, spin], axis=1),
        joint_names=np.array(motion.joint_names),
        body_names=np.array(["world", *links.names]),
        quaternion_order=np.array("wxyz"),
    )


def gmr_arrays(motion: Motion) -> Arrays:
    """GMR's keys: root_pos (T, 3), root_rot (T, 4) **xyzw**, dof_pos (T, n), local_body_pos (T, b, 3): link origins in
    the root frame."""
    links, root = links_of(motion), sign_aligned(motion.root_quaternion)
    local = rotate(conjugate(root)[:, None], links.position - motion.root_position[:, None])
    return {
        "root_pos": motion.root_position,
        "root_rot": root[:, XYZW],
        "dof_pos": motion.joints,
        "local_body_pos": local,
    }


class _AnyNumpy(pickle.Pickler):
    """Pickles arrays by names of every NumPy. NumPy 2 writes numpy._core, which versions below 1.26 lack."""

    def reducer_override(self, value: object) -> Any:
        """The call that makes an array, NotImplemented for all else."""
        if isinstance(value, np.ndarray):
            return np.ndarray, (value.shape, value.dtype.str, bytearray(value.tobytes()))
        return NotImplemented


def write_gmr(motion: Motion, stream: IO[bytes]) -> None:
    """Write GMR's pickle. This program reads no pickle, because that may run any code."""
    names = {"link_body_list": list(links_of(motion).names), "joint_names": list(motion.joint_names)}
    kept = {"fps": motion.rate_hz, **gmr_arrays(motion), **names, "quaternion_order": "xyzw"}
    _AnyNumpy(stream, protocol=4).dump(kept)


def write_gmr_npz(motion: Motion, stream: IO[bytes]) -> None:
    """Write the keys of GMR's pickle as an NPZ, which is safe to read."""
    names = {"link_body_list": np.array(links_of(motion).names), "joint_names": np.array(motion.joint_names)}
    order, fps = np.array("xyzw"), np.array(motion.rate_hz)
    np.savez(stream, allow_pickle=False, fps=fps, **gmr_arrays(motion), **names, quaternion_order=order)


CSV_DECIMALS = 9
"""Decimals of a number in CSV: 1 nm."""
BONES_ROOT = tuple(f"root_{kind}{axis}" for kind in ("translate", "rotate") for axis in "XYZ")


def write_unitree(motion: Motion, stream: IO[bytes]) -> None:
    """Write rows x y z, quaternion **xyzw**, joints, without a header."""
    _fps(motion)  # the file says no times
    root = sign_aligned(motion.root_quaternion)[:, XYZW]
    np.savetxt(stream, np.hstack([motion.root_position, root, motion.joints]), fmt=f"%.{CSV_DECIMALS}f", delimiter=",")


def write_bones(motion: Motion, stream: IO[bytes]) -> None:
    """Write Frame, root_translateX/Y/Z (**cm**), root_rotateX/Y/Z (**degrees**, about the fixed axes x, then y, then
    z), and <joint>_dof (**degrees**, cm for a slide)."""
    _fps(motion)  # the file says no times
    # Rotations about fixed axes x, y, z are those about moving axes z, y, x.
    turned = np.unwrap(to_euler(motion.root_quaternion, "zyx")[:, ::-1], axis=0)
    scale = np.array([CM if unit == "m" else np.rad2deg(1.0) for unit in motion.joint_units])
    values = np.hstack([CM * motion.root_position, np.rad2deg(turned), scale * motion.joints])
    header = ["Frame", *BONES_ROOT]
    header += [f"{name}_dof" for name in motion.joint_names]
    rows = np.column_stack([np.arange(len(motion)), values])
    fmt = ["%d", *[f"%.{CSV_DECIMALS}f"] * values.shape[1]]
    np.savetxt(stream, rows, fmt=fmt, delimiter=",", header=",".join(header), comments="")


def sonic_files(motion: Motion) -> dict[str, bytes]:
    """The files of SONIC's deployment for one motion, by name, each CSV with a header.

    joint_pos.csv and joint_vel.csv (T, n): breadth first; body_pos.csv (T, 3), body_quat.csv (T, 4) **wxyz**,
    body_lin_vel.csv and body_ang_vel.csv (T, 3) of the root. info.txt is for people.
    """
    rate, (_, order) = motion.rate_hz, breadth_first(motion.body)
    root, names = sign_aligned(motion.root_quaternion), [motion.joint_names[joint] for joint in order]
    tables: dict[str, tuple[list[str], FloatArray]] = {
        "joint_pos": (names, motion.joints[:, order]),
        "joint_vel": (names, rate_of_change(motion.joints, rate)[:, order]),
        "body_pos": ([f"body_0_{axis}" for axis in "xyz"], motion.root_position),
        "body_quat": ([f"body_0_{axis}" for axis in "wxyz"], root),
        "body_lin_vel": ([f"body_0_vel_{axis}" for axis in "xyz"], rate_of_change(motion.root_position, rate)),
        "body_ang_vel": ([f"body_0_angvel_{axis}" for axis in "xyz"], angular_velocity(root, rate)),
    }
    files = {}
    for name, (header, values) in tables.items():
        stream = io.BytesIO()
        np.savetxt(stream, values, fmt=f"%.{CSV_DECIMALS}f", delimiter=",", header=",".join(header), comments="")
        files[f"{name}.csv"] = stream.getvalue()
    title = f"Metadata for: {motion.robot}\n{'=' * 30}\n\n"
    files["metadata.txt"] = f"{title}Body part indexes:\n[0]\n\nTotal timesteps: {len(motion)}\n".encode()
    info = f"rate: {rate:g} Hz\nquaternions: wxyz\njoints, breadth first, rad: {', '.join(names)}\nroot: m\n"
    return files | {"info.txt": info.encode()}
