//! The shapes of observers and obstacles, each in a frame of its own, and nearest points of two of them.

use super::clip::Polygon;
use crate::math::{add, column, mat_t_vec, mat_vec, norm, scale, sub, Mat3, Vec3};

/// A solid in its own frame: centred there, long along z.
#[derive(Clone, Copy, PartialEq, Debug)]
pub enum Shape {
    /// All within `radius` of a segment of z from -half_length to half_length. It is a sphere if the segment is a point, a line if the
    /// radius is 0.
    Capsule { half_length: f64, radius: f64 },
    /// Flat ends at z = -half_length and half_length.
    Cylinder { half_length: f64, radius: f64 },
    /// Half sizes along x, y, z.
    Box { half: Vec3 },
    /// All of z <= 0.
    HalfSpace,
}

impl Shape {
    /// Radius of the smallest ball about the frame's origin that holds the shape, m; infinite for a half-space.
    #[inline]
    pub fn reach(&self) -> f64 {
        match *self {
            Self::Capsule { half_length, radius } => half_length + radius,
            Self::Cylinder { half_length, radius } => (half_length * half_length + radius * radius).sqrt(),
            Self::Box { half } => norm(half),
            Self::HalfSpace => f64::INFINITY,
        }
    }
}

/// A shape where it is in the world.
#[derive(Clone, Copy, Debug)]
pub struct Solid {
    pub shape: Shape,
    pub position: Vec3,
    /// From the shape's frame to the world.
    pub rotation: Mat3,
}

impl Solid {
    /// World direction of the shape's own z.
    #[inline]
    pub fn axis(&self) -> Vec3 {
        column(&self.rotation, 2)
    }

    /// A world point in the shape's frame.
    pub fn local(&self, point: Vec3) -> Vec3 {
        mat_t_vec(&self.rotation, sub(point, self.position))
    }

    /// A point of the shape's frame in the world.
    pub fn world(&self, point: Vec3) -> Vec3 {
        add(self.position, mat_vec(&self.rotation, point))
    }
}

/// Nearest points of two solids A and B, world; `a - b = distance * normal`.
#[derive(Clone, Copy, Debug, Default)]
pub struct Nearest {
    /// m; negative: the penetration depth.
    pub distance: f64,
    pub a: Vec3,
    pub b: Vec3,
    /// Unit direction in which A moves away from B.
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
