//! The equality-only hierarchy for a given active set: an orthonormal row basis of the free columns, level after level.
//!
//! Held rows of level k, restricted to the free columns, are `C_k = L_k Q` with `Q` the basis of levels 1..k. A level adds
//! to the basis only what is new in it (modified Gram-Schmidt with row pivoting, repeated where digits were lost), and
//! solves for the coordinates of its own new directions. What an earlier level took stays closed.

use super::kernels::{add_rows, add_scaled, dot, dot_rows};
use super::least_squares::SmallLeastSquares;
use super::problem::{Problem, Side};

/// A pivot below this share of the level's largest row counts as zero.
const RANK_TOLERANCE: f64 = 1e-8;
/// Pivots above this many times the damping are not damped.
pub const REACH: f64 = 2.5;

#[derive(Default)]
pub struct Factor {
    pub(super) stride: usize,
    /// Length of a row of `coefficients`.
    pub(super) width: usize,
    pub(super) basis: Vec<f64>,
    level_rows: Vec<f64>,
    pub(super) coefficients: Vec<f64>,
    /// Row that gave basis vector j.
    pub pivot_row: Vec<usize>,
    /// Basis size after each level.
    pub rank_end: Vec<usize>,
    /// Coordinates of the candidate in the basis.
    pub y: Vec<f64>,
    /// L y - rhs of every held row.
    pub residual: Vec<f64>,
    /// What each held row asks of the free columns.
    pub rhs: Vec<f64>,
    /// Norm of each whole row, and the largest of its level.
    pub row_norm: Vec<f64>,
    pub level_scale: Vec<f64>,
    /// 1 where a column is free, 0 where it is held or padding.
    pub(super) mask: Vec<f64>,
    pub(super) members: Vec<usize>,
    remaining: Vec<f64>,
    pub(super) damping: Vec<f64>,
    pub(super) exact: Vec<f64>,
    pub(super) again: Vec<f64>,
    /// Coordinates of standing still.
    pub(super) still: Vec<f64>,
    /// Share of standing still in what damping draws to; the rest is the last level's attraction.
    pub(super) stays: f64,
    /// Held variables of the path of damped levels, where it has come, and the step of one level.
    pub(super) held: Vec<f64>,
    pub(super) path: Vec<f64>,
    pub(super) step: Vec<f64>,
    pub(super) moved: Vec<f64>,
    pub(super) small: SmallLeastSquares,
}

impl Factor {
    /// Sizes and row norms; once per problem.
    pub fn prepare(&mut self, problem: &Problem) {
        let m = problem.row_count();
        self.stride = problem.stride;
        self.width = m.min(problem.n).max(1);
        self.basis.resize(self.width * self.stride, 0.0);
        self.level_rows.resize(m * self.stride, 0.0);
        self.coefficients.resize(m * self.width, 0.0);
        for buffer in [&mut self.residual, &mut self.rhs, &mut self.row_norm, &mut self.remaining] {
            buffer.resize(m, 0.0);
        }
        self.mask.resize(self.stride, 0.0);
        self.make_room(problem);
        self.level_scale.clear();
        for k in 0..problem.level_count() {
            let mut largest: f64 = 0.0;
            for r in problem.level(k) {
                self.row_norm[r] = if problem.present[r] {
                    let row = problem.row(r);
                    dot(row, row).sqrt()
                } else {
                    0.0
                };
                largest = largest.max(self.row_norm[r]);
            }
            self.level_scale.push(largest);
        }
    }

    /// Room for whatever a level may need, so that nothing is allocated on the day that the first level is damped.
    fn make_room(&mut self, problem: &Problem) {
        let m = problem.row_count();
        for buffer in [&mut self.held, &mut self.path, &mut self.step] {
            buffer.resize(self.stride, 0.0);
        }
        let most = self.width.max(m);
        for buffer in
            [&mut self.y, &mut self.damping, &mut self.exact, &mut self.again, &mut self.still, &mut self.moved]
        {
            buffer.reserve(most.saturating_sub(buffer.len()));
        }
        self.small.reserve(2 * m, self.width);
        self.pivot_row.reserve(most.saturating_sub(self.pivot_row.len()));
        self.members.reserve(m.saturating_sub(self.members.len()));
        self.rank_end.reserve(problem.level_count().saturating_sub(self.rank_end.len()));
    }

    /// Forget all levels, and take the free columns from the active set.
    #[inline(always)]
    pub fn restart(&mut self, problem: &Problem) {
        self.pivot_row.clear();
        self.rank_end.clear();
        self.y.clear();
        for i in 0..problem.n {
            self.mask[i] = if problem.variable_side[i] == Side::Free { 1.0 } else { 0.0 };
        }
    }

    #[inline(always)]
    pub fn rank(&self) -> usize {
        self.pivot_row.len()
    }

    #[inline(always)]
    pub fn is_free(&self, i: usize) -> bool {
        self.mask[i] != 0.0
    }

    /// sum_j y_j q_j is added to `z`.
    #[inline(always)]
    pub fn add_candidate(&self, z: &mut [f64]) {
        add_rows(z, 1.0, &self.y, &self.basis);
    }

    /// Coordinates of `z` in the first vectors of the basis.
    #[inline(always)]
    pub fn coordinates(&self, z: &[f64], out: &mut [f64]) {
        dot_rows(z, &self.basis, out);
    }

    #[inline(always)]
    pub fn basis_row(&self, j: usize) -> &[f64] {
        &self.basis[j * self.stride..(j + 1) * self.stride]
    }

