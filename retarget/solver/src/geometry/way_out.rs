//! The shortest way out of an overlap: the direction of the largest (least negative) gap.
//!
//! The difference of two overlapping cores is left through a flat facet (two edges span it, or a disc is it), through a side that is
//! curved one way (an edge sweeps a disc: `ridge.rs`) or both ways (two discs: `climb.rs`). Each kind gives its candidates;
//! the best one is the answer, exactly, for every gap along a direction is a lower bound.

use super::climb::curved;
use super::difference::{Best, Difference};
use super::ridge::ridge;
use crate::math::{cross, norm, scale};

/// Sine below which two edges span no facet.
const PARALLEL: f64 = 1e-10;

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
