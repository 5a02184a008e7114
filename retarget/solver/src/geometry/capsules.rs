//! Two capsules (balls, lines): nearest points of two segments, in closed form.

use super::solid::{Nearest, Shape, Solid};
use crate::math::{add_scaled, cross, dot, norm, perpendicular, scale, sub, Vec3};

/// Squared sine of the angle below which two segments are parallel.
const PARALLEL: f64 = 1e-20;
/// Below this a distance (m) gives no direction.
const TOUCHING: f64 = 1e-10;

/// A segment about its centre: `axis` is unit.
#[derive(Clone, Copy)]
pub struct Segment {
    pub centre: Vec3,
    pub axis: Vec3,
    pub half_length: f64,
}

impl Segment {
    #[inline(always)]
    pub fn at(&self, t: f64) -> Vec3 {
        add_scaled(self.centre, self.axis, t)
    }

    #[inline(always)]
    fn clamp(&self, t: f64) -> f64 {
        t.clamp(-self.half_length, self.half_length)
    }
}

/// Nearest points of two segments: signed length from the centre of a, distance, unit direction from b to a.
pub struct Crossing {
    pub s: f64,
    pub distance: f64,
    pub normal: Vec3,
}

/// Nearest points of parallel segments: the middle of the range that they share, or the ends that face each other.
#[cold]
#[inline(never)]
fn parallel(a: &Segment, b: &Segment, from: Vec3) -> Crossing {
    let (sign, centre) = (dot(a.axis, b.axis).signum(), -dot(from, a.axis));
    let low = (-a.half_length).max(centre - b.half_length);
    let high = a.half_length.min(centre + b.half_length);
    let middle = 0.5 * (low + high);
    let (s, t) = (a.clamp(middle), b.clamp(sign * (middle - centre)));
    // Side by side the direction is across; end to end on one line it is along.
    let longer = if a.half_length >= b.half_length { a.axis } else { b.axis };
    let end_on = low >= high && centre.abs() >= a.half_length + b.half_length && centre != 0.0;
    let fallback = match end_on {
        true => scale(a.axis, if centre > 0.0 { -1.0 } else { 1.0 }),
        false => perpendicular(longer),
    };
    apart(a, b, from, (s, t), fallback)
}

/// The distance at (s, t), directed by the difference, or by `fallback` where they touch.
#[inline(always)]
fn apart(a: &Segment, b: &Segment, from: Vec3, (s, t): (f64, f64), fallback: Vec3) -> Crossing {
    let difference = add_scaled(add_scaled(from, a.axis, s), b.axis, -t);
    let distance = norm(difference);
    let normal = if distance > TOUCHING { scale(difference, 1.0 / distance) } else { fallback };
    Crossing { s, distance, normal }
}

/// Nearest points of two segments.
#[inline(always)]
pub fn crossing(a: &Segment, b: &Segment) -> Crossing {
    let from = sub(a.centre, b.centre);
    let n = cross(a.axis, b.axis);
    let sine2 = dot(n, n);
    if sine2 < PARALLEL {
        return parallel(a, b, from);
    }
    // The sine from n is exact to the last digits for small angles too, unlike 1 - cos^2.
    let s = -dot(cross(from, b.axis), n) / sine2;
    let t = -dot(cross(from, a.axis), n) / sine2;
    let common = scale(n, 1.0 / sine2.sqrt());
    if s.abs() <= a.half_length && t.abs() <= b.half_length {
        let height = dot(from, common);
        return Crossing { s, distance: height.abs(), normal: scale(common, 1f64.copysign(height)) };
    }
    // An end of one is nearest to the other (Ericson, "Real-Time Collision Detection", 5.1.9).
    let cosine = dot(a.axis, b.axis);
    let (along_a, along_b) = (dot(from, a.axis), dot(from, b.axis));
    let mut s = a.clamp(s);
    let free = along_b + s * cosine;
    let t = b.clamp(free);
    if t != free {
        s = a.clamp(t * cosine - along_a);
    }
    apart(a, b, from, (s, t), common)
}

/// The core segment of a capsule, and its radius.
#[inline(always)]
fn core(solid: &Solid) -> (Segment, f64) {
    let Shape::Capsule { half_length, radius } = solid.shape else { unreachable!("called with a capsule") };
    (Segment { centre: solid.position, axis: solid.axis(), half_length }, radius)
}

pub fn capsules(a: &Solid, b: &Solid) -> Nearest {
    let ((core_a, radius_a), (core_b, radius_b)) = (core(a), core(b));
    let found = crossing(&core_a, &core_b);
    let distance = found.distance - radius_a - radius_b;
    let point = add_scaled(core_a.at(found.s), found.normal, -radius_a);
    Nearest { distance, a: point, b: add_scaled(point, found.normal, -distance), normal: found.normal }
}
