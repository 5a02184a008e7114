//! One active set over all levels: solve for the guess, verify it; else move as far as limits permit, hold what was met,
//! or let go of what is held wrongly, and solve again. The guess is the last iteration's active set, so that most often
//! one factorization is all.

use super::factor::Factor;
use super::kernels::dot;
use super::multipliers::Release;
use super::problem::{Outcome, Problem, Side, CROSSED};
use super::{cascade, Workspace};

/// Factorizations before the level-by-level method takes over.
const MOST_CHANGES: u32 = 30;
/// A step of less than this share of its way is none.
const STILL: f64 = 1e-9;
/// Rounds in which a damped level finds the ends of ranges that it runs into.
const MOST_STOPS: u32 = 8;

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
    damp::<FMA>(problem, work, &mut outcome);
    settle::<FMA>(problem, work, &mut outcome);
    outcome
}

/// Lower the targets of damped levels, each by looking at the levels above it alone.
///
/// It starts from no active set at all: one that the solve before left behind knows what lower levels want.
#[inline(always)]
fn damp<const FMA: bool>(problem: &mut Problem, work: &mut Workspace, outcome: &mut Outcome) {
    work.warm_variables.clone_from(&problem.variable_side);
    work.warm_rows.clone_from(&problem.row_side);
    for side in problem.variable_side.iter_mut().chain(&mut problem.row_side) {
        if *side != Side::Both {
            *side = Side::Free;
        }
    }
    let damped_end = problem.damping.iter().rposition(|d| *d > 0.0).map_or(0, |k| k + 1);
    work.factor.start_path(problem);
    outcome.factorizations += 1;
    for k in 0..damped_end {
        let rows = problem.level(k);
        work.asked.clear();
        work.asked.extend_from_slice(&problem.lower[rows.clone()]);
        for round in 1..=MOST_STOPS {
            if problem.damping[k] > 0.0 {
                work.factor.add_damped_level::<FMA>(problem, k);
            } else {
                work.factor.add_path_level::<FMA>(problem, k);
            }
            if round == MOST_STOPS || !hold_what_stops::<FMA>(problem, work.factor.path(), rows.end) {
                break;
            }
            // Again with what was met held. What the levels above ask for stays.
            for (r, asked) in rows.clone().zip(&work.asked) {
                if problem.row_side[r] == Side::Both {
                    problem.lower[r] = *asked;
                    problem.upper[r] = *asked;
                }
            }
            work.factor.start_path(problem);
            outcome.factorizations += 1;
            for above in 0..k {
                work.factor.add_path_level::<FMA>(problem, above);
            }
        }
    }
    start_from_path(problem, work);
}

/// The end of the path meets the lowered targets; what holds it there joins what the solve before held.
fn start_from_path(problem: &mut Problem, work: &Workspace) {
    problem.row_side.clone_from(&work.warm_rows);
    let path = work.factor.path();
    for i in 0..problem.n {
        let side = &mut problem.variable_side[i];
        if *side == Side::Free {
            *side = work.warm_variables[i];
        }
        if *side == Side::Free && path[i] > problem.hi[i] {
            *side = Side::Upper;
        } else if *side == Side::Free && path[i] < problem.lo[i] {
            *side = Side::Lower;
        }
        problem.z[i] = path[i].max(problem.lo[i]).min(problem.hi[i]);
    }
}

/// Hold variables that `path` takes beyond the end of their range, and the first row before `rows_end` that it crosses. False if
/// there are none.
#[inline(always)]
fn hold_what_stops<const FMA: bool>(problem: &mut Problem, path: &[f64], rows_end: usize) -> bool {
    let mut met = false;
    for i in 0..problem.n {
        if problem.variable_side[i] != Side::Free {
            continue;
        }
        if problem.hi_is_stop[i] && path[i] > problem.hi[i] + CROSSED {
            problem.variable_side[i] = Side::Upper;
            met = true;
        } else if problem.lo_is_stop[i] && path[i] < problem.lo[i] - CROSSED {
            problem.variable_side[i] = Side::Lower;
            met = true;
        }
    }
    met | hold_first_row::<FMA>(problem, path, rows_end)
}

/// Hold the first row that is met on the way from standing still to the end of `path`: those behind it may never be met.
#[inline(always)]
fn hold_first_row<const FMA: bool>(problem: &mut Problem, path: &[f64], rows_end: usize) -> bool {
    let mut first: Option<(f64, usize, Side)> = None;
    for r in 0..rows_end {
        if !problem.present[r] || problem.row_side[r] != Side::Free {
            continue;
        }
        let (from, to) = (dot::<FMA>(problem.row(r), &problem.still), dot::<FMA>(problem.row(r), path));
        if let Some(side) = problem.crossed(r, to) {
            let limit = if side == Side::Upper { problem.upper[r] } else { problem.lower[r] };
            let share = if to == from { 0.0 } else { ((limit - from) / (to - from)).max(0.0) };
            if first.is_none_or(|(least, ..)| share < least) {
                first = Some((share, r, side));
            }
        }
    }
    first.is_some_and(|(_, r, side)| {
        problem.row_side[r] = side;
        true
    })
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
