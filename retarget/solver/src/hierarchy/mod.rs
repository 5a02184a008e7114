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
//! * `damping`: targets of near-singular levels, moved nearer, once per solve.
//! * `multipliers`: which rows and variables a limit holds rightly, level by level.
//! * `limits`: moves that stop at the first limit; what is held there or released.
//! * `active_set`: guess and verify (Hintermueller, Ito, Kunisch 2003).
//! * `cascade`: level by level with a classical active set, where the guess does not settle: first, by `reduced`, in what planted
//!   soles leave, then in the whole.

mod active_set;
mod cascade;
mod damping;
mod factor;
pub(crate) mod kernels;
mod least_squares;
mod limits;
mod multipliers;
mod problem;
mod reduced;
mod work;

pub use problem::{Outcome, Problem, Side};

use reduced::Reduction;
use work::Work;

/// Work space of the solver; nothing is allocated after the first solve of a given size.
#[derive(Default)]
pub struct Workspace {
    work: Work,
    reduction: Reduction,
}

/// Solve `problem` from its warm active set; the answer is in `problem.z`.
pub fn solve(problem: &mut Problem, workspace: &mut Workspace) -> Outcome {
    let Workspace { work, reduction } = workspace;
    reduction.reserve(problem);
    problem.settle_sides();
    work.prepare(problem);
    let mut outcome = Outcome::default();
    if problem.damping.iter().chain(&problem.short_lever).any(|d| *d != 0.0) {
        damping::lower(work.avx2, problem, work, &mut outcome);
    }
    if !active_set::guess(problem, work, &mut outcome) && !reduced::solve(problem, work, reduction, &mut outcome) {
        (outcome.fallback, outcome.capped) = (true, false);
        cascade::solve(problem, work, &mut outcome);
    }
    limits::clamp_to_box(problem);
    outcome
}
