//! One active set over all levels: solve for the guess, verify it; else move as far as limits permit, hold what was met,
//! or let go of what is held wrongly, and solve again. The guess is the last iteration's active set, so that most often
//! one factorization is all.

use super::cascade;
use super::factor::Factor;
use super::kernels::compile_twice;
use super::limits::{advance, clamp_to_box, first_limit, hold_crossed, hold_violated_rows, let_go};
use super::multipliers::examine;
use super::problem::{Outcome, Problem, Side};
use super::work::Work;

/// Factorizations before the level-by-level method takes over.
const MOST_CHANGES: u32 = 30;
/// Factorizations in which the whole active set is guessed.
const MOST_GUESSES: u32 = 5;
/// A step of less than this share of its way is none.
const STILL: f64 = 1e-9;

/// Hold at once all that the answer crosses, and let go of all that is held wrongly at the first level that has any, until neither is
/// left: then the answer is proved. False, with the active set as it was, where this does not end soon.
///
/// A primal-dual active set: M. Hintermueller, K. Ito, K. Kunisch, SIAM J. Optim. 13(3), 2003.
pub fn guess(problem: &mut Problem, work: &mut Work, outcome: &mut Outcome) -> bool {
    work.guessed_variables.clone_from(&problem.variable_side);
    work.guessed_rows.clone_from(&problem.row_side);
    for _ in 0..MOST_GUESSES {
        factor_all(work.fma, problem, &mut work.factor, &mut work.candidate);
        outcome.factorizations += 1;
        examine(work.fma, &mut work.multipliers, problem, &work.factor, &work.candidate);
        let crossed = hold_crossed(work.fma, problem, &work.candidate);
        if !crossed && work.multipliers.wrong.is_empty() {
            problem.z.copy_from_slice(&work.candidate);
            return true;
        }
        for &release in &work.multipliers.wrong {
            let_go(problem, release);
        }
    }
    problem.variable_side.clone_from(&work.guessed_variables);
    problem.row_side.clone_from(&work.guessed_rows);
    false
}

/// One change after the other, from a point inside the limits.
pub fn classic(problem: &mut Problem, work: &mut Work, outcome: &mut Outcome) {
    start(problem, work.fma);
    let mut released = None;
    for _ in 0..MOST_CHANGES {
        factor_all(work.fma, problem, &mut work.factor, &mut work.candidate);
        outcome.factorizations += 1;
        // A limit is met before the answer: stop there, hold it, and solve again with one limit more.
        if let Some(step) = first_limit(work.fma, problem, &work.candidate, problem.row_count()) {
            if step.share < STILL && released == Some(step.limit) {
                // Its multiplier was not unique: what was let go comes back at once, and would do so for ever.
                break;
            }
            if step.share >= STILL {
                released = None;
            }
            advance(problem, &work.candidate, step.share);
            step.hold(problem);
            continue;
        }
        problem.z.copy_from_slice(&work.candidate);
        match examine(work.fma, &mut work.multipliers, problem, &work.factor, &work.candidate) {
            Some(release) => {
                released = Some(release);
                let_go(problem, release);
            }
            None => {
                clamp_to_box(problem);
                return;
            }
        }
    }
    outcome.fallback = true;
    cascade::solve(problem, work, outcome);
    clamp_to_box(problem);
}

/// A point inside the box that agrees with the active set; rows that it violates are held.
fn start(problem: &mut Problem, fma: bool) {
    for i in 0..problem.n {
        let inside = problem.z[i].max(problem.lo[i]).min(problem.hi[i]);
        problem.z[i] = match problem.variable_side[i] {
            Side::Free if inside.is_finite() => inside,
            Side::Free => 0.0_f64.max(problem.lo[i]).min(problem.hi[i]),
            _ => problem.bound(i),
        };
    }
    problem.z[problem.n..].fill(0.0);
    let rows_end = problem.row_count();
    hold_violated_rows(fma, problem, rows_end);
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
            factor.ask::<FMA>(problem, k, candidate);
            factor.add_level::<FMA>(problem, k);
        }
        factor.add_candidate::<FMA>(candidate);
    }
}
