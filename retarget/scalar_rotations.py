"""Rotations of a single instant, on tuples of floats: ten times quicker there than NumPy, which `rotations` is for.

Quaternions are wxyz and unit, vectors xyz.
"""

from math import atan2, cos, hypot, sin, sqrt

__all__ = [
    "Quat",
    "Vector",
    "arc",
    "axis_turn",
    "inverse",
    "minus",
    "plus",
    "product",
    "rotated",
    "rotation_vector",
    "turn",
]

Vector = tuple[float, float, float]
Quat = tuple[float, float, float, float]


def minus(a: Vector, b: Vector) -> Vector:
    """The vector from b to a."""
    return (a[0] - b[0], a[1] - b[1], a[2] - b[2])


def plus(a: Vector, b: Vector) -> Vector:
    """The sum."""
    return (a[0] + b[0], a[1] + b[1], a[2] + b[2])


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
    """The rotation back."""
    w, x, y, z = q
    return (w, -x, -y, -z)


def rotated(q: Quat, v: Vector) -> Vector:
    """The vector turned."""
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
    angle = sqrt(x * x + y * y + z * z)
    if angle < 1e-12:
        return (1.0, 0.5 * x, 0.5 * y, 0.5 * z)
    return axis_turn((x / angle, y / angle, z / angle), angle)


def rotation_vector(q: Quat) -> Vector:
    """The rotation vector of a rotation, the short way round."""
    w, x, y, z = q if q[0] >= 0.0 else (-q[0], -q[1], -q[2], -q[3])
    sine = sqrt(x * x + y * y + z * z)
    scale = 2.0 * atan2(sine, w) / sine if sine > 1e-12 else 2.0
    return (scale * x, scale * y, scale * z)


def arc(a: Vector, b: Vector) -> Quat:
    """The smallest rotation that takes direction a to direction b; lengths do not matter. Opposite: about any axis."""
    ax, ay, az = a
    bx, by, bz = b
    cross = (ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx)
    w = sqrt((ax * ax + ay * ay + az * az) * (bx * bx + by * by + bz * bz)) + ax * bx + ay * by + az * bz
    norm = sqrt(w * w + cross[0] ** 2 + cross[1] ** 2 + cross[2] ** 2)
    if norm < 1e-12 * (1.0 + w):
        across = hypot(ax, ay)
        return (0.0, -ay / across, ax / across, 0.0) if across > 0.0 else (0.0, 1.0, 0.0, 0.0)
    return (w / norm, cross[0] / norm, cross[1] / norm, cross[2] / norm)
