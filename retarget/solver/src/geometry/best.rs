//! The best of the directions that are tried: that of the largest gap.

use super::difference::Difference;
use crate::math::{dot, scale, Vec3};

/// A candidate wins by more than this (m): of equals the first is kept, so that the choice does not flicker.
const BETTER: f64 = 1e-13;

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
