"""Rotations as unit quaternions, wxyz: vectorised over leading axes, and of a single instant on tuples of floats.

Every function takes arrays of shape (..., 4) for quaternions, (..., 3) for vectors and (..., 3, 3) for matrices,
broadcasts the leading axes and returns float64. Angles are radians. `rotate(q, v)` maps from the frame that q describes
to the frame it is described in: v_parent = rotate(q_parent_child, v_child). NaN in, NaN out; no errors are raised for
values.

Small on purpose: `scipy.spatial.transform` takes 0.4 s to import, longer than the whole start-up of the command line.
"""

from collections.abc import Sequence
from math import sqrt

import numpy as np
from numpy.typing import ArrayLike

from retarget._solver import quat_multiply, quat_rotate
from retarget.arithmetic import arcsin, arctan2, cos, hypot, matmul, norms, sin
from retarget.types import FloatArray

IDENTITY: FloatArray = np.array([1.0, 0.0, 0.0, 0.0])  # wxyz: no rotation
IDENTITY.flags.writeable = False
NORM_TOLERANCE = 0.02
"""A quaternion from outside whose norm is farther from 1 is no rounded rotation but something else."""

_SMALL_ANGLE = 1e-8
"""Below this angle (rad) sin(x)/x is 1 to double precision, and its quotient is not taken."""


_SQUARINGS = 40
"""Of a matrix: its power 2^40 has nothing left but its largest eigenvalue, to rounding."""


def multiply(a: ArrayLike, b: ArrayLike) -> FloatArray:
    """Hamilton product a b (..., 4): the rotation b followed by the rotation a, seen in a's parent frame."""
    return quat_multiply(np.asarray(a, float), np.asarray(b, float))


def conjugate(q: ArrayLike) -> FloatArray:
    """Inverse of a unit quaternion (..., 4)."""
    return np.asarray(np.asarray(q, float) * np.array([1.0, -1.0, -1.0, -1.0]))


def normalise(q: ArrayLike) -> FloatArray:
    """Unit quaternion (..., 4) of the same direction; NaN where the norm is zero."""
    q = np.asarray(q, float)
    norm = norms(q)[..., None]
    return q / np.where(norm > 0.0, norm, np.nan)


def rotate(q: ArrayLike, v: ArrayLike) -> FloatArray:
    """Vectors v (..., 3) turned by unit quaternions q (..., 4): v + 2 w (u x v) + 2 u x (u x v)."""
    return quat_rotate(np.asarray(q, float), np.asarray(v, float))


def to_matrix(q: ArrayLike) -> FloatArray:
    """Rotation matrices (..., 3, 3) of unit quaternions (..., 4)."""
    w, x, y, z = np.moveaxis(np.asarray(q, float), -1, 0)
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


def from_matrix(matrix: ArrayLike) -> FloatArray:
    """Unit quaternions (..., 4) with w >= 0 of rotation matrices (..., 3, 3).

    Four candidates, one for each component taken as the pivot; the one with the largest pivot is kept, so that no
    quotient is near-singular (Shepperd's method).
    """
    m = np.asarray(matrix, float)
    m00, m11, m22 = m[..., 0, 0], m[..., 1, 1], m[..., 2, 2]
    a, b, c = (
        m[..., 2, 1] - m[..., 1, 2],
        m[..., 0, 2] - m[..., 2, 0],
        m[..., 1, 0] - m[..., 0, 1],
    )
    d, e, f = (
        m[..., 1, 0] + m[..., 0, 1],
        m[..., 0, 2] + m[..., 2, 0],
        m[..., 2, 1] + m[..., 1, 2],
    )
    candidates = np.stack(
        [
            np.stack([1 + m00 + m11 + m22, a, b, c], axis=-1),
            np.stack([a, 1 + m00 - m11 - m22, d, e], axis=-1),
            np.stack([b, d, 1 - m00 + m11 - m22, f], axis=-1),
            np.stack([c, e, f, 1 - m00 - m11 + m22], axis=-1),
        ],
        axis=-2,
    )
    pivots = np.stack([candidates[..., i, i] for i in range(4)], axis=-1)
    best = np.argmax(pivots, axis=-1)
    q = np.take_along_axis(candidates, best[..., None, None], axis=-2)[..., 0, :]
    return normalise(np.where(q[..., :1] < 0.0, -q, q))


