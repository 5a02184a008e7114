//! The shortest way out of an overlap: the direction of the largest (least negative) gap.
//!
//! The difference of two overlapping cores is left through a flat facet (two edges span it, or a disc is it), through a side that is
//! curved one way (an edge sweeps a disc: `ridge.rs`) or both ways (two discs: `climb.rs`). Each kind gives its candidates;
//! the best one is the answer, exactly, for every gap along a direction is a lower bound.

use super::climb::curved;
use super::difference::Difference;
use super::ridge::ridge;
use crate::math::{cross, dot, norm, scale, Vec3};

/// Sine below which two edges span no facet.
const PARALLEL: f64 = 1e-10;
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

/// Facets only: all there is for segments and boxes.
pub fn flat(m: &Difference) -> Best {
    let mut best = Best::none();
    for disc in m.discs() {
        best.consider(m, disc.axis);
    }
    for (i, first) in m.edges().iter().enumerate() {
        for second in &m.edges()[i + 1..] {
            let n = cross(first.axis, second.axis);
            let sine = norm(n);
            if sine > PARALLEL {
                best.consider(m, scale(n, 1.0 / sine));
            }
        }
    }
    best
}

/// All candidates.
pub fn way_out(m: &Difference) -> Best {
    let mut best = flat(m);
    if !m.discs().is_empty() {
        for edge in 0..m.edges().len() {
            ridge(m, edge, &mut best);
        }
        curved(m, &mut best);
    }
    best
}
