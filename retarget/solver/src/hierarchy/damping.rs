//! Damping of near-singular levels: their targets become what a damped step reaches, for the whole solve.
//!
//! Damping inside the active-set loop would change the problem with every change of the active set; a changed target is a convex
//! problem like any other, solved exactly. What is closed stays closed, and away from singularities nothing is changed.

use super::factor::Factor;
use super::problem::Problem;

/// Pivots above this are never damped.
const MOST_DAMPED: f64 = 0.5;

impl Factor {
    /// The same, but what a near-singular direction would have to give is first taken back: the level's targets are changed to
    /// what a damped step reaches, and stay so for the rest of the solve. Zero above the threshold on the pivots, growing below it.
    #[inline(always)]
    pub fn add_damped_level<const FMA: bool>(&mut self, problem: &mut Problem, k: usize) {
        self.add_rows::<FMA>(problem, k);
        let first = self.first_of(k);
        self.solve_level(first);
        // A residual that nothing can change damps nothing, nor does what earlier levels disturb.
        let reached = self.members.iter().map(|r| self.reached(*r, first).powi(2)).sum::<f64>();
        let asked = self.members.iter().map(|r| self.rhs[*r].powi(2)).sum::<f64>().min(reached).sqrt();
        let threshold = (problem.damping * asked).min(MOST_DAMPED);
        let rank = self.rank();
        let weak = |f: &Self, j: usize| f.coefficient(f.pivot_row[j], j) < threshold;
        if (first..rank).any(|j| weak(self, j)) {
            self.damp(problem, first, threshold);
        }
        self.rank_end.push(rank);
    }

    /// Replace the solution and the targets of the level (from basis vector `first` on) by the damped ones.
    fn damp(&mut self, problem: &mut Problem, first: usize, threshold: f64) {
        self.exact.clear();
        self.exact.extend_from_slice(&self.y[first..]);
        for &r in &self.members {
            // Back to what was asked, for the second solve.
            self.residual[r] = self.reached(r, first) - self.residual[r];
        }
        self.least_squares(first, threshold);
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

    /// min ||L y - b||^2 + sum_j d_j^2 y_j^2, with d_j zero for pivots above the damping threshold.
    pub(super) fn least_squares(&mut self, first: usize, damping_from: f64) {
        let (count, rank) = (self.members.len(), self.rank());
        let new = rank - first;
        self.damping.clear();
        for j in first..rank {
            let pivot = self.coefficient(self.pivot_row[j], j);
            if pivot < damping_from {
                let share = pivot / damping_from;
                self.damping.push(0.5 * damping_from * (1.0 - share * share).sqrt());
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
