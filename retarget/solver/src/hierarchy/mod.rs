//! One strict hierarchy of linear tasks, solved exactly (the linear problem of one IK iteration).
//!
//! Variables z in R^n. Level k = 1..p has rows `lower <= c . z <= upper` (an equality when lower = upper) that hold up to
//! a slack; the box `lo <= z <= hi` is hard:
//!
//!     lex min (||v_1||^2, ..., ||v_p||^2, ||z||^2)
//!
//! The last, full-rank term makes the answer unique. A posture attraction `||W (x - x_ref)||^2` becomes `||z||^2` by the
//! change of variables z = W (x - x_ref), and soft rows beside it by one more variable each, so that the whole last level costs
//! no factorization of its own.
//!
//! * `problem`: rows, levels, box, and the active set.
//! * `factor`: the equality-only hierarchy for a given active set (orthogonal row basis, level after level).
//! * `damping`: near-singular levels, once per solve.
//! * `lowered`: what damped levels may ask for.
//! * `multipliers`: who is held by a limit rightly, level by level.
//! * `active_set`: guess, verify, move, add, release (Dimitrov, Sherikov, Wieber; Escande, Mansard, Wieber 2014).
//! * `reduced`: the same in what planted soles leave, where many changes are needed.
//! * `cascade`: level by level with a classical active set, behind it when it cycles.

mod active_set;
mod cascade;
mod damping;
mod factor;
mod kernels;
mod least_squares;
mod lowered;
mod multipliers;
mod problem;
mod reduced;

pub use problem::{Outcome, Problem, Side};

use factor::Factor;
use multipliers::Multipliers;
use reduced::Reduction;

/// Work space of the solver; nothing is allocated after the first solve of a given size.
#[derive(Default)]
pub struct Workspace {
    /// The processor has fused multiply-add.
    fma: bool,
    factor: Factor,
    multipliers: Multipliers,
    candidate: Vec<f64>,
    direction: Vec<f64>,
    /// What the levels above have locked, while one is examined.
    locked: Vec<bool>,
    locked_row: Vec<bool>,
    /// Targets of one level before damping.
    asked: Vec<f64>,
    /// The active set of the solve before, while damping looks for its own.
    warm_variables: Vec<Side>,
    warm_rows: Vec<Side>,
    /// The active set before it is guessed.
    guessed_variables: Vec<Side>,
    guessed_rows: Vec<Side>,
    reduction: Reduction,
}

/// Solve `problem` from its warm active set; the answer is in `problem.z`.
pub fn solve(problem: &mut Problem, work: &mut Workspace) -> Outcome {
    work.reduction.reserve(problem);
    active_set::solve(problem, work)
}

impl Workspace {
    /// Buffers for problems of this size.
    fn make_room(&mut self, problem: &Problem) {
        self.candidate.resize(problem.stride, 0.0);
        self.direction.resize(problem.stride, 0.0);
        self.asked.reserve(problem.row_count().saturating_sub(self.asked.len()));
        self.warm_variables.resize(problem.n, Side::Free);
        self.warm_rows.resize(problem.row_count(), Side::Free);
        self.guessed_variables.resize(problem.n, Side::Free);
        self.guessed_rows.resize(problem.row_count(), Side::Free);
        self.locked.resize(problem.n, false);
        self.locked_row.resize(problem.row_count(), false);
    }

    /// Buffers, and the sizes of rows; once per problem.
    fn prepare(&mut self, problem: &Problem) {
        self.fma = kernels::has_fma();
        self.make_room(problem);
        self.factor.prepare(problem);
    }
}
