//! Distances of boxes and cylinders.

use super::capsule_solid::NO_DIRECTION;
use super::contact::{meet, MISS};
use super::difference::{Best, Difference, BETTER};
use super::gjk::{nearest_apart, Apart};
use super::penetration::{climb, flat, penetration, PARALLEL};
use super::solid::{Nearest, Scratch, Solid};
use crate::math::{across, add, add_scaled, cross, dot, mat_vec, norm, scale, Vec3, IDENTITY};

/// A direction is as good as the nearest points if its gap is within this (m) of their distance.
const SAME: f64 = 1e-12;
/// Sine within which an edge may be across the direction found: on round sides it is known to about the root of the tolerance.
const NEARLY_ACROSS: f64 = 1e-2;
/// Tolerance of the iteration for polytopes and round sides, as a share of the distance.
const EXACT: f64 = 1e-14;
/// The same for cylinders, whose direction `settled` refines.
const ROUND: f64 = 1e-8;

/// Sine below which the products of axes have lost digits, and the gap is computed from the direction.
const NEARLY_PARALLEL: f64 = 1e-3;

/// The largest gap of two boxes along the directions of `penetration::flat`; `m` is in the frame of the first. These are the fifteen along
/// which two boxes can be kept apart: faces, and edge across edge (Gottschalk, Lin, Manocha, 1996).
fn separating(m: &Difference) -> Best {
    let edges = m.edges();
    let half_a = [edges[0].half, edges[1].half, edges[2].half];
    let half_b = [edges[3].half, edges[4].half, edges[5].half];
    let axes = [edges[3].axis, edges[4].axis, edges[5].axis];
    let size = axes.map(|v| v.map(f64::abs));
    let c = m.centre;
    let mut best = Best::none();
    let mut offer = |gap: f64, direction: &dyn Fn() -> Vec3| {
        if gap > best.gap + BETTER {
            best = Best { gap, normal: direction() };
        }
    };
    for i in 0..3 {
        let gap = c[i].abs() - half_a[i] - half_b[0] * size[0][i] - half_b[1] * size[1][i] - half_b[2] * size[2][i];
        offer(gap, &|| IDENTITY[i]);
    }
    for j in 0..3 {
        offer(dot(c, axes[j]).abs() - half_b[j] - dot(half_a, size[j]), &|| axes[j]);
    }
    for i in 0..3 {
        let (i1, i2) = ((i + 1) % 3, (i + 2) % 3);
        for j in 0..3 {
            let (j1, j2) = ((j + 1) % 3, (j + 2) % 3);
            let sine = (axes[j][i1] * axes[j][i1] + axes[j][i2] * axes[j][i2]).sqrt();
            if sine < PARALLEL {
                continue;
            }
            let direction = || scale(cross(IDENTITY[i], axes[j]), 1.0 / sine);
            let along = c[i2] * axes[j][i1] - c[i1] * axes[j][i2];
            let reach_a = half_a[i1] * size[j][i2] + half_a[i2] * size[j][i1];
            let reach_b = half_b[j1] * size[j2][i] + half_b[j2] * size[j1][i];
            let gap = (along.abs() - reach_a - reach_b) / sine;
            if sine < NEARLY_PARALLEL {
                let n = direction();
                offer(m.gap(n).max(m.gap(scale(n, -1.0))), &|| n);
            } else {
                offer(gap, &direction);
            }
        }
    }
    if dot(best.normal, c) < 0.0 {
        best.normal = scale(best.normal, -1.0);
    }
    best
}

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

/// The result of the iteration as nearest points.
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
        // No face direction gives the distance: corners or edges are nearest.
        Some(found) if norm(found.point) > NO_DIRECTION && facet.gap < norm(found.point) - SAME => {
            let points = of_points(a, &found);
            let (middle, miss) = meet(a, b, points.normal, points.distance, scratch);
            if miss <= MISS {
                middle
            } else {
                points
            }
        }
        _ => meet(a, b, mat_vec(&a.rotation, facet.normal), facet.gap, scratch).0,
    }
}

/// One cylinder or two.
fn round(a: &Solid, b: &Solid, m: &Difference, scratch: &mut Scratch) -> Nearest {
    let facet = flat(m);
    let along = |best: &Best, scratch: &mut Scratch| meet(a, b, mat_vec(&a.rotation, best.normal), best.gap, scratch);
    let found = match nearest_apart(m, facet.normal, ROUND) {
        Some(found) if norm(found.point) > NO_DIRECTION => found,
        _ => return along(&penetration(m), scratch).0,
    };
    let best = settled(m, scale(found.point, 1.0 / norm(found.point)));
    let (points, miss) = along(if facet.gap >= best.gap - SAME { &facet } else { &best }, scratch);
    if miss <= MISS {
        return points;
    }
    // Nearly parallel rims and sides: the direction does not determine the points. The iteration may, unless they nearly touch.
    match nearest_apart(m, facet.normal, EXACT) {
        Some(found) if norm(found.point) - m.gap(scale(found.point, 1.0 / norm(found.point))) < miss => {
            of_points(a, &found)
        }
        _ => points,
    }
}

pub fn box_cylinder(a: &Solid, b: &Solid, scratch: &mut Scratch) -> Nearest {
    let m = Difference::new(a, b, &a.rotation);
    if m.discs().is_empty() {
        boxes(a, b, &m, scratch)
    } else {
        round(a, b, &m, scratch)
    }
}
