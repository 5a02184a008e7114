"""Which way is up, left and forward in a motion file, from the body itself."""

from dataclasses import dataclass

import numpy as np

from retarget.rotations import FloatArray

__all__ = ["REST_AXES_ERROR", "Axes", "rest_axes", "world_axes"]

REST_AXES_ERROR = "the rest pose of the skeleton has no up and left"

UPRIGHT = 0.7
"""Mean share of the line from ankles to head that must lie along an axis before the frames decide what is up."""


@dataclass(frozen=True)
class Axes:
    """Unit vectors (3,) forward, left and up in the axes of the file, right-handed, each along a file axis."""

    forward: FloatArray
    left: FloatArray
    up: FloatArray

    def matrix(self) -> FloatArray:
        """Rotation (3, 3) from file axes to x forward, y left, z up."""
        return np.stack([self.forward, self.left, self.up])

    @staticmethod
    def with_up(up: FloatArray) -> "Axes":
        """World axes of a file with this up axis: the file's axes in their cyclic order (y up: forward z, left x).

        The heading stays as recorded.
        """
        axis = int(np.argmax(np.abs(up)))
        unit = np.eye(3)
        first, second = unit[(axis + 1) % 3], unit[(axis + 2) % 3]
        return Axes(first, second, unit[axis]) if up[axis] > 0 else Axes(second, first, -unit[axis])


def rest_axes(rest: dict[str, FloatArray]) -> Axes | None:
    """Axes of the rest pose: up from hips to head, left from the right hip to the left; None if they coincide."""
    up = _nearest_axis(rest["head"] - 0.5 * (rest["l_hip"] + rest["r_hip"]))
    if up is None:
        return None
    across = sum((rest[f"l_{part}"] - rest[f"r_{part}"] for part in ("hip", "shoulder")), np.zeros(3))
    left = _nearest_axis(across * (up == 0.0))
    return None if left is None else Axes(np.cross(left, up), left, up)


def world_axes(body: Axes, tracks: dict[str, FloatArray]) -> tuple[Axes, tuple[str, ...]]:
    """World axes of a recording, and a note where its frames stand along another axis than its rest pose.

    tracks: canonical joints (T, 3) in file axes. Some exporters write a rest pose with y up and a world with z up:
    there the body stands upright along z all the time, with its feet near z = 0.
    """
    ankles = 0.5 * (tracks["l_ankle"] + tracks["r_ankle"])
    standing = tracks["head"] - ankles
    height = np.linalg.norm(standing, axis=1, keepdims=True)
    direction = np.mean(standing / np.where(height > 0.0, height, 1.0), axis=0)
    axis = int(np.argmax(np.abs(direction)))
    near_ground = abs(float(np.min(ankles[:, axis]))) < 0.3 * float(np.median(height))
    if direction[axis] < UPRIGHT or body.up[axis] > 0.0 or not near_ground:
        return Axes.with_up(body.up), ()
    note = (
        f"the body stands along {'xyz'[axis]} in the frames: taken as the up axis, though the rest pose says otherwise"
    )
    return Axes.with_up(np.eye(3)[axis]), (note,)


def _nearest_axis(direction: FloatArray) -> FloatArray | None:
    """The signed coordinate axis nearest to a direction; None for a zero or non-finite one."""
    if not (np.all(np.isfinite(direction)) and direction.any()):
        return None
    axis = int(np.argmax(np.abs(direction)))
    return np.asarray(np.eye(3)[axis] * np.sign(direction[axis]))
