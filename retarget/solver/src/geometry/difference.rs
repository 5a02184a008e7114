//! The difference A - B of two cores as a sum of segments and discs, as every shape here is such a sum about its centre.

use super::solid::{Shape, Solid};
use crate::math::{across, add_scaled, column, cross, dot, mat_t_vec, norm, scale, sub, Mat3, Vec3, IDENTITY};

#[derive(Clone, Copy, Default)]
pub struct Edge {
    /// Unit direction.
    pub axis: Vec3,
    pub half: f64,
}

#[derive(Clone, Copy, Default)]
pub struct Disc {
    /// Unit normal.
    pub axis: Vec3,
    pub radius: f64,
}

/// All points of A minus all of B, in the frame of one of them, whose own axes are then exact.
#[derive(Clone, Copy, Default)]
pub struct Difference {
    /// A's centre from B's.
    pub centre: Vec3,
    edges: [Edge; 6],
    edge_count: usize,
    discs: [Disc; 2],
    disc_count: usize,
    /// Number of the edges and discs of A, which come first.
    edges_of_a: usize,
    discs_of_a: usize,
}

/// A point of the difference, and the offset from A's centre of the point of A behind it.
#[derive(Clone, Copy, Default)]
pub struct Vertex {
    pub w: Vec3,
    pub a: Vec3,
}

impl Difference {
    /// The difference in the axes of `frame`, without the radii of capsules.
    pub fn new(a: &Solid, b: &Solid, frame: &Mat3) -> Self {
        let mut m = Self { centre: mat_t_vec(frame, sub(a.position, b.position)), ..Self::default() };
        m.put(a, frame);
        (m.edges_of_a, m.discs_of_a) = (m.edge_count, m.disc_count);
        m.put(b, frame);
        m
    }

    fn put(&mut self, solid: &Solid, frame: &Mat3) {
        let axis = |k: usize| {
            if std::ptr::eq(&solid.rotation, frame) {
                IDENTITY[k] // its own axes without rounding
            } else {
                mat_t_vec(frame, column(&solid.rotation, k))
            }
        };
        match solid.shape {
            Shape::Box { half } => (0..3).for_each(|k| self.put_edge(axis(k), half[k])),
            Shape::Capsule { half_length, .. } => self.put_edge(axis(2), half_length),
            Shape::Cylinder { half_length, radius } => {
                self.put_edge(axis(2), half_length);
                self.discs[self.disc_count] = Disc { axis: axis(2), radius };
                self.disc_count += 1;
            }
            Shape::HalfSpace => {}
        }
    }

    fn put_edge(&mut self, axis: Vec3, half: f64) {
        self.edges[self.edge_count] = Edge { axis, half };
        self.edge_count += 1;
    }

    pub fn edges(&self) -> &[Edge] {
        &self.edges[..self.edge_count]
    }

    pub fn discs(&self) -> &[Disc] {
        &self.discs[..self.disc_count]
    }

    /// Gap along the unit direction n. The signed distance is the largest gap.
    #[inline]
    pub fn gap(&self, n: Vec3) -> f64 {
        let mut gap = dot(self.centre, n);
        for edge in self.edges() {
            gap -= edge.half * dot(edge.axis, n).abs();
        }
        for disc in self.discs() {
            gap -= disc.radius * norm(cross(disc.axis, n));
        }
        gap
    }

    /// The lowest point in the direction n (of any length).
    pub fn lowest(&self, n: Vec3) -> Vertex {
        let (mut of_a, mut of_b) = ([0.0; 3], [0.0; 3]);
        for (k, edge) in self.edges().iter().enumerate() {
            let sum = if k < self.edges_of_a { &mut of_a } else { &mut of_b };
            *sum = add_scaled(*sum, edge.axis, edge.half.copysign(dot(edge.axis, n)));
        }
        for (k, disc) in self.discs().iter().enumerate() {
            let radial = across(n, disc.axis);
            let slope = norm(radial);
            if slope > 0.0 {
                let sum = if k < self.discs_of_a { &mut of_a } else { &mut of_b };
                *sum = add_scaled(*sum, radial, disc.radius / slope);
            }
        }
        Vertex { w: sub(sub(self.centre, of_a), of_b), a: scale(of_a, -1.0) }
    }
}

/// A candidate wins by more than this (m). Among equals the first is kept, so that the choice does not flicker.
pub const BETTER: f64 = 1e-13;

/// The best direction so far.
#[derive(Clone, Copy)]
pub struct Best {
    pub gap: f64,
    pub normal: Vec3,
}

impl Best {
    pub fn none() -> Self {
        Self { gap: f64::NEG_INFINITY, normal: [0.0, 0.0, 1.0] }
    }

    /// Try the unit direction n, and -n, whichever points to A.
    pub fn consider(&mut self, m: &Difference, n: Vec3) {
        let n = if dot(n, m.centre) < 0.0 { scale(n, -1.0) } else { n };
        let gap = m.gap(n);
        if gap > self.gap + BETTER {
            *self = Self { gap, normal: n };
        }
    }
}