def from_rotation_vector(vector: ArrayLike) -> FloatArray:
    """Exponential map: unit quaternions (..., 4) of rotation vectors (..., 3) (axis times angle in rad)."""
    vector = np.asarray(vector, float)
    half = 0.5 * norms(vector)[..., None]
    near = half < _SMALL_ANGLE
    return _join(cos(half), 0.5 * np.where(near, 1.0, sin(half) / np.where(near, 1.0, half)) * vector)


def from_axis_angle(axis: ArrayLike, angle: ArrayLike) -> FloatArray:
    """Unit quaternions (..., 4) of turns by `angle` (...) rad about unit axes (..., 3)."""
    half = 0.5 * np.asarray(angle, float)[..., None]
    axis = np.asarray(axis, float)
    return _join(cos(half), sin(half) * axis)


def _join(w: FloatArray, xyz: FloatArray) -> FloatArray:
    """Quaternion (..., 4) of a scalar part (..., 1) and a vector part (..., 3), leading axes broadcast."""
    out = np.empty((*np.broadcast_shapes(w.shape[:-1], xyz.shape[:-1]), 4))
    out[..., :1] = w
    out[..., 1:] = xyz
    return out


def log(q: ArrayLike) -> FloatArray:
    """Rotation vectors (..., 3) of unit quaternions (..., 4), the short way round: norm at most pi."""
    q = np.asarray(q, float)
    q = np.where(q[..., :1] < 0.0, -q, q)
    sine = norms(q[..., 1:])[..., None]
    angle = 2.0 * arctan2(sine, q[..., :1])
    scale = np.where(sine > _SMALL_ANGLE, angle / np.where(sine > _SMALL_ANGLE, sine, 1.0), 2.0)
    return scale * q[..., 1:]


def angle_between(a: ArrayLike, b: ArrayLike) -> FloatArray:
    """Angle (...) in rad, 0 to pi, of the turn from a to b (..., 4)."""
    relative = multiply(conjugate(a), b)
    return np.asarray(2.0 * arctan2(norms(relative[..., 1:]), np.abs(relative[..., 0])))


def slerp(a: ArrayLike, b: ArrayLike, share: ArrayLike) -> FloatArray:
    """Unit quaternions (..., 4) on the short arc from a (share 0) to b (share 1); `share` has shape (...).

    Exactly opposite orientations (180 degrees apart) have no short arc: one of the two is taken.
    """
    a, b, share = (
        np.asarray(a, float),
        np.asarray(b, float),
        np.asarray(share, float)[..., None],
    )
    cosine = np.sum(a * b, axis=-1, keepdims=True)
    b = np.where(cosine < 0.0, -b, b)
    angle = arctan2(norms(b - a * np.abs(cosine))[..., None], np.abs(cosine))
    sine = sin(angle)
    near = sine < _SMALL_ANGLE
    safe = np.where(near, 1.0, sine)
    weight_a = np.where(near, 1.0 - share, sin((1.0 - share) * angle) / safe)
    weight_b = np.where(near, share, sin(share * angle) / safe)
    return normalise(weight_a * a + weight_b * b)


def from_euler(angles: ArrayLike, axes: str | Sequence[int]) -> FloatArray:
    """Unit quaternions (..., 4) of rotations about the axes in the order listed, each about the axis already turned.

    angles: (..., n) rad. axes: n letters of "xyz" in any case and order (or their indices): q = q_1 q_2 ... q_n, which
    is the channel order of a BVH file. For angles applied one after the other about fixed axes, reverse the list.
    """
    angles = np.asarray(angles, float)
    if angles.shape[-1] != len(axes):
        raise ValueError(f"{angles.shape[-1]} angles for {len(axes)} axes")
    half = 0.5 * angles
    cosine, sine = cos(half), sin(half)
    total = np.broadcast_to(IDENTITY, (*angles.shape[:-1], 4))
    for i, axis in enumerate(_axis_indices(axes)):
        turn = np.zeros((*angles.shape[:-1], 4))
        turn[..., 0] = cosine[..., i]
        turn[..., 1 + axis] = sine[..., i]
        total = turn if i == 0 else multiply(total, turn)
    return np.array(total)


