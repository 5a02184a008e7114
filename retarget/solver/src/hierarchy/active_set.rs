//! One active set over all levels: solve for the guess, verify it; else move as far as limits permit, hold what was met,
//! or let go of what is held wrongly, and solve again. The guess is the last iteration's active set, so that most often
//! one factorization is all.

use super::factor::Factor;
use super::kernels::{compile_twice, dot};
use super::lowered::lower;
use super::multipliers::{examine, Release};
use super::problem::{Outcome, Problem, Side, CROSSED};
use super::{cascade, reduced, Workspace};

/// Factorizations before the level-by-level method takes over.
const MOST_CHANGES: u32 = 30;
/// Factorizations in which the whole active set is guessed.
const MOST_GUESSES: u32 = 5;
/// A step of less than this share of its way is none.
const STILL: f64 = 1e-9;

pub fn solve(problem: &mut Problem, work: &mut Workspace) -> Outcome {
    problem.settle_sides();
    work.prepare(problem);
    let mut outcome = Outcome::default();
    if problem.damping.iter().any(|d| *d != 0.0) {
        lower(work.fma, problem, work, &mut outcome);
    }
    settle(problem, work, &mut outcome);
    outcome
}

/// The exact answer of the problem as it stands.
fn settle(problem: &mut Problem, work: &mut Workspace, outcome: &mut Outcome) {
    if guess(problem, work, outcome) {
        clamp_to_box(problem);
    } else if !reduced::solve(problem, work, outcome) {
        classic(problem, work, outcome);
    }
}

/// One change after the other, from a point inside the limits.
pub fn classic(problem: &mut Problem, work: &mut Workspace, outcome: &mut Outcome) {
    start(problem, work.fma);
    let mut released = None;
    for _ in 0..MOST_CHANGES {
        factor_all(work.fma, problem, &mut work.factor, &mut work.candidate);
        outcome.factorizations += 1;
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

/// Hold at once all that the answer crosses, and let go of all that is held wrongly at the first level that has any, until neither is
/// left: then the answer is proved. False, with the active set as it was, where this does not end soon.
///
/// A primal-dual active set: M. Hintermueller, K. Ito, K. Kunisch, SIAM J. Optim. 13(3), 2003.
fn guess(problem: &mut Problem, work: &mut Workspace, outcome: &mut Outcome) -> bool {
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

compile_twice! {
    /// Hold every limit that `candidate` is beyond. Returns whether there was one.
    fn hold_crossed(problem: &mut Problem, candidate: &[f64]) -> bool = hold_crossed_any
}

#[inline(always)]
fn hold_crossed_any<const FMA: bool>(problem: &mut Problem, candidate: &[f64]) -> bool {
    let mut crossed = false;
    for i in 0..problem.n {
        if problem.variable_side[i] == Side::Free {
            if candidate[i] > problem.hi[i] + CROSSED * (1.0 + problem.hi[i].abs()) {
                problem.variable_side[i] = Side::Upper;
                crossed = true;
            } else if candidate[i] < problem.lo[i] - CROSSED * (1.0 + problem.lo[i].abs()) {
                problem.variable_side[i] = Side::Lower;
                crossed = true;
            }
        }
    }
    for r in 0..problem.row_count() {
        if problem.present[r] && problem.row_side[r] == Side::Free {
            if let Some(side) = problem.crossed(r, dot::<FMA>(problem.row(r), candidate)) {
                problem.row_side[r] = side;
                crossed = true;
            }
        }
    }
    crossed
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
    /// Inequality rows before `rows_end` that the present point violates join the active set.
    pub fn hold_violated_rows(problem: &mut Problem, rows_end: usize) = hold_violated_rows_any
}

#[inline(always)]
fn hold_violated_rows_any<const FMA: bool>(problem: &mut Problem, rows_end: usize) {
    for r in 0..rows_end {
        if problem.present[r] && problem.row_side[r] == Side::Free {
            if let Some(side) = problem.crossed(r, dot::<FMA>(problem.row(r), &problem.z)) {
                problem.row_side[r] = side;
            }
        }
    }
}

compile_twice! {
    /// The equality-only answer for the active set, into `candidate`.
    fn factor_all(problem: &Problem, factor: &mut Factor, candidate: &mut [f64]) = factor_all_any
}

#[inline(always)]
fn factor_all_any<const FMA: bool>(problem: &Problem, factor: &mut Factor, candidate: &mut [f64]) {
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

/// The first limit on the way from the present point, and how much of the way it leaves.
#[derive(Clone, Copy)]
pub struct Step {
    pub share: f64,
    limit: Release,
    side: Side,
}

impl Step {
    pub fn hold(self, problem: &mut Problem) {
        match self.limit {
            Release::Variable(i) => {
                problem.variable_side[i] = self.side;
                problem.z[i] = problem.bound(i);
            }
            Release::Row(r) => problem.row_side[r] = self.side,
        }
    }
}

compile_twice! {
    /// Looks at the box and at the rows before `rows_end`.
    pub fn first_limit(problem: &Problem, candidate: &[f64], rows_end: usize) -> Option<Step> = first_limit_any
}

#[inline(always)]
fn first_limit_any<const FMA: bool>(problem: &Problem, candidate: &[f64], rows_end: usize) -> Option<Step> {
    let mut first: Option<Step> = None;
    let mut meet = |from: f64, to: f64, lower: f64, upper: f64, limit: Release| {
        let (side, room) = if to > upper + CROSSED * (1.0 + upper.abs()) {
            (Side::Upper, upper - from)
        } else if to < lower - CROSSED * (1.0 + lower.abs()) {
            (Side::Lower, lower - from)
        } else {
            return;
        };
        let share = (room / (to - from)).clamp(0.0, 1.0);
        if first.is_none_or(|step: Step| share < step.share) {
            first = Some(Step { share, limit, side });
        }
    };
    for i in 0..problem.n {
        if problem.variable_side[i] == Side::Free {
            meet(problem.z[i], candidate[i], problem.lo[i], problem.hi[i], Release::Variable(i));
        }
    }
    for r in 0..rows_end {
        if problem.present[r] && problem.row_side[r] == Side::Free {
            let from = dot::<FMA>(problem.row(r), &problem.z);
            let to = dot::<FMA>(problem.row(r), candidate);
            meet(from, to, problem.lower[r], problem.upper[r], Release::Row(r));
        }
    }
    first
}

pub fn advance(problem: &mut Problem, candidate: &[f64], share: f64) {
    for i in 0..problem.n {
        let z = problem.z[i];
        problem.z[i] = z + share * (candidate[i] - z);
    }
}

pub fn let_go(problem: &mut Problem, release: Release) {
    match release {
        Release::Variable(i) => problem.variable_side[i] = Side::Free,
        Release::Row(r) => problem.row_side[r] = Side::Free,
    }
}

pub fn clamp_to_box(problem: &mut Problem) {
    for i in 0..problem.n {
        problem.z[i] = problem.z[i].max(problem.lo[i]).min(problem.hi[i]);
    }
}
