"""Rotations as unit quaternions, wxyz: vectorised over leading axes, and of a single instant on tuples of floats.

Quaternions have shape (..., 4), vectors (..., 3), matrices (..., 3, 3); leading axes are broadcast. Angles are radians.
v_parent = rotate(q_parent_child, v_child). NaN in, NaN out; no errors are raised for values.

`scipy.spatial.transform` is not used: it takes 0.4 s to import, and its bits differ between machines.
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
"""Tolerance of the norm of a quaternion from outside, which is rounded."""

_SMALL_ANGLE = 1e-8
"""Below this angle (rad) sin(x)/x is 1 to double precision."""

_SQUARINGS = 40
"""Squarings of a matrix after which its power, 2^40, has only its largest eigenvalue left, to rounding."""


def multiply(a: ArrayLike, b: ArrayLike) -> FloatArray:
    """Hamilton product a b (..., 4): the rotation b followed by the rotation a."""
    return quat_multiply(np.asarray(a, float), np.asarray(b, float))


def conjugate(q: ArrayLike) -> FloatArray:
    """Inverse of unit quaternions."""
    return np.asarray(np.asarray(q, float) * np.array([1.0, -1.0, -1.0, -1.0]))


def normalise(q: ArrayLike) -> FloatArray:
    """Unit quaternions; NaN for a norm of zero."""
    q = np.asarray(q, float)
    norm = norms(q)[..., None]
    return q / np.where(norm > 0.0, norm, np.nan)


def rotate(q: ArrayLike, v: ArrayLike) -> FloatArray:
    """Vectors v turned by unit quaternions q: v + 2 w (u x v) + 2 u x (u x v)."""
    return quat_rotate(np.asarray(q, float), np.asarray(v, float))


def to_matrix(q: ArrayLike) -> FloatArray:
    """Rotation matrices of unit quaternions."""
    w, x, y, z = np.moveaxis(np.asarray(q, float), -1, 0)
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


def from_matrix(matrix: ArrayLike) -> FloatArray:
    """Unit quaternions with w >= 0 of rotation matrices (Shepperd's method: the largest pivot)."""
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
    """Unit quaternions of rotation vectors (axis times angle in rad), the exponential map."""
    vector = np.asarray(vector, float)
    half = 0.5 * norms(vector)[..., None]
    near = half < _SMALL_ANGLE
    return _join(cos(half), 0.5 * np.where(near, 1.0, sin(half) / np.where(near, 1.0, half)) * vector)


def from_axis_angle(axis: ArrayLike, angle: ArrayLike) -> FloatArray:
    """Unit quaternions of turns by `angle` (...) rad about unit axes."""
    half = 0.5 * np.asarray(angle, float)[..., None]
    axis = np.asarray(axis, float)
    return _join(cos(half), sin(half) * axis)


def _join(w: FloatArray, xyz: FloatArray) -> FloatArray:
    """Quaternions of scalar parts (..., 1) and vector parts."""
    out = np.empty((*np.broadcast_shapes(w.shape[:-1], xyz.shape[:-1]), 4))
    out[..., :1] = w
    out[..., 1:] = xyz
    return out


def log(q: ArrayLike) -> FloatArray:
    """Rotation vectors of unit quaternions, with a norm of at most pi."""
    q = np.asarray(q, float)
    q = np.where(q[..., :1] < 0.0, -q, q)
    sine = norms(q[..., 1:])[..., None]
    angle = 2.0 * arctan2(sine, q[..., :1])
    scale = np.where(sine > _SMALL_ANGLE, angle / np.where(sine > _SMALL_ANGLE, sine, 1.0), 2.0)
    return scale * q[..., 1:]


def angle_between(a: ArrayLike, b: ArrayLike) -> FloatArray:
    """Angle (...), 0 to pi, of the turn from a to b."""
    relative = multiply(conjugate(a), b)
    return np.asarray(2.0 * arctan2(norms(relative[..., 1:]), np.abs(relative[..., 0])))


def slerp(a: ArrayLike, b: ArrayLike, share: ArrayLike) -> FloatArray:
    """Unit quaternions on the short arc from a (share 0) to b (share 1); `share` has shape (...)."""
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
    """Unit quaternions q_1 q_2 ... q_n of rotations by angles (..., n), each about an axis already turned.

    axes: n letters of "xyz" in any case (or their indices), in the channel order of a BVH file.
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
    """Angles (..., 3) for three different axes, the inverse of `from_euler` up to the sign of q.

    The middle angle lies in [-pi/2, pi/2]; within 1e-7 of either end the last angle is 0 (gimbal lock).
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
    """The smallest turns from directions a to b, of any lengths but 0."""
    a, b = _unit(a), _unit(b)
    cross = np.cross(a, b)
    w = 1.0 + np.sum(a * b, axis=-1, keepdims=True)
    opposite = w < 1e-12
    # The cross product with the least parallel coordinate axis is well conditioned.
    across = np.cross(a, np.eye(3)[np.argmin(np.abs(a), axis=-1)])
    return normalise(np.concatenate([np.where(opposite, 0.0, w), np.where(opposite, across, cross)], axis=-1))


def best_turn(points: ArrayLike, goals: ArrayLike) -> FloatArray:
    """The rotation (4,) that turns points (k, 3) about their mean nearest to goals (k, 3) about theirs.

    Source: Horn, "Closed-form solution of absolute orientation using unit quaternions", 1987: the eigenvector of the
    largest eigenvalue of a symmetric matrix.
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
    """Indices 0, 1, 2 of letters "xyz", or the indices given. Raises ValueError."""
    indices = ["xyz".find(letter) for letter in axes.lower()] if isinstance(axes, str) else list(axes)
    if not set(indices) <= {0, 1, 2}:
        raise ValueError(f"unknown axis in {axes!r}: use x, y and z")
    return indices


# Rotations of a single instant, on tuples of floats: ten times quicker than NumPy. Quaternions are wxyz and unit.

Vector = tuple[float, float, float]
Quat = tuple[float, float, float, float]
NO_TURN: Quat = (1.0, 0.0, 0.0, 0.0)
"""The quaternion of no rotation."""


def as_vector(array: FloatArray) -> Vector:
    """An array (3,) as a vector."""
    x, y, z = array.tolist()
    return x, y, z


def as_quat(array: FloatArray) -> Quat:
    """An array (4,) as a quaternion."""
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
    """The rotation of a rotation vector."""
    x, y, z = vector
    angle = length(vector)
    if angle < 1e-12:
        return (1.0, 0.5 * x, 0.5 * y, 0.5 * z)
    return axis_turn((x / angle, y / angle, z / angle), angle)


def rotation_vector(q: Quat) -> Vector:
    """The rotation vector of a rotation, of at most pi."""
    w, x, y, z = q if q[0] >= 0.0 else (-q[0], -q[1], -q[2], -q[3])
    sine = length((x, y, z))
    scale = 2.0 * arctan2(sine, w) / sine if sine > 1e-12 else 2.0
    return (scale * x, scale * y, scale * z)


def arc(a: Vector, b: Vector) -> Quat:
    """The smallest rotation that takes direction a to direction b, as `shortest_arc`."""
    ax, ay, az = a
    bx, by, bz = b
    cross = (ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx)
    w = sqrt((ax * ax + ay * ay + az * az) * (bx * bx + by * by + bz * bz)) + ax * bx + ay * by + az * bz
    norm = sqrt(w * w + cross[0] * cross[0] + cross[1] * cross[1] + cross[2] * cross[2])
    if norm < 1e-12 * (1.0 + w):
        across = hypot(ax, ay)
        return (0.0, -ay / across, ax / across, 0.0) if across > 0.0 else (0.0, 1.0, 0.0, 0.0)
    return (w / norm, cross[0] / norm, cross[1] / norm, cross[2] / norm)
