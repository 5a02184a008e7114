//! Where two solids are nearest: signed distance, points, and the direction that opens the gap.

use super::clip::Polygon;
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
