//! A capsule (ball, line) and a cylinder.

use super::along::{Knots, Zero};
use super::capsule_box::{NO_DIRECTION, TOUCHING};
use super::contact::{apart, touching};
use super::difference::Difference;

use super::way_out::way_out;
use super::{Nearest, Scratch, Shape, Solid};
use crate::math::{add_scaled, dot, mat_t_vec, mat_vec, norm, sub, Vec3};

/// How far the point p is out of a cylinder, as a vector.
fn excess(p: Vec3, radius: f64, half_length: f64) -> Vec3 {
    let across = (p[0] * p[0] + p[1] * p[1]).sqrt();
    let over = if across > radius { 1.0 - radius / across } else { 0.0 };
    [p[0] * over, p[1] * over, p[2] - p[2].clamp(-half_length, half_length)]
}

/// The zero of a rising slope between two places: regula falsi (Illinois), with a bound on the share kept.
fn refined([mut low, mut high]: [f64; 2], [mut falling, mut rising]: [f64; 2], slope: impl Fn(f64) -> f64) -> f64 {
    let mut kept = 0;
    for _ in 0..60 {
        let middle = low + (high - low) * (falling / (falling - rising)).clamp(1e-3, 0.999);
        let value = slope(middle);
        if value == 0.0 || high - low < 1e-15 {
            return middle;
        }
        if value < 0.0 {
            (low, falling) = (middle, value);
            rising *= if kept == 1 { 0.5 } else { 1.0 };
            kept = 1;
        } else {
            (high, rising) = (middle, value);
            falling *= if kept == -1 { 0.5 } else { 1.0 };
            kept = -1;
        }
    }
    0.5 * (low + high)
}

/// Where the segment p + t axis, |t| <= length, is nearest to the cylinder; the middle, where it is so over a range.
fn nearest_on_segment(p: Vec3, axis: Vec3, length: f64, radius: f64, half_length: f64) -> f64 {
    let mut knots = Knots::new(length);
    knots.insert((half_length - p[2]) / axis[2]);
    knots.insert((-half_length - p[2]) / axis[2]);
    let (a, b) = (axis[0] * axis[0] + axis[1] * axis[1], p[0] * axis[0] + p[1] * axis[1]);
    let c = p[0] * p[0] + p[1] * p[1] - radius * radius;
    let root = (b * b - a * c).sqrt();
    knots.insert((-b - root) / a);
    knots.insert((-b + root) / a);
    let at = |t: f64| excess(add_scaled(p, axis, t), radius, half_length);
    let zero = knots.zero(|t| {
        let out = at(t);
        (dot(axis, out), dot(out, out))
    });
    match zero {
        Zero::At(t) => t,
        Zero::Between(places, slopes) => refined(places, slopes, |t| dot(axis, at(t))),
    }
}

pub fn capsule_cylinder(capsule: &Solid, solid: &Solid, scratch: &mut Scratch) -> Nearest {
    let (Shape::Capsule { half_length, radius }, Shape::Cylinder { half_length: height, radius: wide }) =
        (capsule.shape, solid.shape)
    else {
        unreachable!("called with a capsule and a cylinder");
    };
    let p = mat_t_vec(&solid.rotation, sub(capsule.position, solid.position));
    let axis = mat_t_vec(&solid.rotation, capsule.axis());
    let t = if half_length > 0.0 { nearest_on_segment(p, axis, half_length, wide, height) } else { 0.0 };
    let point = add_scaled(p, axis, t);
    let out = excess(point, wide, height);
    let core_distance = norm(out);
    if core_distance < TOUCHING {
        let best = way_out(&Difference::new(capsule, solid, &solid.rotation));
        if core_distance < NO_DIRECTION || best.gap > core_distance - NO_DIRECTION {
            return touching(capsule, solid, mat_vec(&solid.rotation, best.normal), best.gap - radius, scratch);
        }
    }
    apart(solid, point, out, radius)
}
