//! One active set over all levels: solve for the guess, verify it; else hold what was crossed, let go of what is held wrongly, and
//! solve again. The guess is the last iteration's active set, so that most often one factorization is all.

use super::factor::Factor;
use super::kernels::compile_twice;
use super::limits::{hold_crossed, let_go};
use super::multipliers::examine;
use super::problem::{Outcome, Problem};
use super::work::Work;

/// Factorizations before the guess is given up.
const MOST_GUESSES: u32 = 5;

/// Hold at once all that the answer crosses, and let go of all that is held wrongly at the first level that has any, until neither is
/// left: then the answer is proved. False, with the active set as it was, where this does not end soon.
///
/// A primal-dual active set: M. Hintermueller, K. Ito, K. Kunisch, SIAM J. Optim. 13(3), 2003.
pub fn guess(problem: &mut Problem, work: &mut Work, outcome: &mut Outcome) -> bool {
    work.warm_variables.clone_from(&problem.variable_side);
    work.warm_rows.clone_from(&problem.row_side);
    for _ in 0..MOST_GUESSES {
        factor_all(work.avx2, problem, &mut work.factor, &mut work.candidate);
        outcome.factorizations += 1;
        examine(work.avx2, &mut work.multipliers, problem, &work.factor, &work.candidate);
        let crossed = hold_crossed(work.avx2, problem, &work.candidate);
        if !crossed && work.multipliers.wrong.is_empty() {
            problem.z.copy_from_slice(&work.candidate);
            return true;
        }
        for &release in &work.multipliers.wrong {
            let_go(problem, release);
        }
    }
    problem.variable_side.clone_from(&work.warm_variables);
    problem.row_side.clone_from(&work.warm_rows);
    false
}

compile_twice! {
    /// The equality-only answer for the active set, into `candidate`.
    fn factor_all(problem: &Problem, factor: &mut Factor, candidate: &mut [f64]) {
        factor.restart(problem);
        for i in 0..problem.n {
            candidate[i] = if factor.is_free(i) { 0.0 } else { problem.bound(i) };
        }
        candidate[problem.n..].fill(0.0);
        for k in 0..problem.level_count() {
            factor.ask(problem, k, candidate);
            factor.add_level(problem, k);
        }
        factor.add_candidate(candidate);
    }
}
