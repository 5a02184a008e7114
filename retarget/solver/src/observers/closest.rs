//! Activation of the closest observer: among the observers that one obstacle influences, the closest that approaches damps its motion
//! (paper, "observer prioritization"). `budget` has the activation of all.

use super::law::{damping_share, Mode};
use super::monitor::{Approach, PairMonitor};
use super::set::{place_obstacles, Other};
use super::task::Activation;
use crate::body::Body;
use crate::braking::Motion;
use crate::geometry::{gap_at_least, nearest};
use crate::hierarchy::Problem;
use crate::kinematics::Pose;

impl PairMonitor {
    /// Begin a frame of `dt` s in `n_ik` iterations in this posture.
    pub fn begin(&mut self, body: &Body, (q, pose): (&[f64], &Pose), motion: &Motion, dt: f64, n_ik: usize) {
        (self.dt, self.iteration) = (dt, 1.0 / n_ik as f64);
        if self.activation == Activation::All {
            self.rest.foresee((body, &self.set), &self.obstacles, q, motion, dt);
            self.open_budgets(pose);
        } else {
            self.measure(pose, 0.0);
        }
    }

    /// Update after iteration `done` of `n_ik`, which moved coordinates by `step`.
    pub fn look(&mut self, pose: &Pose, done: usize, step: &[f64]) {
        if self.activation == Activation::All {
            self.spend(pose, step);
        } else {
            self.measure(pose, done as f64 * self.iteration);
        }
    }

    /// Find the pairs within influence, their modes and violations, with obstacles as they are after `share` of the frame.
    fn measure(&mut self, pose: &Pose, share: f64) {
        self.set.place(pose, &mut self.solids);
        place_obstacles(&self.obstacles, share * self.dt, &mut self.fixtures);
        self.near.clear();
        self.violation.fill(0.0);
        for k in 0..self.set.pairs.len() {
            if !self.is_there(k) {
                continue;
            }
            let pair = &self.set.pairs[k];
            let (a, b) = self.set.sides(k, &self.solids, &self.fixtures);
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
            // A preventive pair is reported once its row is written.
            if self.pairs[k].mode == Mode::Reactive {
                self.note(k, Mode::Reactive);
                self.violates(k, -distance);
            }
        }
    }

    /// Write the rows of pairs that approach in the trial, a solve without these rows. Returns true if there are any.
    pub fn choose(&mut self, problem: &mut Problem) -> bool {
        self.approaching.clear();
        for task in self.tasks.iter().filter(|task| !task.reactive) {
            for (index, &k) in task.used.iter().enumerate() {
                let r = task.first_row + index;
                // The row's limit is so far the motion of the reference, so that this is n . J dq.
                let moved = problem.row(r).iter().zip(&problem.z).map(|(a, b)| a * b).sum::<f64>() - problem.lower[r];
                if moved - self.drift(k) < 0.0 {
                    self.approaching.push(Approach { pair: k, row: r, moved });
                }
            }
        }
        let mut any = false;
        for index in 0..self.approaching.len() {
            let Approach { pair, row, moved } = self.approaching[index];
            if !self.is_closest(&self.approaching[index]) {
                continue;
            }
            // n . (J dq - Do) >= share * n . (J dq_trial - Do)
            let (limits, distance) = (&self.set.pairs[pair], self.pairs[pair].nearest.distance);
            let (share, drift) = (damping_share(distance, limits.influence, limits.margin), self.drift(pair));
            problem.lower[row] = problem.lower[row] + share * moved + (1.0 - share) * drift;
            problem.upper[row] = f64::INFINITY;
            problem.present[row] = true;
            self.note(pair, Mode::Preventive);
            any = true;
        }
        any
    }

    /// True if no approaching pair with the same obstacle is closer. Each observer of a pair of two is an obstacle to the other.
    fn is_closest(&self, approach: &Approach) -> bool {
        let pair = &self.set.pairs[approach.pair];
        let nearer = |other: &Approach| {
            let distance = |a: &Approach| self.pairs[a.pair].nearest.distance;
            (distance(other), other.pair) < (distance(approach), approach.pair)
        };
        let is_first = |obstacle: Other| {
            let shares = |other: &Approach| {
                let p = &self.set.pairs[other.pair];
                match obstacle {
                    Other::Obstacle(_) => p.other == obstacle,
                    Other::Observer(o) => p.other == obstacle || other.pair < self.set.self_pairs && p.observer == o,
                }
            };
            !self.approaching.iter().any(|other| shares(other) && nearer(other))
        };
        is_first(pair.other) || approach.pair < self.set.self_pairs && is_first(Other::Observer(pair.observer))
    }
}
