//! Boxes and cylinders among themselves.

use super::climb::climb;
use super::contact::{meet, touching};
use super::difference::Difference;
use super::gjk::nearest_apart;
use super::way_out::{flat, way_out, Best};
use super::{Nearest, Scratch, Solid};
use crate::math::{add, add_scaled, mat_vec, norm, scale, Vec3};

/// By how much (m) points that follow from the direction alone may miss the solids.
const MISS: f64 = 1e-10;
/// The gap along the direction found is the distance when it is not less than this (m) below the distance of the points found.
const CONVERGED: f64 = 1e-7;

/// Apart, with `point` the nearest of the difference and `of_a` the point of A behind it, from A's centre.
fn apart(a: &Solid, b: &Solid, m: &Difference, point: Vec3, of_a: Vec3, scratch: &mut Scratch) -> Nearest {
    let length = norm(point);
    let mut normal = scale(point, 1.0 / length);
    let mut distance = length;
    if !m.discs().is_empty() {
        // On round sides the nearest point converges before its direction does.
        normal = climb(m, normal);
        let known = m.gap(normal);
        distance = if known > length - CONVERGED { known } else { length };
    }
    let normal = mat_vec(&a.rotation, normal);
    let (found, miss) = meet(a, b, normal, distance, scratch);
    if miss <= MISS {
        return found;
    }
    let at = add(a.position, mat_vec(&a.rotation, of_a));
    Nearest { distance, a: at, b: add_scaled(at, normal, -distance), normal }
}

pub fn bulky(a: &Solid, b: &Solid, scratch: &mut Scratch) -> Nearest {
    let m = Difference::new(a, b, &a.rotation);
    let round = !m.discs().is_empty();
    let facet = flat(&m);
    let along =
        |best: Best, scratch: &mut Scratch| touching(a, b, mat_vec(&a.rotation, best.normal), best.gap, scratch);
    // Boxes that no facet keeps apart overlap; with round sides that is not yet known.
    if !round && facet.gap <= 0.0 {
        return along(facet, scratch);
    }
    let outside = nearest_apart(&m, facet.normal);
    let best = if round { way_out(&m) } else { facet };
    match outside {
        // No face keeps them as far apart as they are: corners, edges or rims are nearest.
        Some((point, of_a)) if best.gap < norm(point) - 1e-12 => apart(a, b, &m, point, of_a, scratch),
        _ => along(best, scratch),
    }
}
