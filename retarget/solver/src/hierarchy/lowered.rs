//! Damped levels: each finds the limits on its way by looking at the levels above it alone, and moves its targets nearer.

use super::kernels::{compile_twice, dot};
use super::problem::{Outcome, Problem, Side, CROSSED};
use super::work::Work;

/// Rounds in which a damped level finds the ends of ranges and the rows that it runs into.
const MOST_STOPS: u32 = 8;

compile_twice! {
    /// Lower the targets of damped levels, each by looking at the levels above it alone.
    ///
    /// It starts from no active set at all: that of the solve before depends on what lower levels want.
    pub fn lower(problem: &mut Problem, work: &mut Work, outcome: &mut Outcome) {
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
}

/// The end of the path meets the lowered targets. What holds it there is mostly not what holds the answer, which is what the solve
/// before held.
fn start_from_path(problem: &mut Problem, work: &Work) {
    problem.variable_side.clone_from(&work.warm_variables);
    problem.row_side.clone_from(&work.warm_rows);
    let path = work.factor.path();
    for i in 0..problem.n {
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
