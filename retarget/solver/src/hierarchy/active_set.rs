//! One active set over all levels: solve for the guess, verify it; else move as far as limits permit, hold what was met,
//! or let go of what is held wrongly, and solve again. The guess is the last iteration's active set, so that most often
//! one factorization is all.

use super::factor::Factor;
use super::kernels::dot;
use super::lowered::lower;
use super::multipliers::Release;
use super::problem::{Outcome, Problem, Side, CROSSED};
use super::{cascade, Workspace};

/// Factorizations before the level-by-level method takes over.
const MOST_CHANGES: u32 = 30;
/// A step of less than this share of its way is none.
const STILL: f64 = 1e-9;

pub fn solve(problem: &mut Problem, work: &mut Workspace, fma: bool) -> Outcome {
    #[cfg(target_arch = "x86_64")]
    if fma {
        // SAFETY: `fma` is true only where the processor has AVX2 and FMA.
        return unsafe { solve_fma(problem, work) };
    }
    let _ = fma;
    solve_any::<{ cfg!(target_arch = "aarch64") }>(problem, work)
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2,fma")]
unsafe fn solve_fma(problem: &mut Problem, work: &mut Workspace) -> Outcome {
    solve_any::<true>(problem, work)
}

#[inline(always)]
fn solve_any<const FMA: bool>(problem: &mut Problem, work: &mut Workspace) -> Outcome {
    problem.settle_sides();
    work.factor.prepare::<FMA>(problem);
    let mut outcome = Outcome::default();
    if problem.damping.iter().all(|d| *d == 0.0) {
        settle::<FMA>(problem, work, &mut outcome);
        return outcome;
    }
    lower::<FMA>(problem, work, &mut outcome);
    settle::<FMA>(problem, work, &mut outcome);
    outcome
}

/// The exact answer of the problem as it stands.
#[inline(always)]
fn settle<const FMA: bool>(problem: &mut Problem, work: &mut Workspace, outcome: &mut Outcome) {
    start::<FMA>(problem);
    let mut released = None;
    for _ in 0..MOST_CHANGES {
        factor_all::<FMA>(problem, &mut work.factor, &mut work.candidate);
        outcome.factorizations += 1;
        if let Some(step) = first_limit::<FMA>(problem, &work.candidate, problem.row_count()) {
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
        match work.multipliers.examine::<FMA>(problem, &work.factor, &work.candidate) {
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
    cascade::solve::<FMA>(problem, work, outcome);
    clamp_to_box(problem);
}

/// A point inside the box that agrees with the active set; rows that it violates are held.
#[inline(always)]
fn start<const FMA: bool>(problem: &mut Problem) {
    for i in 0..problem.n {
        let inside = problem.z[i].max(problem.lo[i]).min(problem.hi[i]);
        problem.z[i] = match problem.variable_side[i] {
            Side::Free if inside.is_finite() => inside,
            Side::Free => 0.0_f64.max(problem.lo[i]).min(problem.hi[i]),
            _ => problem.bound(i),
        };
    }
    problem.z[problem.n..].fill(0.0);
    hold_violated_rows::<FMA>(problem, problem.row_count());
}

/// Inequality rows before `rows_end` that the present point violates join the active set.
#[inline(always)]
pub fn hold_violated_rows<const FMA: bool>(problem: &mut Problem, rows_end: usize) {
    for r in 0..rows_end {
        if problem.present[r] && problem.row_side[r] == Side::Free {
            if let Some(side) = problem.crossed(r, dot::<FMA>(problem.row(r), &problem.z)) {
                problem.row_side[r] = side;
            }
        }
    }
}

/// The equality-only answer for the active set, into `candidate`.
#[inline(always)]
fn factor_all<const FMA: bool>(problem: &Problem, factor: &mut Factor, candidate: &mut [f64]) {
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

/// Looks at the box and at the rows before `rows_end`.
#[inline(always)]
pub fn first_limit<const FMA: bool>(problem: &Problem, candidate: &[f64], rows_end: usize) -> Option<Step> {
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

#[inline(always)]
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

fn clamp_to_box(problem: &mut Problem) {
    for i in 0..problem.n {
        problem.z[i] = problem.z[i].max(problem.lo[i]).min(problem.hi[i]);
    }
}
