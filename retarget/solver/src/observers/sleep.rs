//! Pairs that cannot come too near in a frame, whatever the joints do within their limits, sleep: their distance is not looked
//! at, and their rows, which nothing could cross, are left out. What is done in the end is the same.

use super::look::Watch;
use super::modes::Mode;
use super::set::{Mover, Other};
use crate::bounds::FrameBox;

impl Watch {
    /// What is known of distances, after coordinates went by `done`.
    pub(super) fn drift_apart(&mut self, done: &[f64]) {
        for (movers, state) in self.movers.iter().zip(&mut self.pairs) {
            let way: f64 = movers.iter().map(|(m, _)| way(done[m.dof].abs(), m.lever)).sum();
            state.at_least -= way;
            state.at_most += way;
        }
    }

    /// Decide for a frame which pairs sleep. `boxes`: how far coordinates may go in it.
    pub(super) fn settle_sleep(&mut self, boxes: &[FrameBox]) {
        for k in 0..self.pairs.len() {
            let moves = matches!(self.set.pairs[k].other, Other::Obstacle(o) if self.obstacles[o].moves());
            self.pairs[k].sleeps = !moves && self.may_sleep(k, boxes);
        }
    }

    fn may_sleep(&self, k: usize, boxes: &[FrameBox]) -> bool {
        let (pair, state) = (&self.set.pairs[k], &self.pairs[k]);
        let mode = state.mode.next(state.at_least, pair.influence);
        if mode == Mode::Reactive || mode != state.mode.next(state.at_most, pair.influence) || mode != state.mode {
            return false;
        }
        let room = state.at_least - self.floor_from(k, state.at_least, self.dt);
        let farthest = |m: &Mover| boxes[m.dof].lo.abs().max(boxes[m.dof].hi.abs());
        self.movers[k].iter().map(|(m, _)| way(farthest(m), m.lever)).sum::<f64>() < room
    }
}

/// How far a point gets that a coordinate moves; 0 where it does not, however long the lever.
fn way(moved: f64, lever: f64) -> f64 {
    if moved == 0.0 {
        0.0
    } else {
        moved * lever
    }
}