def to_euler(q: ArrayLike, axes: str | Sequence[int]) -> FloatArray:
    """Angles (..., 3) rad of unit quaternions (..., 4) for three axes, so that `from_euler` gives q (or -q) back.

    axes: three different letters of "xyz" (or indices). The middle angle lies in [-pi/2, pi/2]; where it is within 1e-7
    of either end the last angle is 0 (gimbal lock).
    """
    i, j, k = _axis_indices(axes)
    if len({i, j, k}) != 3:
        raise ValueError(f"three different axes are needed, not {axes!r}")
    sign = 1.0 if (j - i) % 3 == 1 else -1.0
    m = to_matrix(q)
    middle_sine = np.clip(sign * m[..., i, k], -1.0, 1.0)
    first = arctan2(-sign * m[..., j, k], m[..., k, k])
    last = arctan2(-sign * m[..., i, j], m[..., i, i])
    locked = np.abs(middle_sine) > 1.0 - 1e-14
    first = np.where(locked, arctan2(sign * m[..., k, j], m[..., j, j]), first)
    return np.stack([first, arcsin(middle_sine), np.where(locked, 0.0, last)], axis=-1)


def shortest_arc(a: ArrayLike, b: ArrayLike) -> FloatArray:
    """The smallest turn (..., 4) wxyz that takes direction a (..., 3) to direction b (..., 3); lengths do not matter.

    Opposite directions turn about any axis across them; a zero vector gives NaN.
    """
    a, b = _unit(a), _unit(b)
    cross = np.cross(a, b)
    w = 1.0 + np.sum(a * b, axis=-1, keepdims=True)
    opposite = w < 1e-12
    # Any axis across a: cross it with the coordinate axis that it leans to least.
    across = np.cross(a, np.eye(3)[np.argmin(np.abs(a), axis=-1)])
    return normalise(np.concatenate([np.where(opposite, 0.0, w), np.where(opposite, across, cross)], axis=-1))


def best_turn(points: ArrayLike, goals: ArrayLike) -> FloatArray:
    """The rotation wxyz (4,) that turns points (k, 3) about their mean so that they are nearest to goals (k, 3) about
    theirs, by least squares. Of two that are equally good, either.

    Source: Horn, "Closed-form solution of absolute orientation using unit quaternions", 1987: the eigenvector of the
    largest eigenvalue of a symmetric matrix. Its rows are those of the sum of b a' over the points.
    """
    a, b = np.asarray(points, float), np.asarray(goals, float)
    (xx, xy, xz), (yx, yy, yz), (zx, zy, zz) = matmul((a - a.mean(axis=0)).T, b - b.mean(axis=0)).tolist()
    power = np.array(
        [
            [xx + yy + zz, yz - zy, zx - xz, xy - yx],
            [yz - zy, xx - yy - zz, xy + yx, zx + xz],
            [zx - xz, xy + yx, yy - xx - zz, yz + zy],
            [xy - yx, zx + xz, yz + zy, zz - xx - yy],
        ]
    )
    power += (np.abs(power).sum() + 1e-300) * np.eye(4)  # now no eigenvalue is negative
    for _ in range(_SQUARINGS):
        power = matmul(power, power)
        power /= np.abs(power).max()
    return normalise(power[:, int(np.abs(power).sum(axis=0).argmax())])


def _unit(v: ArrayLike) -> FloatArray:
    v = np.asarray(v, float)
    norm = norms(v)[..., None]
    return np.asarray(v / np.where(norm > 0.0, norm, np.nan))


def _axis_indices(axes: str | Sequence[int]) -> list[int]:
    """Indices 0, 1, 2 of letters "xyz" in any case, or the indices given."""
    indices = ["xyz".find(letter) for letter in axes.lower()] if isinstance(axes, str) else list(axes)
    if not set(indices) <= {0, 1, 2}:
        raise ValueError(f"unknown axis in {axes!r}: use x, y and z")
    return indices


