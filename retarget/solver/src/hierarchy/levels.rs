//! One more level of a factorization: what it asks for, and the coordinates of its own new directions.

use super::factor::Factor;
use super::kernels::dot;
use super::problem::{Problem, Side};

/// Pivots above this many times the damping are not damped.
pub const REACH: f64 = 2.5;

impl Factor {
    /// What the held rows of level `k` ask of the free columns, with the others where `held` has them.
    #[inline(always)]
    pub fn ask<const FMA: bool>(&mut self, problem: &Problem, k: usize, held: &[f64]) {
        for r in problem.level(k) {
            if problem.row_side[r] != Side::Free {
                self.rhs[r] = problem.target(r) - dot::<FMA>(problem.row(r), held);
            }
        }
    }

    /// Add level `k`: its held rows, with `rhs` set beforehand.
    #[inline(always)]
    pub fn add_level<const FMA: bool>(&mut self, problem: &Problem, k: usize) {
        self.add_rows::<FMA>(problem, k);
        self.solve_level(self.first_of(k));
        self.rank_end.push(self.rank());
    }

    /// Coordinates of the level's new directions: exact, or least squares where rows depend on each other.
    #[inline(always)]
    pub(super) fn solve_level(&mut self, first: usize) {
        let (count, rank) = (self.members.len(), self.rank());
        let new = rank - first;
        // What is asked beyond what earlier levels already give.
        for slot in 0..count {
            let r = self.members[slot];
            let row = &self.coefficients[r * self.width..r * self.width + first];
            let given: f64 = row.iter().zip(&self.y).map(|(c, y)| c * y).sum();
            self.residual[r] = self.rhs[r] - given;
        }
        self.y.resize(rank, 0.0);
        if new == count {
            for j in first..rank {
                let r = self.pivot_row[j];
                let row = &self.coefficients[r * self.width..(r + 1) * self.width];
                let mut sum = self.residual[r];
                for i in first..j {
                    sum -= row[i] * self.y[i];
                }
                self.y[j] = sum / row[j];
            }
        } else if new > 0 {
            self.least_squares(first, 0.0);
        }
        for slot in 0..count {
            let r = self.members[slot];
            let row = &self.coefficients[r * self.width + first..r * self.width + rank];
            let reached: f64 = row.iter().zip(&self.y[first..]).map(|(c, y)| c * y).sum();
            self.residual[r] = reached - self.residual[r];
        }
    }

    pub(super) fn reached(&self, r: usize, first: usize) -> f64 {
        let row = &self.coefficients[r * self.width + first..];
        row.iter().zip(&self.y[first..]).map(|(c, y)| c * y).sum()
    }

    /// min ||L y - b||^2 + sum_j d_j^2 y_j^2 (towards y_j = stays still_j), with d_j zero for pivots above the damping threshold.
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
                self.small.set_target(extra, *d * self.stays * self.still[first + c]);
                extra += 1;
            }
        }
        self.small.solve(&mut self.y[first..]);
    }
}
