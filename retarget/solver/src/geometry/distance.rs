//! Signed distance of any two solids, by the method for their shapes, and a cheap lower bound to skip distant pairs.

use super::box_cylinder::box_cylinder;
use super::capsule_solid::capsule_solid;
use super::capsules::capsules;
use super::half_space::{extreme, over_half_space};
use super::solid::{Nearest, Scratch, Shape, Solid};
use crate::math::{dot, mat_t_vec, norm, scale, sub, Vec3};

/// Nearest points of two solids. Two half-spaces have none: `a` counts as its origin.
pub fn nearest(a: &Solid, b: &Solid, scratch: &mut Scratch) -> Nearest {
    match (a.shape, b.shape) {
        (Shape::Capsule { .. }, Shape::Capsule { .. }) => capsules(a, b),
        (_, Shape::HalfSpace) => over_half_space(a, b),
        (Shape::HalfSpace, _) => over_half_space(b, a).swapped(),
        (Shape::Capsule { .. }, _) => capsule_solid(a, b, scratch),
        (_, Shape::Capsule { .. }) => capsule_solid(b, a, scratch).swapped(),
        _ => box_cylinder(a, b, scratch),
    }
}

/// Signed distance of a point from a flat-sided profile; `excess` is its signed distance from each side.
fn outside(excess: Vec3) -> f64 {
    let out = norm([excess[0].max(0.0), excess[1].max(0.0), excess[2].max(0.0)]);
    out + excess[0].max(excess[1]).max(excess[2]).min(0.0)
}

/// Signed distance (exact) of the world point `p` to a solid.
pub fn point_gap(solid: &Solid, p: Vec3) -> f64 {
    let from = sub(p, solid.position);
    match solid.shape {
        Shape::Capsule { half_length, radius } => {
            let along = dot(from, solid.axis());
            let beyond = (along.abs() - half_length).max(0.0);
            let across = norm(sub(from, scale(solid.axis(), along)));
            (beyond * beyond + across * across).sqrt() - radius
        }
        Shape::Cylinder { half_length, radius } => {
            let along = dot(from, solid.axis());
            let across = norm(sub(from, scale(solid.axis(), along)));
            outside([along.abs() - half_length, across - radius, f64::NEG_INFINITY])
        }
        Shape::Box { half } => {
            let local = mat_t_vec(&solid.rotation, from);
            outside([local[0].abs() - half[0], local[1].abs() - half[1], local[2].abs() - half[2]])
        }
        Shape::HalfSpace => dot(from, solid.axis()),
    }
}

/// Lower bound of the distance: the ball about one solid against the other, the better of both. Exact for half-spaces and balls.
pub fn gap_at_least(a: &Solid, b: &Solid) -> f64 {
    match (a.shape, b.shape) {
        (_, Shape::HalfSpace) => point_gap(b, a.position) - extreme(a, scale(b.axis(), -1.0)).0,
        (Shape::HalfSpace, _) => gap_at_least(b, a),
        _ => (point_gap(b, a.position) - a.shape.reach()).max(point_gap(a, b.position) - b.shape.reach()),
    }
}