    #[inline(always)]
    pub fn coefficient(&self, r: usize, j: usize) -> f64 {
        self.coefficients[r * self.width + j]
    }

    #[inline(always)]
    pub(super) fn first_of(&self, k: usize) -> usize {
        k.checked_sub(1).map_or(0, |above| self.rank_end[above])
    }

    #[inline(always)]
    pub(super) fn add_rows(&mut self, problem: &Problem, k: usize) {
        let first = self.rank();
        self.members.clear();
        for r in problem.level(k) {
            if problem.row_side[r] != Side::Free {
                self.members.push(r);
            }
        }
        self.load_rows(problem, first);
        self.pivot(RANK_TOLERANCE * self.level_scale[k], first);
    }

    /// Squared length of what the levels so far leave of a row in the free columns.
    #[inline(always)]
    pub(super) fn left_of(&mut self, row: &[f64]) -> f64 {
        let (stride, rank) = (self.stride, self.rank());
        let work = &mut self.level_rows[..stride];
        for i in 0..stride {
            work[i] = row[i] * self.mask[i];
        }
        self.again.resize(rank, 0.0);
        dot_rows(work, &self.basis, &mut self.again);
        add_rows(work, -1.0, &self.again, &self.basis);
        dot(work, work)
    }

    /// Copy the held rows' free columns and take out what earlier levels span.
    #[inline(always)]
    fn load_rows(&mut self, problem: &Problem, first: usize) {
        let stride = self.stride;
        for (slot, &r) in self.members.iter().enumerate() {
            let row = problem.row(r);
            let work = &mut self.level_rows[slot * stride..(slot + 1) * stride];
            for i in 0..stride {
                work[i] = row[i] * self.mask[i];
            }
            let coefficients = &mut self.coefficients[r * self.width..(r + 1) * self.width];
            dot_rows(work, &self.basis, &mut coefficients[..first]);
            add_rows(work, -1.0, &coefficients[..first], &self.basis);
            let end = (first + self.members.len()).min(self.width);
            coefficients[first..end].fill(0.0);
            self.remaining[slot] = dot(work, work);
        }
    }

    /// Gram-Schmidt inside the level, largest remaining row first.
    #[inline(always)]
    fn pivot(&mut self, tolerance: f64, first: usize) {
        let stride = self.stride;
        let count = self.members.len();
        for done in 0..count {
            let j = first + done;
            if j >= self.width {
                break;
            }
            let mut best = done;
            for slot in done + 1..count {
                if self.remaining[slot] > self.remaining[best] {
                    best = slot;
                }
            }
            self.swap_slots(done, best);
            let exact = &self.level_rows[done * stride..(done + 1) * stride];
            self.remaining[done] = dot(exact, exact);
            if self.remaining[done].sqrt() <= tolerance {
                break;
            }
            let r = self.members[done];
            let whole = self.row_norm[r];
            let (before, after) = self.level_rows.split_at_mut((done + 1) * stride);
            let work = &mut before[done * stride..];
            if self.remaining[done] < 0.01 * whole * whole {
                // Digits were lost: orthogonalise once more against everything so far.
                self.again.resize(j, 0.0);
                dot_rows(work, &self.basis, &mut self.again);
                add_rows(work, -1.0, &self.again, &self.basis);
                for (i, c) in self.again.iter().enumerate() {
                    self.coefficients[r * self.width + i] += c;
                }
                self.remaining[done] = dot(work, work);
                if self.remaining[done].sqrt() <= tolerance {
                    self.remaining[done] = 0.0;
                    break;
                }
            }
            let pivot = self.remaining[done].sqrt();
            self.coefficients[r * self.width + j] = pivot;
            let inverse = 1.0 / pivot;
            let q = &mut self.basis[j * stride..(j + 1) * stride];
            for i in 0..stride {
                q[i] = work[i] * inverse;
            }
            self.pivot_row.push(r);
            self.again.resize(count - done - 1, 0.0);
            dot_rows(q, after, &mut self.again);
            for (slot, &c) in (done + 1..count).zip(&self.again) {
                let other = &mut after[(slot - done - 1) * stride..(slot - done) * stride];
                add_scaled(other, -c, q);
                self.coefficients[self.members[slot] * self.width + j] = c;
                // Good enough to choose by; the chosen row is measured anew.
                self.remaining[slot] = (self.remaining[slot] - c * c).max(0.0);
            }
        }
    }

    #[inline(always)]
    fn swap_slots(&mut self, a: usize, b: usize) {
        if a == b {
            return;
        }
        let stride = self.stride;
        self.members.swap(a, b);
        self.remaining.swap(a, b);
        let (left, right) = self.level_rows.split_at_mut(b * stride);
        left[a * stride..(a + 1) * stride].swap_with_slice(&mut right[..stride]);
    }

    /// What the held rows of level `k` ask of the free columns, with the others where `held` has them.
    #[inline(always)]
    pub fn ask(&mut self, problem: &Problem, k: usize, held: &[f64]) {
        for r in problem.level(k) {
            if problem.row_side[r] != Side::Free {
                self.rhs[r] = problem.target(r) - dot(problem.row(r), held);
            }
        }
    }

    /// Add level `k`: its held rows, with `rhs` set beforehand.
    #[inline(always)]
    pub fn add_level(&mut self, problem: &Problem, k: usize) {
        self.add_rows(problem, k);
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
        for &r in &self.members {
            self.residual[r] = self.reached(r, first) - self.residual[r];
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