# Rotations of a single instant, on tuples of floats: ten times quicker there than NumPy, which `rotations` is for.
#
# Quaternions are wxyz and unit, vectors xyz.

Vector = tuple[float, float, float]
Quat = tuple[float, float, float, float]
NO_TURN: Quat = (1.0, 0.0, 0.0, 0.0)
"""The quaternion of no rotation."""


def as_vector(array: FloatArray) -> Vector:
    """Return an array (3,) as a vector."""
    x, y, z = array.tolist()
    return x, y, z


def as_quat(array: FloatArray) -> Quat:
    """Return an array (4,) as a quaternion."""
    w, x, y, z = array.tolist()
    return w, x, y, z


def minus(a: Vector, b: Vector) -> Vector:
    """The vector from b to a."""
    return (a[0] - b[0], a[1] - b[1], a[2] - b[2])


def plus(a: Vector, b: Vector) -> Vector:
    """Sum of two vectors."""
    return (a[0] + b[0], a[1] + b[1], a[2] + b[2])


def length(v: Vector) -> float:
    """Length of a vector."""
    x, y, z = v
    return sqrt(x * x + y * y + z * z)


def product(a: Quat, b: Quat) -> Quat:
    """The rotation b followed by the rotation a."""
    aw, ax, ay, az = a
    bw, bx, by, bz = b
    return (
        aw * bw - ax * bx - ay * by - az * bz,
        aw * bx + ax * bw + ay * bz - az * by,
        aw * by - ax * bz + ay * bw + az * bx,
        aw * bz + ax * by - ay * bx + az * bw,
    )


def inverse(q: Quat) -> Quat:
    """Inverse of a unit quaternion wxyz."""
    w, x, y, z = q
    return (w, -x, -y, -z)


def rotated(q: Quat, v: Vector) -> Vector:
    """Rotate a vector by a unit quaternion wxyz."""
    w, x, y, z = q
    vx, vy, vz = v
    tx, ty, tz = 2.0 * (y * vz - z * vy), 2.0 * (z * vx - x * vz), 2.0 * (x * vy - y * vx)
    return (vx + w * tx + y * tz - z * ty, vy + w * ty + z * tx - x * tz, vz + w * tz + x * ty - y * tx)


def axis_turn(axis: Vector, angle: float) -> Quat:
    """A turn by `angle` rad about a unit axis."""
    x, y, z = axis
    s = sin(0.5 * angle)
    return (cos(0.5 * angle), s * x, s * y, s * z)


def turn(vector: Vector) -> Quat:
    """The rotation of a rotation vector (axis times rad)."""
    x, y, z = vector
    angle = length(vector)
    if angle < 1e-12:
        return (1.0, 0.5 * x, 0.5 * y, 0.5 * z)
    return axis_turn((x / angle, y / angle, z / angle), angle)


def rotation_vector(q: Quat) -> Vector:
    """The rotation vector of a rotation, the short way round."""
    w, x, y, z = q if q[0] >= 0.0 else (-q[0], -q[1], -q[2], -q[3])
    sine = length((x, y, z))
    scale = 2.0 * arctan2(sine, w) / sine if sine > 1e-12 else 2.0
    return (scale * x, scale * y, scale * z)


def arc(a: Vector, b: Vector) -> Quat:
    """The smallest rotation that takes direction a to direction b; lengths do not matter. Opposite: about any axis."""
    ax, ay, az = a
    bx, by, bz = b
    cross = (ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx)
    w = sqrt((ax * ax + ay * ay + az * az) * (bx * bx + by * by + bz * bz)) + ax * bx + ay * by + az * bz
    norm = sqrt(w * w + cross[0] * cross[0] + cross[1] * cross[1] + cross[2] * cross[2])
    if norm < 1e-12 * (1.0 + w):
        across = hypot(ax, ay)
        return (0.0, -ay / across, ax / across, 0.0) if across > 0.0 else (0.0, 1.0, 0.0, 0.0)
    return (w / norm, cross[0] / norm, cross[1] / norm, cross[2] / norm)
