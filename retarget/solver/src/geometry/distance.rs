//! Signed distance of any two solids: which method finds it.

use super::bulky::bulky;
use super::capsule_box::capsule_box;
use super::capsule_cylinder::capsule_cylinder;
use super::capsules::capsules;
use super::half_space::over_half_space;
use super::nearest::{Nearest, Scratch};
use super::shape::{Shape, Solid};

/// Nearest points of two solids; of two half-spaces, those of the origin of `a` and of `b`.
pub fn nearest(a: &Solid, b: &Solid, scratch: &mut Scratch) -> Nearest {
    match (a.shape, b.shape) {
        (Shape::Capsule { .. }, Shape::Capsule { .. }) => capsules(a, b),
        (_, Shape::HalfSpace) => over_half_space(a, b),
        (Shape::HalfSpace, _) => over_half_space(b, a).swapped(),
        (Shape::Capsule { .. }, Shape::Box { .. }) => capsule_box(a, b, scratch),
        (Shape::Box { .. }, Shape::Capsule { .. }) => capsule_box(b, a, scratch).swapped(),
        (Shape::Capsule { .. }, Shape::Cylinder { .. }) => capsule_cylinder(a, b, scratch),
        (Shape::Cylinder { .. }, Shape::Capsule { .. }) => capsule_cylinder(b, a, scratch).swapped(),
        _ => bulky(a, b, scratch),
    }
}
