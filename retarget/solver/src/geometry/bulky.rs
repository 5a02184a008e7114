//! Boxes and cylinders among themselves.

use super::capsule_and::NO_DIRECTION;
use super::contact::{meet, touching, MISS};
use super::difference::{Best, Difference};
use super::gjk::{nearest_apart, Apart};
use super::separating::separating;
use super::solid::{Nearest, Scratch, Solid};
use super::way_out::{climb, flat, way_out};
use crate::math::{across, add, add_scaled, dot, mat_vec, norm, scale, Vec3};

/// A direction whose gap is not less than this (m) below the distance of points that were found is as good as they are.
const SAME: f64 = 1e-12;
/// On round sides the iteration finds a direction to about the root of its tolerance: edges that may be across it, as a sine.
const NEARLY_ACROSS: f64 = 1e-2;
/// Share of the distance to which polytopes and round sides are iterated.
const EXACT: f64 = 1e-14;
const ROUND: f64 = 1e-8;

/// The direction from which no step enlarges the gap, on the smooth sides around `start` and along edges that are nearly across it.
fn settled(m: &Difference, start: Vec3) -> Best {
    let mut best = Best { gap: m.gap(start), normal: start };
    best.consider(m, climb(m, start, None));
    for edge in m.edges() {
        if dot(edge.axis, start).abs() < NEARLY_ACROSS {
            let flat = across(start, edge.axis);
            best.consider(m, climb(m, scale(flat, 1.0 / norm(flat)), Some(edge.axis)));
        }
    }
    best
}

/// The points that the iteration found, with the direction between them.
fn of_points(a: &Solid, found: &Apart) -> Nearest {
    let distance = norm(found.point);
    let normal = mat_vec(&a.rotation, scale(found.point, 1.0 / distance));
    let at = add(a.position, mat_vec(&a.rotation, found.of_a));
    Nearest { distance, a: at, b: add_scaled(at, normal, -distance), normal }
}

/// Two boxes.
fn boxes(a: &Solid, b: &Solid, m: &Difference, scratch: &mut Scratch) -> Nearest {
    let facet = separating(m);
    let apart = if facet.gap > 0.0 { nearest_apart(m, facet.normal, EXACT) } else { None };
    match apart {
        // No face keeps them as far apart as they are: corners or edges are nearest.
        Some(found) if norm(found.point) > NO_DIRECTION && facet.gap < norm(found.point) - SAME => {
            let points = of_points(a, &found);
            let (middle, miss) = meet(a, b, points.normal, points.distance, scratch);
            if miss <= MISS {
                middle
            } else {
                points
            }
        }
        _ => touching(a, b, mat_vec(&a.rotation, facet.normal), facet.gap, scratch),
    }
}

/// One cylinder or two.
fn round(a: &Solid, b: &Solid, m: &Difference, scratch: &mut Scratch) -> Nearest {
    let facet = flat(m);
    let along = |best: &Best, scratch: &mut Scratch| meet(a, b, mat_vec(&a.rotation, best.normal), best.gap, scratch);
    let found = match nearest_apart(m, facet.normal, ROUND) {
        Some(found) if norm(found.point) > NO_DIRECTION => found,
        _ => return along(&way_out(m), scratch).0,
    };
    let best = settled(m, scale(found.point, 1.0 / norm(found.point)));
    let (points, miss) = along(if facet.gap >= best.gap - SAME { &facet } else { &best }, scratch);
    if miss <= MISS {
        return points;
    }
    // Nearly parallel rims and sides: the direction does not determine the points. The iteration may, unless they all but touch.
    match nearest_apart(m, facet.normal, EXACT) {
        Some(found) if norm(found.point) - m.gap(scale(found.point, 1.0 / norm(found.point))) < miss => {
            of_points(a, &found)
        }
        _ => points,
    }
}

pub fn bulky(a: &Solid, b: &Solid, scratch: &mut Scratch) -> Nearest {
    let m = Difference::new(a, b, &a.rotation);
    if m.discs().is_empty() {
        boxes(a, b, &m, scratch)
    } else {
        round(a, b, &m, scratch)
    }
}
