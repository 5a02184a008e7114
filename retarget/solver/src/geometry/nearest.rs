//! Signed distance of two solids, the nearest points and the direction that opens the gap.

use super::bulky::bulky;
use super::capsule_box::capsule_box;
use super::capsule_cylinder::capsule_cylinder;
use super::capsules::capsules;
use super::clip::Polygon;
use super::half_space::over_half_space;
use super::{Shape, Solid};
use crate::math::{scale, Vec3};

/// Where two solids A and B are nearest; `a - b = distance * normal`.
#[derive(Clone, Copy, Debug)]
pub struct Nearest {
    /// m; negative: how deep they overlap, along the shortest way out.
    pub distance: f64,
    /// World point of A.
    pub a: Vec3,
    /// World point of B.
    pub b: Vec3,
    /// Unit, world: where A moves away from B.
    pub normal: Vec3,
}

impl Nearest {
    /// The same pair with A and B exchanged.
    pub fn swapped(self) -> Self {
        Self { distance: self.distance, a: self.b, b: self.a, normal: scale(self.normal, -1.0) }
    }
}

/// Room for the clipping of touching faces, made once.
#[derive(Default)]
pub struct Scratch {
    pub(super) polygon: Polygon,
    pub(super) clipped: Polygon,
}

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
