//! Damping of near-singular levels: their targets become what a damped step reaches, for the whole solve.
//!
//! The caller gives the amount (`progress`). Damping inside the active-set loop would change the problem with every change of the active
//! set; a changed target is a convex problem like any other, solved exactly. What is closed stays closed, and away from
//! singularities nothing is changed. Each damped level finds the limits on its way by looking at the levels above it alone.

use super::factor::{Factor, REACH};
use super::kernels::{add_rows, compile_twice, dot, dot_rows};
use super::problem::{Outcome, Problem, Side, CROSSED};
use super::work::Work;

/// Damped directions go where the last level attracts them, by this much (weighted rad) in one step. Standing still instead, a limb would
/// creep on until it is stretched, and shake there; a larger pull would keep it from a goal that it can reach.
const ATTRACTION: f64 = 0.2;
/// A variable that has no room left stops no step shorter than this.
const LEEWAY: f64 = 1e-4;

impl Factor {
    /// Before the first level: held variables at their bounds, the others still.
    #[inline(always)]
    pub fn start_path(&mut self, problem: &Problem) {
        self.restart(problem);
        let attraction = problem.still.iter().map(|s| s * s).sum::<f64>().sqrt();
        self.stays = 1.0 - (ATTRACTION / attraction).min(1.0);
        self.held.clear();
        self.held.resize(problem.stride, 0.0);
        self.path.clone_from(&problem.still);
        for i in 0..problem.n {
            if !self.is_free(i) {
                self.held[i] = problem.bound(i);
                self.path[i] = self.held[i];
            }
        }
    }

    /// One more level of the path, as it is.
    #[inline(always)]
    pub fn add_path_level(&mut self, problem: &Problem, k: usize) {
        self.solve_path_level(problem, k);
        self.own_step(self.first_of(k));
        self.walk(1.0);
    }

    /// One more level of the path, with nearer targets: near-singular directions are damped towards what the last level wants,
    /// and a damped step is shortened until it fits the box, so that no other joint moves far to make up for one that is too slow.
    /// The level's targets become what that step reaches, and stay so for the rest of the solve.
    #[inline(always)]
    pub fn add_damped_level(&mut self, problem: &mut Problem, k: usize) {
        self.solve_path_level(problem, k);
        let first = self.first_of(k);
        self.exact.clear();
        self.exact.extend_from_slice(&self.y[first..]);
        for &r in &self.members {
            // Back to what was asked, for the second solve.
            self.residual[r] = self.reached(r, first) - self.residual[r];
        }
        self.least_squares(first, REACH * problem.damping[k]);
        self.own_step(first);
        let share = 1.0 - problem.patience[k] * (1.0 - self.share_inside(problem));
        for (y, still) in self.y[first..].iter_mut().zip(&self.still[first..]) {
            *y = still + share * (*y - still);
        }
        self.lower_targets(problem, first);
        self.walk(share);
    }

    /// Limits of a level that the path of the levels above crosses ask for the share L^2 / (L^2 + s^2) of what is missing. L: the lever,
    /// the length of what the levels above leave of the row; s: the level's short lever. Else a limit whose lever is next to
    /// nothing would use up the speed of the whole body, which the levels above need in the next iteration.
    #[inline(always)]
    pub fn lower_short_limits(&mut self, problem: &mut Problem, k: usize) {
        let short = problem.short_lever[k] * problem.short_lever[k];
        for r in problem.level(k) {
            let reached = dot(problem.row(r), &self.path);
            let missing = problem.lower[r] - reached;
            if problem.present[r] && missing > 0.0 {
                let lever = self.left_of(problem.row(r));
                problem.lower[r] = reached + missing * lever / (lever + short);
            }
        }
    }

    #[inline(always)]
    fn solve_path_level(&mut self, problem: &Problem, k: usize) {
        let held = std::mem::take(&mut self.held);
        self.ask(problem, k, &held);
        self.held = held;
        self.add_level(problem, k);
        let (first, rank) = (self.first_of(k), self.rank());
        self.still.resize(rank, 0.0);
        dot_rows(&problem.still, &self.basis[first * self.stride..], &mut self.still[first..]);
    }

