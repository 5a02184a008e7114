//! The problem in what its first equalities leave: fewer variables, so that every change of the active set costs a fraction.
//!
//! Where the first level that asks for equalities (planted soles, say) asks for nothing else, and what comes before it are limits that
//! can be kept along with it, the answer lies in the affine space of its least squares, `z = z0 + N w` with N orthonormal. There the box
//! and the limits above are rows of one hard level, and `||z||^2` is `||w||^2` and a constant. What breaks the hard level is left
//! to the whole problem.

use super::cascade;
use super::factor::Factor;
use super::kernels::{add_rows, compile_twice, dot, dot_rows};
use super::problem::{Outcome, Problem, Side};
use super::work::Work;

/// Below this many rows the space that is left is hardly smaller.
const FEWEST_ROWS: usize = 6;
/// A hard limit that is broken by more than this could not be kept.
const BROKEN: f64 = 1e-10;
/// A coordinate with less room than this (norm) follows from the equalities.
const FOLLOWS: f64 = 1e-7;

/// What a row of the reduced problem stands for.
#[derive(Clone, Copy)]
enum Origin {
    Variable(usize),
    Row(usize),
}

#[derive(Default)]
pub struct Reduction {
    problem: Problem,
    work: Work,
    /// N, a row for each w, padded as the rows of the whole problem are.
    space: Vec<f64>,
    /// z0.
    origin: Vec<f64>,
    /// How much of each unit vector is neither in the equalities nor yet in N.
    room: Vec<f64>,
    from: Vec<Origin>,
}

impl Reduction {
    /// Room for the largest, so that nothing is allocated on the day that the first one is needed.
    pub fn reserve(&mut self, whole: &Problem) {
        let (n, m, stride) = (whole.n, whole.row_count(), whole.stride);
        if self.space.capacity() >= n * stride && self.from.capacity() >= n + m {
            return;
        }
        self.space.reserve(n * stride);
        self.origin.reserve(stride);
        self.room.reserve(n);
        self.from.reserve(n + m);
        // A first solve of the largest size makes the buffers.
        self.problem.level_end = vec![n + m; whole.level_count() + 1];
        self.problem.reshape(n);
        self.work.prepare(&self.problem);
    }
}

/// Forget all levels, with every column free whose limits leave it room.
fn restart_unlimited(factor: &mut Factor, problem: &Problem) {
    factor.restart(problem);
    for (mask, side) in factor.mask.iter_mut().zip(&problem.variable_side) {
        *mask = f64::from(u8::from(*side != Side::Both));
    }
}

/// Solve in the space that the first equalities leave. False, with the problem as it was, where there is none or it does not hold the answer.
pub fn solve(problem: &mut Problem, work: &mut Work, reduction: &mut Reduction, outcome: &mut Outcome) -> bool {
    let Some(level) = first_equalities(problem) else { return false };
    let solved = leave_space(work.avx2, problem, work, reduction, level)
        && write(work.avx2, problem, work, reduction, level)
        && settle(reduction, outcome);
    if solved {
        outcome.reduced = true;
        read(work.avx2, problem, reduction);
    }
    solved
}

/// The first level with equalities, if it has no limits.
fn first_equalities(problem: &Problem) -> Option<usize> {
    let equal = |r: &usize| problem.row_side[*r] == Side::Both;
    let present = |k| problem.level(k).filter(|r| problem.present[*r]);
    let level = (0..problem.level_count()).find(|k| present(*k).any(|r| equal(&r)))?;
    (present(level).count() >= FEWEST_ROWS && present(level).all(|r| equal(&r))).then_some(level)
}

compile_twice! {
    /// z0 and N of the equalities of a level. False where digits were lost.
    fn leave_space(problem: &Problem, work: &mut Work, to: &mut Reduction, level: usize) -> bool {
        let (n, stride, factor) = (problem.n, problem.stride, &mut work.factor);
        restart_unlimited(factor, problem);
        to.origin.clear();
        to.origin.extend((0..n).map(|i| if factor.is_free(i) { 0.0 } else { problem.bound(i) }));
        to.origin.resize(stride, 0.0);
        factor.ask(problem, level, &to.origin);
        factor.add_rows(problem, level);
        factor.solve_level(0);
        factor.add_candidate(&mut to.origin);

        let rank = factor.rank();
        let basis = &factor.basis[..rank * stride];
        to.room.clear();
        to.room.extend((0..n).map(|i| f64::from(u8::from(factor.is_free(i)))));
        for row in basis.chunks_exact(stride) {
            to.room.iter_mut().zip(row).for_each(|(room, q)| *room -= q * q);
        }
        let left = (0..n).filter(|i| factor.is_free(*i)).count() - rank;
        to.space.clear();
        for j in 0..left {
            let Some(widest) = (0..n).max_by(|a, b| to.room[*a].total_cmp(&to.room[*b])) else { return false };
            if to.room[widest] < FOLLOWS {
                return false;
            }
            to.space.resize((j + 1) * stride, 0.0);
            let (before, new) = to.space.split_at_mut(j * stride);
            new[widest] = 1.0;
            for _ in 0..2 {
                for rows in [basis, &*before] {
                    let count = rows.len() / stride;
                    work.candidate.resize(n.max(stride), 0.0);
                    dot_rows(new, rows, &mut work.candidate[..count]);
                    add_rows(new, -1.0, &work.candidate[..count], rows);
                }
            }
            let inverse = 1.0 / dot(new, new).sqrt();
            new.iter_mut().for_each(|v| *v *= inverse);
            to.room.iter_mut().zip(&*new).for_each(|(room, v)| *room -= v * v);
        }
        work.candidate.truncate(stride);
        true
    }
}

