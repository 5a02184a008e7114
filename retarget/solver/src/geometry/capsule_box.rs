//! A capsule (ball, line) and a box.

use super::along::{Knots, Zero};
use super::contact::{apart, touching};
use super::difference::Difference;
use super::way_out::flat;
use super::{Nearest, Scratch, Shape, Solid};
use crate::math::{add_scaled, dot, mat_t_vec, mat_vec, norm, sub, Vec3};

/// Below this (m) the direction is taken from faces and edges, not from a difference of points.
pub const TOUCHING: f64 = 1e-8;
/// Below this (m) a difference of points gives no direction.
pub const NO_DIRECTION: f64 = 1e-10;

/// How far the point p is out of the box, along each axis.
fn excess(p: Vec3, half: Vec3) -> Vec3 {
    [p[0] - p[0].clamp(-half[0], half[0]), p[1] - p[1].clamp(-half[1], half[1]), p[2] - p[2].clamp(-half[2], half[2])]
}

/// Where the segment p + t axis, |t| <= length, is nearest to the box; the middle, where it is so over a range.
fn nearest_on_segment(p: Vec3, axis: Vec3, length: f64, half: Vec3) -> f64 {
    let mut knots = Knots::new(length);
    for k in 0..3 {
        let inverse = 1.0 / axis[k];
        knots.insert((half[k] - p[k]) * inverse);
        knots.insert((-half[k] - p[k]) * inverse);
    }
    let zero = knots.zero(|t| {
        let out = excess(add_scaled(p, axis, t), half);
        (dot(axis, out), dot(out, out))
    });
    match zero {
        Zero::At(t) => t,
        // The slope is linear there.
        Zero::Between([low, high], [falling, rising]) => low + (high - low) * (falling / (falling - rising)),
    }
}

pub fn capsule_box(capsule: &Solid, solid: &Solid, scratch: &mut Scratch) -> Nearest {
    let (Shape::Capsule { half_length, radius }, Shape::Box { half }) = (capsule.shape, solid.shape) else {
        unreachable!("called with a capsule and a box");
    };
    let p = mat_t_vec(&solid.rotation, sub(capsule.position, solid.position));
    let axis = mat_t_vec(&solid.rotation, capsule.axis());
    let t = if half_length > 0.0 { nearest_on_segment(p, axis, half_length, half) } else { 0.0 };
    let point = add_scaled(p, axis, t);
    let out = excess(point, half);
    let core_distance = norm(out);
    if core_distance < TOUCHING {
        let best = flat(&Difference::new(capsule, solid, &solid.rotation));
        // A corner or an edge that is all but touched is no facet: its direction is the difference, while there is one.
        if core_distance < NO_DIRECTION || best.gap > core_distance - NO_DIRECTION {
            return touching(capsule, solid, mat_vec(&solid.rotation, best.normal), best.gap - radius, scratch);
        }
    }
    apart(solid, point, out, radius)
}
