//! Buffers of the solver: what one active set over all levels needs, made once for each size of problem.

use super::factor::Factor;
use super::kernels;
use super::multipliers::Multipliers;
use super::problem::{Problem, Side};

#[derive(Default)]
pub struct Work {
    /// The copies of kernels with AVX2 run.
    pub avx2: bool,
    pub factor: Factor,
    pub multipliers: Multipliers,
    pub candidate: Vec<f64>,
    pub direction: Vec<f64>,
    /// What the levels above have locked, while one is examined.
    pub locked: Vec<bool>,
    pub locked_row: Vec<bool>,
    /// Targets of one level before damping.
    pub asked: Vec<f64>,
    /// The active set, while another is tried.
    pub warm_variables: Vec<Side>,
    pub warm_rows: Vec<Side>,
}

impl Work {
    /// Buffers, and the sizes of rows; once per problem.
    pub fn prepare(&mut self, problem: &Problem) {
        self.avx2 = kernels::has_avx2();
        self.factor.prepare(problem);
        self.candidate.resize(problem.stride, 0.0);
        self.direction.resize(problem.stride, 0.0);
        self.asked.reserve(problem.row_count().saturating_sub(self.asked.len()));
        self.warm_variables.resize(problem.n, Side::Free);
        self.warm_rows.resize(problem.row_count(), Side::Free);
        self.locked.resize(problem.n, false);
        self.locked_row.resize(problem.row_count(), false);
    }
}
