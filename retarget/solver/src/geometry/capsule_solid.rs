//! Distance of a capsule (ball, line) from a box or a cylinder. The nearest point of a segment to a convex solid is the zero of a slope
//! that never falls, between knots at which its formula changes.

use super::contact::{apart, meet};
use super::difference::Difference;
use super::half_space::PARALLEL;
use super::penetration::{penetration, refined};
use super::solid::{Nearest, Scratch, Shape, Solid};
use crate::math::{add_scaled, dot, mat_t_vec, mat_vec, norm, sub, Vec3};

/// Places on a segment, in order; its ends are the first and the last.
struct Knots {
    t: [f64; 8],
    count: usize,
    length: f64,
}

/// The zero of the slope.
enum Zero {
    At(f64),
    /// Between two places, with the slopes there: below zero, above zero.
    Between([f64; 2], [f64; 2]),
}

impl Knots {
    /// The knots of a segment from -length to length; room for six more.
    fn new(length: f64) -> Self {
        Self { t: [-length; 8], count: 1, length }
    }

    /// Insert a knot; ignored if it is NaN or not strictly inside.
    fn insert(&mut self, t: f64) {
        if !(t.abs() < self.length) {
            return;
        }
        let mut k = self.count;
        while self.t[k - 1] > t {
            self.t[k] = self.t[k - 1];
            k -= 1;
        }
        self.t[k] = t;
        self.count += 1;
    }

    /// `slope` gives half the derivative of the squared distance, and the squared distance itself. If a whole range is nearest, its middle
    /// is returned.
    #[inline(always)]
    fn zero(mut self, slope: impl Fn(f64) -> (f64, f64)) -> Zero {
        self.t[self.count] = self.length;
        self.count += 1;
        let (mut low, mut falling) = (-self.length, 0.0);
        let mut flat: Option<(f64, f64)> = None;
        for &t in &self.t[..self.count] {
            let (value, squared) = slope(t);
            // The sine of the angle between the segment and the face below it, squared, is value^2 / squared.
            if value * value <= 1e-2 * PARALLEL * PARALLEL * squared {
                flat = Some((flat.map_or(t, |range| range.0), t));
            } else if value < 0.0 {
                (low, falling) = (t, value);
            } else {
                return match flat {
                    Some((first, last)) => Zero::At(0.5 * (first + last)),
                    None if falling < 0.0 => Zero::Between([low, t], [falling, value]),
                    None => Zero::At(t),
                };
            }
        }
        Zero::At(flat.map_or(self.length, |(first, last)| 0.5 * (first + last)))
    }
}

/// Below this (m) the direction is taken from faces and edges, not from a difference of points.
const TOUCHING: f64 = 1e-8;
/// Below this (m) a difference of points gives no direction.
pub const NO_DIRECTION: f64 = 1e-10;

/// Vector from the nearest point of a box to p.
fn out_of_box(p: Vec3, half: Vec3) -> Vec3 {
    [p[0] - p[0].clamp(-half[0], half[0]), p[1] - p[1].clamp(-half[1], half[1]), p[2] - p[2].clamp(-half[2], half[2])]
}

/// Vector from the nearest point of a cylinder to p.
fn out_of_cylinder(p: Vec3, radius: f64, half_length: f64) -> Vec3 {
    let across = (p[0] * p[0] + p[1] * p[1]).sqrt();
    let over = if across > radius { 1.0 - radius / across } else { 0.0 };
    [p[0] * over, p[1] * over, p[2] - p[2].clamp(-half_length, half_length)]
}

/// The t at which the segment p + t axis, |t| <= length, is nearest to a box; the middle of a range.
fn nearest_to_box(p: Vec3, axis: Vec3, length: f64, half: Vec3) -> f64 {
    let mut knots = Knots::new(length);
    for k in 0..3 {
        let inverse = 1.0 / axis[k];
        knots.insert((half[k] - p[k]) * inverse);
        knots.insert((-half[k] - p[k]) * inverse);
    }
    let zero = knots.zero(|t| {
        let out = out_of_box(add_scaled(p, axis, t), half);
        (dot(axis, out), dot(out, out))
    });
    match zero {
        Zero::At(t) => t,
        // The slope is linear there.
        Zero::Between([low, high], [falling, rising]) => low + (high - low) * (falling / (falling - rising)),
    }
}

/// The same for a cylinder.
fn nearest_to_cylinder(p: Vec3, axis: Vec3, length: f64, radius: f64, half_length: f64) -> f64 {
    let mut knots = Knots::new(length);
    knots.insert((half_length - p[2]) / axis[2]);
    knots.insert((-half_length - p[2]) / axis[2]);
    let (a, b) = (axis[0] * axis[0] + axis[1] * axis[1], p[0] * axis[0] + p[1] * axis[1]);
    let c = p[0] * p[0] + p[1] * p[1] - radius * radius;
    let root = (b * b - a * c).sqrt();
    knots.insert((-b - root) / a);
    knots.insert((-b + root) / a);
    let at = |t: f64| out_of_cylinder(add_scaled(p, axis, t), radius, half_length);
    let zero = knots.zero(|t| {
        let out = at(t);
        (dot(axis, out), dot(out, out))
    });
    match zero {
        Zero::At(t) => t,
        Zero::Between(places, slopes) => refined(places, slopes, (1e-3, 1e-15), |t| dot(axis, at(t))),
    }
}

/// Nearest points of a capsule and a box or a cylinder.
pub fn capsule_solid(capsule: &Solid, solid: &Solid, scratch: &mut Scratch) -> Nearest {
    let Shape::Capsule { half_length: length, radius } = capsule.shape else { unreachable!("called with a capsule") };
    let p = mat_t_vec(&solid.rotation, sub(capsule.position, solid.position));
    let axis = mat_t_vec(&solid.rotation, capsule.axis());
    let (point, out) = match solid.shape {
        Shape::Box { half } => {
            let t = if length > 0.0 { nearest_to_box(p, axis, length, half) } else { 0.0 };
            let point = add_scaled(p, axis, t);
            (point, out_of_box(point, half))
        }
        Shape::Cylinder { half_length, radius } => {
            let t = if length > 0.0 { nearest_to_cylinder(p, axis, length, radius, half_length) } else { 0.0 };
            let point = add_scaled(p, axis, t);
            (point, out_of_cylinder(point, radius, half_length))
        }
        _ => unreachable!("called with a box or a cylinder"),
    };
    let core_distance = norm(out);
    if core_distance < TOUCHING {
        let best = penetration(&Difference::new(capsule, solid, &solid.rotation));
        // A corner or an edge is no facet: close to it the difference is the direction, while there is one.
        if core_distance < NO_DIRECTION || best.gap > core_distance - NO_DIRECTION {
            let normal = mat_vec(&solid.rotation, best.normal);
            return meet(capsule, solid, normal, best.gap - radius, scratch).0;
        }
    }
    apart(solid, point, out, radius)
}
