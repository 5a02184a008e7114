//! Distances of pairs where only the closest act: of the observers that one obstacle influences, the closest that approaches damps
//! its motion (paper, "observer prioritization"). Where all act, `budget` keeps them.

use super::law::{damping_share, Mode};
use super::set::{Other, Pair};
use super::task::Activation;
use super::watch::{Approach, Watch};
use crate::geometry::{gap_at_least, nearest};
use crate::hierarchy::Problem;
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
            // Where only the closest act, a pair prevents when its row is put up.
            if self.pairs[k].mode == Mode::Reactive {
                self.note(k, Mode::Reactive);
                self.violates(k, -distance);
            }
        }
    }

    /// After a solve without them, put up the rows of pairs that approach in it. Returns whether there are any.
    pub fn choose(&mut self, problem: &mut Problem) -> bool {
        self.approaching.clear();
        for (t, task) in self.tasks.iter().enumerate().filter(|(_, task)| !task.reactive) {
            for (index, &k) in task.used.iter().enumerate() {
                let r = task.first_row + index;
                // Until now the row's limit is what the reference moves, so that this is n . J dq.
                let moved = dot(problem.row(r), &problem.z) - problem.lower[r];
                if moved - self.drift(k) < 0.0 {
                    self.approaching.push(Approach { pair: k, task: t, row: r, moved });
                }
            }
        }
        let mut any = false;
        for index in 0..self.approaching.len() {
            let rank = self.rank(&self.approaching[index]);
            if rank == 0 || self.activation == Activation::Ranked {
                any |= self.put_up(index, rank, problem);
            }
        }
        any
    }

    /// How many approaching pairs come before this one: of those that share its obstacle, or either of its two observers, each of
    /// which is an obstacle to the other.
    fn rank(&self, approach: &Approach) -> usize {
        let pair = &self.set.pairs[approach.pair];
        let nearer = |other: &&Approach| {
            let distance = |a: &Approach| self.pairs[a.pair].nearest.distance;
            (distance(other), other.pair) < (distance(approach), approach.pair)
        };
        let before = |obstacle: Other| {
            let shares = |other: &&Approach| {
                let p = &self.set.pairs[other.pair];
                match obstacle {
                    Other::Obstacle(_) => p.other == obstacle,
                    Other::Observer(o) => p.other == obstacle || is_self(p) && p.observer == o,
                }
            };
            self.approaching.iter().filter(shares).filter(nearer).count()
        };
        match pair.other {
            Other::Obstacle(_) => before(pair.other),
            Other::Observer(_) => before(pair.other).min(before(Other::Observer(pair.observer))),
        }
    }

    /// The row of an approach, on the level of its rank: n . (J dq - Do) >= share * n . (J dq_trial - Do).
    fn put_up(&mut self, index: usize, rank: usize, problem: &mut Problem) -> bool {
        let Approach { pair, task, mut row, moved } = self.approaching[index];
        let (limits, distance) = (&self.set.pairs[pair], self.pairs[pair].nearest.distance);
        let (share, drift) = (damping_share(distance, limits.influence, limits.margin), self.drift(pair));
        let lower = problem.lower[row] + share * moved + (1.0 - share) * drift;
        let group = self.tasks[task].group;
        let mut places = (0..self.tasks.len()).filter(|t| !self.tasks[*t].reactive && self.tasks[*t].group == group);
        let last = places.clone().count() - 1;
        if let Some(place) = places.nth(rank.min(last)).filter(|place| *place != task) {
            let ranked = &mut self.tasks[place];
            if ranked.used.len() == ranked.rows {
                return false;
            }
            let to = ranked.first_row + ranked.used.len();
            ranked.used.push(pair);
            let stride = problem.stride;
            problem.rows.copy_within(row * stride..(row + 1) * stride, to * stride);
            row = to;
        }
        problem.lower[row] = lower;
        problem.upper[row] = f64::INFINITY;
        problem.present[row] = true;
        problem.row_side[row] = self.pairs[pair].side;
        self.note(pair, Mode::Preventive);
        true
    }
}

fn is_self(pair: &Pair) -> bool {
    matches!(pair.other, Other::Observer(_))
}

fn dot(row: &[f64], z: &[f64]) -> f64 {
    row.iter().zip(z).map(|(a, b)| a * b).sum()
}
