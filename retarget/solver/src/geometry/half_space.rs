//! Distance of any solid from a half-space.

use super::solid::{Nearest, Shape, Solid};
use crate::math::{across, add_scaled, column, dot, norm, scale, sub, Vec3};

/// Sine of an angle below which a face counts as parallel; within it a point slides over from one end of the face to the other, so
/// that it does not jump. The face is off by a quarter of this times its half size.
pub const PARALLEL: f64 = 1e-9;

/// The sign of `sine`, -1 or 1, and a linear transition in between if the face is parallel.
#[inline(always)]
fn side(sine: f64) -> f64 {
    (sine / PARALLEL).clamp(-1.0, 1.0)
}

/// Height of `a`'s extreme point over its centre in the unit world direction `n`, and that point: the middle of a parallel face.
#[inline(always)]
pub fn extreme(a: &Solid, n: Vec3) -> (f64, Vec3) {
    match a.shape {
        Shape::Capsule { half_length, radius } => {
            let sine = dot(n, a.axis());
            let point = add_scaled(a.position, a.axis(), side(sine) * half_length);
            (half_length * sine.abs() + radius, add_scaled(point, n, radius))
        }
        Shape::Cylinder { half_length, radius } => {
            let axis = a.axis();
            let sine = dot(n, axis);
            let radial = across(n, axis);
            let slope = norm(radial);
            let point = add_scaled(a.position, axis, side(sine) * half_length);
            (half_length * sine.abs() + radius * slope, add_scaled(point, radial, radius / slope.max(PARALLEL)))
        }
        Shape::Box { half } => {
            let (mut height, mut point) = (0.0, a.position);
            for k in 0..3 {
                let axis = column(&a.rotation, k);
                let sine = dot(n, axis);
                height += half[k] * sine.abs();
                point = add_scaled(point, axis, side(sine) * half[k]);
            }
            (height, point)
        }
        Shape::HalfSpace => (0.0, a.position),
    }
}

/// Nearest points of a solid and the half-space `plane`.
pub fn over_half_space(a: &Solid, plane: &Solid) -> Nearest {
    let normal = plane.axis();
    let (depth, point) = extreme(a, scale(normal, -1.0));
    let distance = dot(normal, sub(a.position, plane.position)) - depth;
    Nearest { distance, a: point, b: add_scaled(point, normal, -distance), normal }
}