    /// What the level's own directions add to standing still.
    #[inline(always)]
    fn own_step(&mut self, first: usize) {
        self.moved.clear();
        self.moved.extend(self.y[first..].iter().zip(&self.still[first..]).map(|(y, s)| y - s));
        self.step.clear();
        self.step.resize(self.stride, 0.0);
        add_rows(&mut self.step, 1.0, &self.moved, &self.basis[first * self.stride..]);
    }

    fn walk(&mut self, share: f64) {
        for (path, step) in self.path.iter_mut().zip(&self.step) {
            *path += share * step;
        }
    }

    /// The largest share of the step that stays in the box.
    fn share_inside(&self, problem: &Problem) -> f64 {
        let mut share: f64 = 1.0;
        for i in (0..problem.n).filter(|i| self.is_free(*i)) {
            let (at, step) = (self.path[i], self.step[i]);
            let room = if step > 0.0 { problem.hi[i] - at } else { at - problem.lo[i] };
            let room = room.max(0.0) + LEEWAY;
            if step.abs() > room {
                share = share.min(room / step.abs());
            }
        }
        share
    }

    /// Set the level's targets to what its `y` reaches, and leave what nothing reaches as before.
    fn lower_targets(&mut self, problem: &mut Problem, first: usize) {
        for slot in 0..self.members.len() {
            let r = self.members[slot];
            let row = &self.coefficients[r * self.width + first..];
            let taken_back: f64 =
                row.iter().zip(&self.y[first..]).zip(&self.exact).map(|((c, y), e)| c * (e - y)).sum();
            if problem.is_equality(r) {
                problem.lower[r] -= taken_back;
                problem.upper[r] = problem.lower[r];
                self.residual[r] -= taken_back;
            }
            self.residual[r] = self.reached(r, first) - self.residual[r];
        }
    }
}

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
        let lowers = |k: &usize| problem.damping[*k] > 0.0 || problem.short_lever[*k] > 0.0;
        let damped_end = (0..problem.level_count()).rev().find(lowers).map_or(0, |k| k + 1);
        work.factor.start_path(problem);
        outcome.factorizations += 1;
        for k in 0..damped_end {
            let rows = problem.level(k);
            if problem.short_lever[k] > 0.0 {
                work.factor.lower_short_limits(problem, k);
            }
            work.asked.clear();
            work.asked.extend_from_slice(&problem.lower[rows.clone()]);
            for round in 1..=MOST_STOPS {
                if problem.damping[k] > 0.0 {
                    work.factor.add_damped_level(problem, k);
                } else {
                    work.factor.add_path_level(problem, k);
                }
                if round == MOST_STOPS || !hold_what_stops(problem, &work.factor.path, rows.end) {
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
                    work.factor.add_path_level(problem, above);
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
    let path = &work.factor.path;
    for i in 0..problem.n {
        problem.z[i] = path[i].max(problem.lo[i]).min(problem.hi[i]);
    }
}

/// Hold variables that `path` takes beyond the end of their range, and the first row before `rows_end` that it crosses. False if
/// there are none.
#[inline(always)]
fn hold_what_stops(problem: &mut Problem, path: &[f64], rows_end: usize) -> bool {
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
    met | hold_first_row(problem, path, rows_end)
}

/// Hold the first row that is met on the way from standing still to the end of `path`: those behind it may never be met.
#[inline(always)]
fn hold_first_row(problem: &mut Problem, path: &[f64], rows_end: usize) -> bool {
    let mut first: Option<(f64, usize, Side)> = None;
    for r in 0..rows_end {
        if !problem.present[r] || problem.row_side[r] != Side::Free {
            continue;
        }
        let (from, to) = (dot(problem.row(r), &problem.still), dot(problem.row(r), path));
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
