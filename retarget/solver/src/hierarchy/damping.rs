//! Damping of near-singular levels: their targets become what a damped step reaches, for the whole solve.
//!
//! How much is for the caller to say (`progress`). Damping inside the active-set loop would change the problem with every change of the active
//! set; a changed target is a convex problem like any other, solved exactly. What is closed stays closed, and away from
//! singularities nothing is changed.

use super::factor::Factor;
use super::kernels::{add_rows, dot_rows};
use super::problem::Problem;

/// Pivots above this many times the damping are not damped.
const REACH: f64 = 2.5;
/// Damped directions go where the last level attracts them, by this much (weighted rad) in one step. Standing still instead, a limb would
/// creep on until it is stretched, and shake there; a larger pull would keep it from a goal that it can reach.
const ATTRACTION: f64 = 0.2;
/// A variable that has no room left stops no step shorter than this.
const LEEWAY: f64 = 1e-4;

impl Factor {
    /// Room for whatever a level may need, so that nothing is allocated on the day that the first level is damped.
    pub(super) fn make_room(&mut self, problem: &Problem) {
        let m = problem.row_count();
        for buffer in [&mut self.held, &mut self.path, &mut self.step] {
            buffer.resize(self.stride, 0.0);
        }
        let most = self.width.max(m);
        for buffer in
            [&mut self.y, &mut self.damping, &mut self.exact, &mut self.again, &mut self.still, &mut self.moved]
        {
            buffer.reserve(most.saturating_sub(buffer.len()));
        }
        self.small.reserve(2 * m, self.width);
        self.pivot_row.reserve(most.saturating_sub(self.pivot_row.len()));
        self.members.reserve(m.saturating_sub(self.members.len()));
        self.rank_end.reserve(problem.level_count().saturating_sub(self.rank_end.len()));
    }

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

    /// Where the levels so far go.
    pub fn path(&self) -> &[f64] {
        &self.path
    }

    /// One more level of the path, as it is.
    #[inline(always)]
    pub fn add_path_level<const FMA: bool>(&mut self, problem: &Problem, k: usize) {
        self.solve_path_level::<FMA>(problem, k);
        self.own_step::<FMA>(self.first_of(k));
        self.walk(1.0);
    }

    /// One more level of the path, which asks for less: near-singular directions are damped towards what the last level wants,
    /// and a step of little haste is shortened until it fits the box, so that nothing else is thrown about to make up for a joint
    /// that is too slow. The level's targets become what that step reaches, and stay so for the rest of the solve.
    #[inline(always)]
    pub fn add_damped_level<const FMA: bool>(&mut self, problem: &mut Problem, k: usize) {
        self.solve_path_level::<FMA>(problem, k);
        let first = self.first_of(k);
        self.exact.clear();
        self.exact.extend_from_slice(&self.y[first..]);
        for &r in &self.members {
            // Back to what was asked, for the second solve.
            self.residual[r] = self.reached(r, first) - self.residual[r];
        }
        self.least_squares(first, REACH * problem.damping[k]);
        self.own_step::<FMA>(first);
        let share = 1.0 - problem.patience[k] * (1.0 - self.share_inside(problem));
        for (y, still) in self.y[first..].iter_mut().zip(&self.still[first..]) {
            *y = still + share * (*y - still);
        }
        self.lower_targets(problem, first);
        self.walk(share);
    }

    #[inline(always)]
    fn solve_path_level<const FMA: bool>(&mut self, problem: &Problem, k: usize) {
        let held = std::mem::take(&mut self.held);
        self.ask::<FMA>(problem, k, &held);
        self.held = held;
        self.add_level::<FMA>(problem, k);
        let (first, rank) = (self.first_of(k), self.rank());
        self.still.resize(rank, 0.0);
        dot_rows::<FMA>(&problem.still, &self.basis[first * self.stride..], &mut self.still[first..]);
    }

    /// What the level's own directions add to standing still.
    #[inline(always)]
    fn own_step<const FMA: bool>(&mut self, first: usize) {
        self.moved.clear();
        self.moved.extend(self.y[first..].iter().zip(&self.still[first..]).map(|(y, s)| y - s));
        self.step.clear();
        self.step.resize(self.stride, 0.0);
        add_rows::<FMA>(&mut self.step, 1.0, &self.moved, &self.basis[first * self.stride..]);
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

    /// The level asks for what its `y` reaches, and for what nothing reaches as before.
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

    /// min ||L y - b||^2 + sum_j d_j^2 y_j^2 (towards y_j = stays still_j), with d_j zero for pivots above the damping threshold.
    pub(super) fn least_squares(&mut self, first: usize, damping_from: f64) {
        let (count, rank) = (self.members.len(), self.rank());
        let new = rank - first;
        self.damping.clear();
        for j in first..rank {
            let pivot = self.coefficient(self.pivot_row[j], j);
            if pivot < damping_from {
                let share = pivot / damping_from;
                self.damping.push(damping_from / REACH * (1.0 - share * share).sqrt());
            } else {
                self.damping.push(0.0);
            }
        }
        let damped = self.damping.iter().filter(|d| **d > 0.0).count();
        self.small.start(count + damped, new);
        for (slot, &r) in self.members.iter().enumerate() {
            for c in 0..new {
                self.small.set(slot, c, self.coefficients[r * self.width + first + c]);
            }
            self.small.set_target(slot, self.residual[r]);
        }
        let mut extra = count;
        for (c, d) in self.damping.iter().enumerate() {
            if *d > 0.0 {
                self.small.set(extra, c, *d);
                self.small.set_target(extra, *d * self.stays * self.still[first + c]);
                extra += 1;
            }
        }
        self.small.solve(&mut self.y[first..]);
    }
}
