//! Damping of near-singular levels: their targets become what a damped step reaches, for the whole solve.
//!
//! How much is for the caller to say (`trust`). Damping inside the active-set loop would change the problem with every change of the active set; a changed target is a convex
//! problem like any other, solved exactly. What is closed stays closed, and away from singularities nothing is changed.

use super::factor::Factor;
use super::kernels::{add_rows, dot_rows};
use super::problem::Problem;

/// Pivots above this many times the damping are not damped.
const REACH: f64 = 2.5;
/// A variable that has no room left stops no step shorter than this.
const LEEWAY: f64 = 1e-4;

impl Factor {
    /// Before the first level: held variables at their bounds, the others still.
    pub fn stand_still(&mut self, problem: &Problem, held: &[f64]) {
        self.path.clear();
        self.path.extend_from_slice(held);
        for i in 0..problem.n {
            if self.is_free(i) {
                self.path[i] = problem.still[i];
            }
        }
    }

    /// Like `add_level`, but a level that is not trusted asks for less: near-singular directions are damped, and the step is
    /// shortened until it fits the box, so that nothing else is thrown about to make up for a joint that is too slow. The
    /// level's targets become what that step reaches, and stay so for the rest of the solve.
    #[inline(always)]
    pub fn add_damped_level<const FMA: bool>(&mut self, problem: &mut Problem, k: usize) {
        self.add_rows::<FMA>(problem, k);
        let first = self.first_of(k);
        self.solve_level(first);
        let rank = self.rank();
        self.still.resize(rank, 0.0);
        let new_basis = &self.basis[first * self.stride..];
        dot_rows::<FMA>(&problem.still, new_basis, &mut self.still[first..]);
        if problem.damping[k] > 0.0 {
            self.exact.clear();
            self.exact.extend_from_slice(&self.y[first..]);
            for &r in &self.members {
                // Back to what was asked, for the second solve.
                self.residual[r] = self.reached(r, first) - self.residual[r];
            }
            self.least_squares(first, REACH * problem.damping[k]);
            self.step_from_still::<FMA>(first);
            let share = self.share_inside(problem);
            for j in first..rank {
                self.y[j] = self.still[j] + share * (self.y[j] - self.still[j]);
            }
            self.lower_targets(problem, first);
        }
        self.step_from_still::<FMA>(first);
        for (path, step) in self.path.iter_mut().zip(&self.step) {
            *path += step;
        }
        self.rank_end.push(rank);
    }

    /// What the level's own directions add to standing still.
    #[inline(always)]
    fn step_from_still<const FMA: bool>(&mut self, first: usize) {
        self.moved.clear();
        self.moved.extend(self.y[first..].iter().zip(&self.still[first..]).map(|(y, s)| y - s));
        self.step.clear();
        self.step.resize(self.stride, 0.0);
        add_rows::<FMA>(&mut self.step, 1.0, &self.moved, &self.basis[first * self.stride..]);
    }

    /// The largest share of the step that stays in the box.
    fn share_inside(&self, problem: &Problem) -> f64 {
        let mut share: f64 = 1.0;
        for i in (0..problem.n).filter(|i| self.is_free(*i)) {
            let (at, step) = (self.path[i], self.step[i]);
            let room = if step > 0.0 { problem.hi[i] - at } else { at - problem.lo[i] };
            let room = room.max(0.0) + LEEWAY;
            if step.abs() > room {
                share = share.min(room / step.abs());
            }
        }
        share
    }

    /// The level asks for what its `y` reaches, and for what nothing reaches as before.
    fn lower_targets(&mut self, problem: &mut Problem, first: usize) {
        for slot in 0..self.members.len() {
            let r = self.members[slot];
            let row = &self.coefficients[r * self.width + first..];
            let taken_back: f64 =
                row.iter().zip(&self.y[first..]).zip(&self.exact).map(|((c, y), e)| c * (e - y)).sum();
            if problem.is_equality(r) {
                problem.lower[r] -= taken_back;
                problem.upper[r] = problem.lower[r];
                self.residual[r] -= taken_back;
            }
            self.residual[r] = self.reached(r, first) - self.residual[r];
        }
    }

    /// min ||L y - b||^2 + sum_j d_j^2 y_j^2 (towards the last level's attraction), with d_j zero for pivots above the damping threshold.
    pub(super) fn least_squares(&mut self, first: usize, damping_from: f64) {
        let (count, rank) = (self.members.len(), self.rank());
        let new = rank - first;
        self.damping.clear();
        for j in first..rank {
            let pivot = self.coefficient(self.pivot_row[j], j);
            if pivot < damping_from {
                let share = pivot / damping_from;
                self.damping.push(damping_from / REACH * (1.0 - share * share).sqrt());
            } else {
                self.damping.push(0.0);
            }
        }
        let damped = self.damping.iter().filter(|d| **d > 0.0).count();
        self.small.start(count + damped, new);
        for (slot, &r) in self.members.iter().enumerate() {
            for c in 0..new {
                self.small.set(slot, c, self.coefficients[r * self.width + first + c]);
            }
            self.small.set_target(slot, self.residual[r]);
        }
        let mut extra = count;
        for (c, d) in self.damping.iter().enumerate() {
            if *d > 0.0 {
                self.small.set(extra, c, *d);
                extra += 1;
            }
        }
        self.small.solve(&mut self.y[first..]);
    }
}
