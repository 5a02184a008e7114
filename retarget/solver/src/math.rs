//! Small fixed-size vector, quaternion (wxyz) and matrix functions.

pub type Vec3 = [f64; 3];
pub type Quat = [f64; 4];
/// Row-major rotation matrix: `m[r][c]`.
pub type Mat3 = [[f64; 3]; 3];

/// No rotation.
pub const IDENTITY: Mat3 = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];

#[inline(always)]
pub fn add(a: Vec3, b: Vec3) -> Vec3 {
    [a[0] + b[0], a[1] + b[1], a[2] + b[2]]
}

#[inline(always)]
pub fn sub(a: Vec3, b: Vec3) -> Vec3 {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}

#[inline(always)]
pub fn scale(a: Vec3, s: f64) -> Vec3 {
    [a[0] * s, a[1] * s, a[2] * s]
}

#[inline(always)]
pub fn dot(a: Vec3, b: Vec3) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

#[inline(always)]
pub fn cross(a: Vec3, b: Vec3) -> Vec3 {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

#[inline(always)]
pub fn square(x: f64) -> f64 {
    x * x
}

#[inline(always)]
pub fn norm(a: Vec3) -> f64 {
    dot(a, a).sqrt()
}

/// Unit vector, or `fallback` when `a` is (nearly) zero.
#[inline]
pub fn unit_or(a: Vec3, fallback: Vec3) -> Vec3 {
    let n = norm(a);
    if n > 1e-12 {
        scale(a, 1.0 / n)
    } else {
        fallback
    }
}

/// The part of `a` that is across the unit vector `axis`. A small part is exact to the last digits, too.
#[inline(always)]
pub fn across(a: Vec3, axis: Vec3) -> Vec3 {
    cross(cross(axis, a), axis)
}

/// Any unit vector perpendicular to the unit vector `a`.
#[inline]
pub fn perpendicular(a: Vec3) -> Vec3 {
    let e = if a[0].abs() < 0.6 { [1.0, 0.0, 0.0] } else { [0.0, 1.0, 0.0] };
    unit_or(cross(a, e), [0.0, 0.0, 1.0])
}

#[inline(always)]
pub fn quat_mul(a: Quat, b: Quat) -> Quat {
    [
        a[0] * b[0] - a[1] * b[1] - a[2] * b[2] - a[3] * b[3],
        a[0] * b[1] + a[1] * b[0] + a[2] * b[3] - a[3] * b[2],
        a[0] * b[2] - a[1] * b[3] + a[2] * b[0] + a[3] * b[1],
        a[0] * b[3] + a[1] * b[2] - a[2] * b[1] + a[3] * b[0],
    ]
}

#[inline(always)]
pub fn quat_conj(a: Quat) -> Quat {
    [a[0], -a[1], -a[2], -a[3]]
}

/// Unit quaternion; the identity when `a` is zero or not finite.
#[inline]
pub fn quat_unit(a: Quat) -> Quat {
    let n2 = a[0] * a[0] + a[1] * a[1] + a[2] * a[2] + a[3] * a[3];
    if n2.is_finite() && n2 > 1e-24 {
        let s = 1.0 / n2.sqrt();
        [a[0] * s, a[1] * s, a[2] * s, a[3] * s]
    } else {
        [1.0, 0.0, 0.0, 0.0]
    }
}

/// Rotation by the vector `v` (axis times angle, rad).
#[inline]
pub fn quat_exp(v: Vec3) -> Quat {
    let angle = norm(v);
    if angle < 1e-12 {
        return quat_unit([1.0, 0.5 * v[0], 0.5 * v[1], 0.5 * v[2]]);
    }
    let (s, c) = libm::sincos(0.5 * angle);
    let k = s / angle;
    [c, v[0] * k, v[1] * k, v[2] * k]
}

/// Rotation by `angle` about the unit vector `axis`.
#[inline(always)]
pub fn quat_axis_angle(axis: Vec3, angle: f64) -> Quat {
    let (s, c) = libm::sincos(0.5 * angle);
    [c, axis[0] * s, axis[1] * s, axis[2] * s]
}

/// Rotation vector of the unit quaternion `a`, of angle at most pi.
#[inline]
pub fn quat_log(a: Quat) -> Vec3 {
    let a = if a[0] < 0.0 { [-a[0], -a[1], -a[2], -a[3]] } else { a };
    let s = (a[1] * a[1] + a[2] * a[2] + a[3] * a[3]).sqrt();
    if s < 1e-12 {
        return [2.0 * a[1], 2.0 * a[2], 2.0 * a[3]];
    }
    let k = 2.0 * libm::atan2(s, a[0]) / s;
    [a[1] * k, a[2] * k, a[3] * k]
}

#[inline(always)]
pub fn quat_to_mat(q: Quat) -> Mat3 {
    let [w, x, y, z] = q;
    [
        [w * w + x * x - y * y - z * z, 2.0 * (x * y - w * z), 2.0 * (x * z + w * y)],
        [2.0 * (x * y + w * z), w * w - x * x + y * y - z * z, 2.0 * (y * z - w * x)],
        [2.0 * (x * z - w * y), 2.0 * (y * z + w * x), w * w - x * x - y * y + z * z],
    ]
}

#[inline(always)]
pub fn mat_vec(m: &Mat3, v: Vec3) -> Vec3 {
    [dot(m[0], v), dot(m[1], v), dot(m[2], v)]
}

/// Transposed matrix times `v`: into the frame of a rotation matrix.
#[inline(always)]
pub fn mat_t_vec(m: &Mat3, v: Vec3) -> Vec3 {
    [
        m[0][0] * v[0] + m[1][0] * v[1] + m[2][0] * v[2],
        m[0][1] * v[0] + m[1][1] * v[1] + m[2][1] * v[2],
        m[0][2] * v[0] + m[1][2] * v[1] + m[2][2] * v[2],
    ]
}

/// `a + s b`
#[inline(always)]
pub fn add_scaled(a: Vec3, b: Vec3, s: f64) -> Vec3 {
    [a[0] + s * b[0], a[1] + s * b[1], a[2] + s * b[2]]
}

/// Column `c` of a rotation matrix.
#[inline(always)]
pub fn column(m: &Mat3, c: usize) -> Vec3 {
    [m[0][c], m[1][c], m[2][c]]
}

/// Rotation matrix product `a b`.
#[inline(always)]
pub fn mat_mul(a: &Mat3, b: &Mat3) -> Mat3 {
    let mut m = [[0.0; 3]; 3];
    for (row, a_row) in m.iter_mut().zip(a) {
        for (c, value) in row.iter_mut().enumerate() {
            *value = a_row[0] * b[0][c] + a_row[1] * b[1][c] + a_row[2] * b[2][c];
        }
    }
    m
}
