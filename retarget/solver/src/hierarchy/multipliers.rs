//! Multipliers: which rows and variables a limit holds rightly. Level by level, the first multiplier that is not zero decides.
//!
//! At level k the gradient of its own residual must be balanced by the rows of higher levels and by held variables:
//! `g_k + C_<k^T lambda + mu = 0`. A variable held at its lower bound may only push up (mu <= 0), a row held at its lower limit
//! likewise. A limit that is needed (a clear, right sign) is locked: lower levels cannot ask for it.

use super::factor::Factor;
use super::kernels::{add_scaled, compile_twice};
use super::problem::{Problem, Release, Side};

/// Multipliers below this share of their own terms are zero.
const SIGN_TOLERANCE: f64 = 1e-10;
/// Multipliers above this share are clearly positive: their bounds are locked for all lower levels.
const LOCK_TOLERANCE: f64 = 1e-8;
/// Terms smaller than this are rounding, whatever they are compared to.
const ROUNDING: f64 = 1e-12;
/// A level whose residual is below this share of its scale is met.
pub const MET_TOLERANCE: f64 = 1e-11;

#[derive(Default)]
pub struct Multipliers {
    lambda: Vec<f64>,
    gradient: Vec<f64>,
    back: Vec<f64>,
    /// What is held wrongly at the level examined last, in order of index.
    pub wrong: Vec<Release>,
    pub locked: Vec<bool>,
    pub locked_row: Vec<bool>,
}

compile_twice! {
    /// All levels of a complete factorization, at the point `z` it gave, up to the first that holds something wrongly.
    pub fn examine(multipliers: &mut Multipliers, problem: &Problem, factor: &Factor, z: &[f64]) {
        multipliers.clear(problem);
        // A closure would not be compiled for these instructions.
        for k in 0..=problem.level_count() {
            if multipliers.examine_level(problem, factor, z, k).is_some() {
                return;
            }
        }
    }
}

compile_twice! {
    /// One level (or, at `level_count`, the final norm), given that those above are right. Locks what it needs.
    pub fn examine_level(
        multipliers: &mut Multipliers,
        problem: &Problem,
        factor: &Factor,
        z: &[f64],
        k: usize,
    ) -> Option<Release> {
        multipliers.examine_level(problem, factor, z, k)
    }
}

impl Multipliers {
    pub fn clear(&mut self, problem: &Problem) {
        self.locked.clear();
        self.locked.resize(problem.n, false);
        self.locked_row.clear();
        self.locked_row.resize(problem.row_count(), false);
        self.lambda.resize(problem.row_count(), 0.0);
        self.gradient.resize(problem.stride, 0.0);
        self.back.reserve(problem.row_count().saturating_sub(self.back.len()));
        self.wrong.clear();
        self.wrong.reserve(problem.n + problem.row_count());
    }

    /// One level (or, at `level_count`, the final norm), given that those above are right. Locks what it needs.
    #[inline(always)]
    fn examine_level(&mut self, problem: &Problem, factor: &Factor, z: &[f64], k: usize) -> Option<Release> {
        let last = k == problem.level_count();
        self.wrong.clear();
        if !last && is_met(problem, factor, k) {
            return None;
        }
        let scale = self.solve(problem, factor, z, k);
        let (wrong, lock) = (SIGN_TOLERANCE * scale + ROUNDING, LOCK_TOLERANCE * scale + 100.0 * ROUNDING);
        let mut worst: Option<(f64, Release)> = None;
        let found = &mut self.wrong;
        let mut keep = |amount: f64, release| {
            found.push(release);
            if worst.is_none_or(|(most, _)| amount > most) {
                worst = Some((amount, release));
            }
        };
        for i in 0..problem.n {
            let sign = match problem.variable_side[i] {
                Side::Lower => 1.0,
                Side::Upper => -1.0,
                _ => continue,
            };
            // Positive: the bound pushes against the way the level wants to go, so it is held rightly.
            let push = sign * self.gradient[i];
            if self.locked[i] {
                continue;
            }
            if push < -wrong {
                keep(-push, Release::Variable(i));
            } else if push > lock {
                self.locked[i] = true;
            }
        }
        let rows_end = if last { problem.row_count() } else { problem.level_end[k] };
        for r in 0..rows_end {
            let sign = match problem.row_side[r] {
                Side::Lower => -1.0,
                Side::Upper => 1.0,
                _ => continue,
            };
            if self.locked_row[r] {
                continue;
            }
            let push = sign * self.lambda[r] * factor.row_norm[r];
            if push < -wrong {
                keep(-push, Release::Row(r));
            } else if push > lock {
                self.locked_row[r] = true;
            }
        }
        worst.map(|(_, release)| release)
    }

    /// lambda of all held rows up to level k, and the gradient left on the held variables. Returns the size of the terms.
    #[inline(always)]
    fn solve(&mut self, problem: &Problem, factor: &Factor, z: &[f64], k: usize) -> f64 {
        let last = k == problem.level_count();
        let rank = if k == 0 { 0 } else { factor.rank_end[k - 1] };
        let mut scale: f64 = 0.0;
        self.lambda.fill(0.0);
        self.back.clear();
        self.back.resize(rank, 0.0);
        if last {
            self.gradient.copy_from_slice(z);
            factor.coordinates(z, &mut self.back);
            scale += z.iter().fold(0.0, |m: f64, v| m.max(v.abs()));
        } else {
            self.gradient.fill(0.0);
            for r in problem.level(k) {
                if problem.row_side[r] == Side::Free {
                    continue;
                }
                let residual = factor.residual[r];
                self.lambda[r] = residual;
                add_scaled(&mut self.gradient, residual, problem.row(r));
                for (j, b) in self.back.iter_mut().enumerate() {
                    *b += factor.coefficient(r, j) * residual;
                }
                scale = scale.max(residual.abs() * factor.row_norm[r]);
            }
        }
        for j in (0..rank).rev() {
            let r = factor.pivot_row[j];
            let lambda = -self.back[j] / factor.coefficient(r, j);
            self.lambda[r] = lambda;
            for i in 0..j {
                self.back[i] += factor.coefficient(r, i) * lambda;
            }
            add_scaled(&mut self.gradient, lambda, problem.row(r));
            scale = scale.max(lambda.abs() * factor.row_norm[r]);
        }
        scale
    }
}

#[inline(always)]
fn is_met(problem: &Problem, factor: &Factor, k: usize) -> bool {
    let tolerance = MET_TOLERANCE * factor.level_scale[k].max(1.0);
    problem
        .level(k)
        .all(|r| problem.row_side[r] == Side::Free || factor.residual[r].abs() * factor.row_norm[r] <= tolerance)
}
