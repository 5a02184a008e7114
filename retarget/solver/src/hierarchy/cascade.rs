//! Level by level, each a small quadratic program in what is left: slower, simple to see correct, where the guess of the active set
//! over all levels does not settle.
//!
//! Stage k keeps a feasible point that is optimal for the stages before, and a working set of limits that is linearly
//! independent of their rows (what was held before, where it is that; a limit met on the way always is). Multipliers are then unique, and
//! the lowest-index rule after a while makes it finite.

use super::kernels::{add_scaled, compile_twice, dot};
use super::limits::{advance, first_limit, hold_violated_rows, let_go};
use super::multipliers::examine_level;
use super::problem::{Outcome, Problem, Release, Side};
use super::work::Work;

/// Moves per stage; beyond it the point is kept as it is and counted.
const MOST_MOVES: u32 = 400;
/// Moves before the lowest-index rule replaces the worst-sign rule.
const PATIENCE: u32 = 60;
/// Length of a step below which the stage is at its minimum, to rounding.
const STILL: f64 = 1e-12;

pub fn solve(problem: &mut Problem, work: &mut Work, outcome: &mut Outcome) {
    start(problem);
    work.multipliers.clear(problem);
    for k in 0..=problem.level_count() {
        open_stage(problem, work, k);
        if !run_stage(problem, work, k, outcome) {
            outcome.capped = true;
        }
    }
}

/// A point inside the box that agrees with the active set.
fn start(problem: &mut Problem) {
    for i in 0..problem.n {
        let inside = problem.z[i].max(problem.lo[i]).min(problem.hi[i]);
        problem.z[i] = match problem.variable_side[i] {
            Side::Free if inside.is_finite() => inside,
            Side::Free => 0.0_f64.max(problem.lo[i]).min(problem.hi[i]),
            _ => problem.bound(i),
        };
    }
    problem.z[problem.n..].fill(0.0);
}

/// Working set of stage k: what is locked, equalities, violated rows; and what the stage before held, as long as that is
/// independent of the rows of the stages before.
fn open_stage(problem: &mut Problem, work: &mut Work, k: usize) {
    let end = if k == problem.level_count() { problem.row_count() } else { problem.level_end[k] };
    let before = if k == 0 { 0 } else { problem.level_end[k - 1] };
    for r in end..problem.row_count() {
        // Rows of later levels are no limits yet.
        if problem.row_side[r] != Side::Both {
            problem.row_side[r] = Side::Free;
        }
    }
    let held_rank = rank_before(work.avx2, problem, work, k);
    work.warm_variables.clone_from(&problem.variable_side);
    work.warm_rows.clone_from(&problem.row_side);
    for i in 0..problem.n {
        if problem.variable_side[i] != Side::Both && !work.multipliers.locked[i] {
            problem.variable_side[i] = Side::Free;
        }
    }
    let mut held_rows = 0;
    for r in 0..end {
        if problem.row_side[r] != Side::Both && !work.multipliers.locked_row[r] {
            held_rows += usize::from(r < before && problem.row_side[r] != Side::Free);
            problem.row_side[r] = Side::Free;
        }
    }
    if held_rank == rank_before(work.avx2, problem, work, k) + held_rows {
        problem.variable_side.clone_from(&work.warm_variables);
        problem.row_side.clone_from(&work.warm_rows);
    }
    hold_violated_rows(work.avx2, problem, end);
}

compile_twice! {
    /// Rank of the held rows of the levels before k in the free columns.
    fn rank_before(problem: &Problem, work: &mut Work, k: usize) -> usize {
        let factor = &mut work.factor;
        factor.restart(problem);
        for level in 0..k {
            factor.add_level(problem, level);
        }
        factor.rank()
    }
}

fn run_stage(problem: &mut Problem, work: &mut Work, k: usize, outcome: &mut Outcome) -> bool {
    let end = if k == problem.level_count() { problem.row_count() } else { problem.level_end[k] };
    for moves in 0..MOST_MOVES {
        let length = direction(work.avx2, problem, work, k);
        outcome.factorizations += 1;
        // Go to the optimum of this stage, or as far as the first limit on the way, which then is held.
        if length > STILL {
            for i in 0..problem.stride {
                work.candidate[i] = problem.z[i] + work.direction[i];
            }
            match first_limit(work.avx2, problem, &work.candidate, end) {
                Some(step) => {
                    advance(problem, &work.candidate, step.share);
                    step.hold(problem);
                    continue;
                }
                None => problem.z.copy_from_slice(&work.candidate),
            }
        }
        // At the optimum. Examining locks limits for later stages, which counts only if none is held wrongly.
        work.locked.clone_from(&work.multipliers.locked);
        work.locked_row.clone_from(&work.multipliers.locked_row);
        let point = std::mem::take(&mut problem.z);
        let mut release = examine_level(work.avx2, &mut work.multipliers, problem, &work.factor, &point, k);
        problem.z = point;
        if release.is_none() {
            return true;
        }
        // Bland's rule: the lowest index instead of the worst sign, which may cycle where multipliers tie.
        if moves > PATIENCE {
            release = work.multipliers.wrong.first().copied();
        }
        std::mem::swap(&mut work.multipliers.locked, &mut work.locked);
        std::mem::swap(&mut work.multipliers.locked_row, &mut work.locked_row);
        if let Some(release) = release {
            let_go_or_turn(work.avx2, problem, release);
        }
    }
    false
}

compile_twice! {
    /// Let go of a limit. A row with two limits that was guessed to be at the wrong one is beyond the other: held there it stays in
    /// the working set, free it would be forgotten where nothing moves any more.
    fn let_go_or_turn(problem: &mut Problem, release: Release) {
        let Release::Row(r) = release else { return let_go(problem, release) };
        let held = problem.row_side[r];
        let beyond = problem.crossed(r, dot(problem.row(r), &problem.z));
        problem.row_side[r] = beyond.filter(|side| *side != held).unwrap_or_default();
    }
}

compile_twice! {
    /// Direction to the optimum of stage k that leaves the stages before alone. Returns its largest entry.
    fn direction(problem: &Problem, work: &mut Work, k: usize) -> f64 {
        let factor = &mut work.factor;
        factor.restart(problem);
        for level in 0..problem.level_count().min(k + 1) {
            for r in problem.level(level) {
                if problem.row_side[r] != Side::Free {
                    factor.rhs[r] =
                        if level < k { 0.0 } else { problem.target(r) - dot(problem.row(r), &problem.z) };
                }
            }
            factor.add_level(problem, level);
        }
        let d = &mut work.direction;
        // The last stage makes z itself short: -z, without what the rows of all levels span.
        if k == problem.level_count() {
            for i in 0..problem.stride {
                d[i] = if i < problem.n && factor.is_free(i) { -problem.z[i] } else { 0.0 };
            }
            for j in 0..factor.rank() {
                let c = dot(factor.basis_row(j), d);
                add_scaled(d, -c, factor.basis_row(j));
            }
        } else {
            d.fill(0.0);
            let first = if k == 0 { 0 } else { factor.rank_end[k - 1] };
            for j in first..factor.rank() {
                add_scaled(d, factor.y[j], factor.basis_row(j));
            }
        }
        d.iter().fold(0.0, |m: f64, v| m.max(v.abs()))
    }
}