compile_twice! {
    /// Rows and limits of the reduced problem, its guess and its start. False where a coordinate that follows is beyond its limits.
    fn write(problem: &Problem, work: &Work, to: &mut Reduction, level: usize) -> bool {
        let (n, stride) = (problem.n, problem.stride);
        let left = to.space.len() / stride;
        to.from.clear();
        to.from.extend((0..n).filter(|i| problem.variable_side[*i] != Side::Both).map(Origin::Variable));
        let above = if level == 0 { 0 } else { problem.level_end[level - 1] };
        to.from.extend((0..above).filter(|r| problem.present[*r]).map(Origin::Row));
        let inner = &mut to.problem;
        inner.level_end.clear();
        inner.level_end.push(to.from.len());
        for k in level + 1..problem.level_count() {
            to.from.extend(problem.level(k).filter(|r| problem.present[*r]).map(Origin::Row));
            inner.level_end.push(to.from.len());
        }
        inner.reshape(left);
        for (r, origin) in to.from.iter().enumerate() {
            let (lower, upper, side, at) = match *origin {
                Origin::Variable(i) => {
                    for (j, c) in inner.rows[r * inner.stride..][..left].iter_mut().enumerate() {
                        *c = to.space[j * stride + i];
                    }
                    (problem.lo[i], problem.hi[i], problem.variable_side[i], to.origin[i])
                }
                Origin::Row(row) => {
                    let coefficients = problem.row(row);
                    dot_rows(coefficients, &to.space, &mut inner.rows[r * inner.stride..][..left]);
                    let at = dot(coefficients, &to.origin);
                    (problem.lower[row], problem.upper[row], problem.row_side[row], at)
                }
            };
            let row = inner.row(r);
            if r < inner.level_end[0] && dot(row, row) < FOLLOWS * FOLLOWS {
                if at < lower - BROKEN || at > upper + BROKEN {
                    return false;
                }
                inner.present[r] = false;
                inner.row_side[r] = Side::Free;
                continue;
            }
            (inner.lower[r], inner.upper[r]) = (lower - at, upper - at);
            (inner.present[r], inner.row_side[r]) = (true, side);
        }
        dot_rows(&problem.z, &to.space, &mut inner.z[..left]);
        let inner_work = &mut to.work;
        inner_work.prepare(inner);
        // Ranks are judged by the size of the rows as they were.
        let scales = &work.factor.level_scale;
        inner_work.factor.level_scale[0] = scales[..level].iter().fold(1.0, |most: f64, s| most.max(*s));
        inner_work.factor.level_scale[1..].copy_from_slice(&scales[level + 1..]);
        true
    }
}

/// Solve the reduced problem. False where its hard level is broken.
fn settle(reduction: &mut Reduction, outcome: &mut Outcome) -> bool {
    let work = &mut reduction.work;
    cascade::solve(&mut reduction.problem, work, outcome);
    is_kept(work.avx2, &reduction.problem)
}

compile_twice! {
    /// The hard level is.
    fn is_kept(inner: &Problem) -> bool {
        (0..inner.level_end[0]).filter(|r| inner.present[*r]).all(|r| {
            let value = dot(inner.row(r), &inner.z);
            value >= inner.lower[r] - BROKEN && value <= inner.upper[r] + BROKEN
        })
    }
}

compile_twice! {
    /// The answer and its active set, for the whole problem.
    fn read(problem: &mut Problem, from: &Reduction) {
        problem.z.copy_from_slice(&from.origin);
        let left = from.space.len() / problem.stride;
        add_rows(&mut problem.z, 1.0, &from.problem.z[..left], &from.space);
        for (r, origin) in from.from.iter().enumerate() {
            let side = from.problem.row_side[r];
            match *origin {
                Origin::Variable(i) => problem.variable_side[i] = side,
                Origin::Row(row) => problem.row_side[row] = side,
            }
        }
    }
}
