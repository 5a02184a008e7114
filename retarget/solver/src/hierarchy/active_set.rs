//! One active set over all levels: solve for the guess, verify it; else move as far as limits permit, hold what was met,
//! or let go of what is held wrongly, and solve again. The guess is the last iteration's active set, so that most often
//! one factorization is all.

use super::factor::Factor;
use super::kernels::dot;
use super::multipliers::Release;
use super::problem::{Outcome, Problem, Side};
use super::{cascade, Workspace};

/// Factorizations before the level-by-level method takes over.
const MOST_CHANGES: u32 = 60;
/// Rounds of damping: again when the exact answer is held by other ends of ranges than damping thought.
const MOST_DAMPINGS: u32 = 3;
/// Rounds in which damping finds the ends of ranges that it runs into.
const MOST_STOPS: u32 = 4;
/// A limit counts as crossed beyond this (relative to its size).
pub const CROSSED: f64 = 1e-11;

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
        settle::<FMA>(problem, work, false, &mut outcome);
        return outcome;
    }
    work.asked.clone_from(&problem.lower);
    for _ in 0..MOST_DAMPINGS {
        let usable = damp::<FMA>(problem, work, &mut outcome);
        settle::<FMA>(problem, work, usable, &mut outcome);
        if work.stops.iter().enumerate().all(|(i, stop)| *stop == problem.at_stop(i)) {
            break;
        }
        restore(problem, &work.asked);
    }
    outcome
}

/// Targets of equalities as they were asked, before damping.
fn restore(problem: &mut Problem, asked: &[f64]) {
    for r in 0..problem.row_count() {
        if problem.row_side[r] == Side::Both {
            problem.lower[r] = asked[r];
            problem.upper[r] = asked[r];
        }
    }
}

/// Damp every level, with what is at the end of its range held. True if the factorization is that of the active set too.
#[inline(always)]
fn damp<const FMA: bool>(problem: &mut Problem, work: &mut Workspace, outcome: &mut Outcome) -> bool {
    for _ in 0..MOST_STOPS {
        factor_all::<FMA>(problem, &mut work.factor, &mut work.candidate, true, |p, i| !p.at_stop(i));
        outcome.factorizations += 1;
        let mut met = false;
        for i in 0..problem.n {
            if problem.at_stop(i) {
                continue;
            }
            let z = work.candidate[i];
            if problem.hi_is_stop[i] && z > problem.hi[i] + CROSSED {
                problem.variable_side[i] = Side::Upper;
                met = true;
            } else if problem.lo_is_stop[i] && z < problem.lo[i] - CROSSED {
                problem.variable_side[i] = Side::Lower;
                met = true;
            }
        }
        if !met {
            break;
        }
        restore(problem, &work.asked);
    }
    work.stops.clear();
    work.stops.extend((0..problem.n).map(|i| problem.at_stop(i)));
    (0..problem.n).all(|i| (problem.variable_side[i] == Side::Free) != work.stops[i])
}

/// The exact answer of the problem as it stands. `factored`: the active set's candidate is there already.
#[inline(always)]
fn settle<const FMA: bool>(problem: &mut Problem, work: &mut Workspace, mut factored: bool, outcome: &mut Outcome) {
    start::<FMA>(problem);
    for _ in 0..MOST_CHANGES {
        if !factored {
            let free = |p: &Problem, i: usize| p.variable_side[i] == Side::Free;
            factor_all::<FMA>(problem, &mut work.factor, &mut work.candidate, false, free);
            outcome.factorizations += 1;
        }
        factored = false;
        if let Some(step) = first_limit::<FMA>(problem, &work.candidate, problem.row_count()) {
            advance(problem, &work.candidate, step.share);
            step.hold(problem);
            continue;
        }
        problem.z.copy_from_slice(&work.candidate);
        match work.multipliers.examine::<FMA>(problem, &work.factor, &work.candidate) {
            Some(release) => let_go(problem, release),
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
    hold_violated_rows::<FMA>(problem);
}

/// Inequality rows that the present point violates join the active set.
#[inline(always)]
pub fn hold_violated_rows<const FMA: bool>(problem: &mut Problem) {
    for r in 0..problem.row_count() {
        if !problem.present[r] || problem.row_side[r] != Side::Free {
            continue;
        }
        let value = dot::<FMA>(problem.row(r), &problem.z);
        if value < problem.lower[r] - CROSSED {
            problem.row_side[r] = Side::Lower;
        } else if value > problem.upper[r] + CROSSED {
            problem.row_side[r] = Side::Upper;
        }
    }
}

/// The equality-only answer for the active set, into `candidate`.
#[inline(always)]
fn factor_all<const FMA: bool>(
    problem: &mut Problem,
    factor: &mut Factor,
    candidate: &mut [f64],
    damp: bool,
    is_free: impl Fn(&Problem, usize) -> bool,
) {
    factor.restart_with(problem, |i| is_free(problem, i));
    for i in 0..problem.n {
        candidate[i] = if factor.is_free(i) { 0.0 } else { problem.bound(i) };
    }
    candidate[problem.n..].fill(0.0);
    if damp {
        factor.stand_still(problem, candidate);
    }
    for k in 0..problem.level_count() {
        for r in problem.level(k) {
            if problem.row_side[r] != Side::Free {
                factor.rhs[r] = problem.target(r) - dot::<FMA>(problem.row(r), candidate);
            }
        }
        if damp {
            factor.add_damped_level::<FMA>(problem, k);
        } else {
            factor.add_level::<FMA>(problem, k);
        }
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
