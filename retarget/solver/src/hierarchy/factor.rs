//! The equality-only hierarchy for a given active set: an orthonormal row basis of the free columns, level after level.
//!
//! Held rows of level k, restricted to the free columns, are `C_k = L_k Q` with `Q` the basis of levels 1..k. A level adds
//! to the basis only what is new in it (modified Gram-Schmidt with row pivoting, repeated where digits were lost), and
//! solves for the coordinates of its own new directions. What an earlier level took stays closed.

use super::kernels::{add_scaled, dot};
use super::least_squares::SmallLeastSquares;
use super::problem::{Problem, Side};

/// A pivot below this share of the level's largest row counts as zero.
const RANK_TOLERANCE: f64 = 1e-8;

/// Pivots above this are never damped.
const MOST_DAMPED: f64 = 0.5;

#[derive(Default)]
pub struct Factor {
    stride: usize,
    /// Length of a row of `coefficients`.
    width: usize,
    basis: Vec<f64>,
    level_rows: Vec<f64>,
    coefficients: Vec<f64>,
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
    mask: Vec<f64>,
    members: Vec<usize>,
    remaining: Vec<f64>,
    damping: Vec<f64>,
    exact: Vec<f64>,
    small: SmallLeastSquares,
}

impl Factor {
    /// Sizes and row norms; once per problem.
    #[inline(always)]
    pub fn prepare<const FMA: bool>(&mut self, problem: &Problem) {
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
        self.level_scale.clear();
        for k in 0..problem.level_count() {
            let mut largest: f64 = 0.0;
            for r in problem.level(k) {
                self.row_norm[r] = if problem.present[r] {
                    let row = problem.row(r);
                    dot::<FMA>(row, row).sqrt()
                } else {
                    0.0
                };
                largest = largest.max(self.row_norm[r]);
            }
            self.level_scale.push(largest);
        }
    }

    /// Forget all levels, and take the free columns from the active set.
    #[inline(always)]
    pub fn restart(&mut self, problem: &Problem) {
        self.restart_with(problem, |i| problem.variable_side[i] == Side::Free);
    }

