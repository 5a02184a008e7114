//! How near pairs are in a posture: looked at one by one where only the closest act, by budgets where all do.

use super::modes::Mode;
use super::set::Other;
use super::task::Activation;
use super::watch::Watch;
use crate::geometry::{gap_at_least, nearest};
use crate::kinematics::Pose;

impl Watch {
    /// A frame of `dt` s in `n_ik` iterations begins in this posture.
    pub fn begin(&mut self, pose: &Pose, dt: f64, n_ik: usize) {
        (self.dt, self.iteration) = (dt, 1.0 / n_ik as f64);
        if self.activation == Activation::All {
            self.open_budgets(pose);
        } else {
            self.measure(pose, 0.0);
        }
    }

    /// After an iteration, of which `done` of `n_ik` are; coordinates went by `step` since the last look.
    pub fn look(&mut self, pose: &Pose, done: usize, step: &[f64]) {
        if self.activation == Activation::All {
            self.spend(pose, step);
        } else {
            self.measure(pose, done as f64 * self.iteration);
        }
    }

    /// Pairs within influence, their modes and violations, with obstacles as they are after `share` of the frame.
    fn measure(&mut self, pose: &Pose, share: f64) {
        self.set.place(pose, &mut self.solids);
        self.place_fixtures(share);
        self.near.clear();
        self.violation.fill(0.0);
        for k in 0..self.set.pairs.len() {
            let pair = &self.set.pairs[k];
            let a = &self.solids[pair.observer];
            let b = match pair.other {
                Other::Observer(o) => &self.solids[o],
                Other::Obstacle(o) if self.present[o] => &self.fixtures[o],
                Other::Obstacle(_) => continue,
            };
            let state = &mut self.pairs[k];
            state.nearest.distance = gap_at_least(a, b);
            if state.nearest.distance < pair.influence {
                state.nearest = nearest(a, b, &mut self.scratch);
                if state.nearest.distance < pair.influence {
                    self.near.push(k);
                }
            }
            let distance = self.pairs[k].nearest.distance;
            self.pairs[k].mode = self.mode_at(k, distance);
            // Where only the closest act, a pair prevents when its row is put up.
            if self.pairs[k].mode == Mode::Reactive {
                self.note(k, Mode::Reactive);
                self.violates(k, -distance);
            }
        }
    }
}
