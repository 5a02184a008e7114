//! Limits of moves: a move stops at the first limit that it meets; rows and variables are held there or released.

use super::kernels::{compile_twice, dot};
use super::problem::{Problem, Release, Side, CROSSED};

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
    pub fn first_limit(problem: &Problem, candidate: &[f64], rows_end: usize) -> Option<Step> {
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
                let from = dot(problem.row(r), &problem.z);
                let to = dot(problem.row(r), candidate);
                meet(from, to, problem.lower[r], problem.upper[r], Release::Row(r));
            }
        }
        first
    }
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

compile_twice! {
    /// Inequality rows before `rows_end` that the present point violates join the active set.
    pub fn hold_violated_rows(problem: &mut Problem, rows_end: usize) {
        for r in 0..rows_end {
            if problem.present[r] && problem.row_side[r] == Side::Free {
                if let Some(side) = problem.crossed(r, dot(problem.row(r), &problem.z)) {
                    problem.row_side[r] = side;
                }
            }
        }
    }
}

compile_twice! {
    /// Hold every limit that `candidate` is beyond. Returns whether there was one.
    pub fn hold_crossed(problem: &mut Problem, candidate: &[f64]) -> bool {
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
                if let Some(side) = problem.crossed(r, dot(problem.row(r), candidate)) {
                    problem.row_side[r] = side;
                    crossed = true;
                }
            }
        }
        crossed
    }
}