    #[inline(always)]
    pub fn restart_with(&mut self, problem: &Problem, is_free: impl Fn(usize) -> bool) {
        self.pivot_row.clear();
        self.rank_end.clear();
        self.y.clear();
        for i in 0..problem.n {
            self.mask[i] = if is_free(i) { 1.0 } else { 0.0 };
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

    #[inline(always)]
    pub fn basis_row(&self, j: usize) -> &[f64] {
        &self.basis[j * self.stride..(j + 1) * self.stride]
    }

    #[inline(always)]
    pub fn coefficient(&self, r: usize, j: usize) -> f64 {
        self.coefficients[r * self.width + j]
    }

    /// Add level `k`: its held rows, with `rhs` set beforehand.
    #[inline(always)]
    pub fn add_level<const FMA: bool>(&mut self, problem: &Problem, k: usize) {
        self.add_rows::<FMA>(problem, k);
        self.solve_level(self.first_of(k));
        self.rank_end.push(self.rank());
    }

    /// The same, but what a near-singular direction would have to give is first taken back: the level's targets are changed to
    /// what a damped step reaches, and stay so for the rest of the solve. Zero above the threshold on the pivots, growing below it.
    #[inline(always)]
    pub fn add_damped_level<const FMA: bool>(&mut self, problem: &mut Problem, k: usize) {
        self.add_rows::<FMA>(problem, k);
        let first = self.first_of(k);
        self.solve_level(first);
        let asked: f64 = self.members.iter().map(|r| self.rhs[*r] * self.rhs[*r]).sum::<f64>().sqrt();
        let threshold = (problem.damping * asked).min(MOST_DAMPED);
        let rank = self.rank();
        let weak = |f: &Self, j: usize| f.coefficient(f.pivot_row[j], j) < threshold;
        if (first..rank).any(|j| weak(self, j)) {
            self.damp(problem, first, threshold);
        }
        self.rank_end.push(rank);
    }

    #[inline(always)]
    fn first_of(&self, k: usize) -> usize {
        if k == 0 {
            0
        } else {
            self.rank_end[k - 1]
        }
    }

    #[inline(always)]
    fn add_rows<const FMA: bool>(&mut self, problem: &Problem, k: usize) {
        let first = self.rank();
        self.members.clear();
        for r in problem.level(k) {
            if problem.row_side[r] != Side::Free {
                self.members.push(r);
            }
        }
        self.load_rows::<FMA>(problem, first);
        self.pivot::<FMA>(RANK_TOLERANCE * self.level_scale[k], first);
    }

    /// Copy the held rows' free columns and take out what earlier levels span.
    #[inline(always)]
    fn load_rows<const FMA: bool>(&mut self, problem: &Problem, first: usize) {
        let stride = self.stride;
        for (slot, &r) in self.members.iter().enumerate() {
            let row = problem.row(r);
            let work = &mut self.level_rows[slot * stride..(slot + 1) * stride];
            for i in 0..stride {
                work[i] = row[i] * self.mask[i];
            }
            let coefficients = &mut self.coefficients[r * self.width..(r + 1) * self.width];
            for (j, c) in coefficients.iter_mut().enumerate().take(first) {
                let q = &self.basis[j * stride..(j + 1) * stride];
                *c = dot::<FMA>(work, q);
                add_scaled::<FMA>(work, -*c, q);
            }
            let end = (first + self.members.len()).min(self.width);
            coefficients[first..end].fill(0.0);
            self.remaining[slot] = dot::<FMA>(work, work);
        }
    }

    /// Gram-Schmidt inside the level, largest remaining row first.
    #[inline(always)]
    fn pivot<const FMA: bool>(&mut self, tolerance: f64, first: usize) {
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
            if self.remaining[best].sqrt() <= tolerance || self.remaining[best] <= 0.0 {
                break;
            }
            self.swap_slots(done, best);
            let r = self.members[done];
            let whole = self.row_norm[r];
            let (before, after) = self.level_rows.split_at_mut((done + 1) * stride);
            let work = &mut before[done * stride..];
            if self.remaining[done] < 0.01 * whole * whole {
                // Digits were lost: orthogonalise once more against everything so far.
                for i in 0..j {
                    let q = &self.basis[i * stride..(i + 1) * stride];
                    let c = dot::<FMA>(work, q);
                    add_scaled::<FMA>(work, -c, q);
                    self.coefficients[r * self.width + i] += c;
                }
                self.remaining[done] = dot::<FMA>(work, work);
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
            for slot in done + 1..count {
                let other = &mut after[(slot - done - 1) * stride..(slot - done) * stride];
                let c = dot::<FMA>(other, q);
                add_scaled::<FMA>(other, -c, q);
                self.coefficients[self.members[slot] * self.width + j] = c;
                self.remaining[slot] = dot::<FMA>(other, other);
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

    /// Coordinates of the level's new directions: exact, or least squares where rows depend on each other.
    #[inline(always)]
    fn solve_level(&mut self, first: usize) {
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
            let taken_back: f64 = row.iter().zip(&self.y[first..]).zip(&self.exact).map(|((c, y), e)| c * (e - y)).sum();
            if problem.is_equality(r) {
                problem.lower[r] -= taken_back;
                problem.upper[r] = problem.lower[r];
                self.residual[r] -= taken_back;
            }
            self.residual[r] = self.reached(r, first) - self.residual[r];
        }
    }

    fn reached(&self, r: usize, first: usize) -> f64 {
        let row = &self.coefficients[r * self.width + first..];
        row.iter().zip(&self.y[first..]).map(|(c, y)| c * y).sum()
    }

    /// min ||L y - b||^2 + sum_j d_j^2 y_j^2, with d_j zero for pivots above the damping threshold.
    fn least_squares(&mut self, first: usize, damping_from: f64) {        let (count, rank) = (self.members.len(), self.rank());
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
