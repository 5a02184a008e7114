//! Inequality rows of pairs, n . J dq >= what is left of the approach, written into a hierarchy problem.

use super::law::Mode;
use super::set::Mover;
use super::task::Activation;
use super::watch::Watch;
use crate::body::Body;
use crate::geometry::Nearest;
use crate::hierarchy::{Problem, Side};
use crate::kinematics::Pose;
use crate::math::*;

/// Share of the fastest way out that a pair may ask for in one iteration.
const EASE: f64 = 0.25;

impl Watch {
    /// Rows of all pairs that act, in the variables of the hierarchy. Returns whether rows wait for a trial.
    pub fn write_rows(
        &mut self,
        body: &Body,
        pose: &Pose,
        problem: &mut Problem,
        shift: &Shift<'_>,
        first: bool,
    ) -> bool {
        self.clear_rows(problem);
        if self.activation == Activation::All {
            self.wake_expected(first);
        }
        self.write_rows_from(0, body, pose, problem, shift, first)
    }

    /// The rows of those pairs in `near` from `start` on.
    pub fn write_rows_from(
        &mut self,
        start: usize,
        body: &Body,
        pose: &Pose,
        problem: &mut Problem,
        shift: &Shift<'_>,
        first: bool,
    ) -> bool {
        let mut waiting = false;
        for index in start..self.near.len() {
            let k = self.near[index];
            let waits = self.activation != Activation::All && self.pairs[k].mode != Mode::Reactive;
            let (prevents, reacts) = self.task_of[k];
            let task = if self.pairs[k].mode == Mode::Reactive { reacts } else { prevents };
            let Some(t) = task else { continue };
            let task = &mut self.tasks[t];
            if !task.on || 2 * task.used.len() == task.rows {
                continue;
            }
            let r = task.first_row + task.used.len();
            task.used.push(k);
            let asked = if waits { 0.0 } else { self.asked(k) };
            let Nearest { a, b, normal, .. } = self.pairs[k].nearest;
            self.write_row(k, r, &Place { a, b, normal, asked, pose, more: None }, body, problem, shift);
            if asked > 0.0 {
                ease(problem, r, asked);
            }
            let state = &self.pairs[k];
            problem.row_side[r] = if first { state.first_side } else { state.side };
            problem.present[r] = !waits && may_be_crossed(problem, r);
            waiting |= waits;
            if waits || state.mode == Mode::Reactive {
                continue;
            }
            if let Some(place) = self.at_rest(k) {
                let task = &self.tasks[t];
                let r = task.first_row + task.rows - 1 - task.at_rest.len();
                self.write_row(k, r, &place, body, problem, shift);
                self.tasks[t].at_rest.push(k);
                problem.row_side[r] = self.pairs[k].rest_side;
                problem.present[r] = may_be_crossed(problem, r);
            }
        }
        waiting
    }

    /// The row about the posture of rest, n . J (sum dq - dt v) >= share (min(margin, floor) - distance); None: the pair is far enough
    /// apart there.
    fn at_rest(&self, k: usize) -> Option<Place<'_>> {
        let (state, rest) = (&self.pairs[k], &self.rest);
        let Nearest { a, b, normal, distance } = state.at_rest?;
        let asked = (self.set.pairs[k].margin.min(state.floor) - distance) * rest.share;
        Some(Place { a, b, normal, asked, pose: &rest.pose, more: Some(&rest.left) })
    }

    fn clear_rows(&mut self, problem: &mut Problem) {
        for task in &mut self.tasks {
            problem.present[task.first_row..task.first_row + task.used.len()].fill(false);
            let end = task.first_row + task.rows;
            problem.present[end - task.at_rest.len()..end].fill(false);
            task.used.clear();
            task.at_rest.clear();
        }
    }

    /// Least n . J dq of a pair.
    fn asked(&self, k: usize) -> f64 {
        let state = &self.pairs[k];
        let distance = state.nearest.distance;
        let all = self.activation == Activation::All;
        let floor = if all { state.floor } else { self.floor_from(k, distance, self.dt * self.iteration) };
        floor - distance + self.drift(k)
    }

    /// The row n . J dq >= asked of a pair in a place.
    fn write_row(&self, k: usize, r: usize, place: &Place<'_>, body: &Body, problem: &mut Problem, shift: &Shift<'_>) {
        let row = problem.row_mut(r);
        row.fill(0.0);
        // The hierarchy solves for z, with dq = reference + scale z: columns take the scale, the limit what the reference
        // moves.
        let mut moved = 0.0;
        for &(Mover { dof, sign, .. }, c) in &self.movers[k] {
            let point = if sign > 0.0 { place.a } else { place.b };
            let value = sign * dot(place.normal, body.point_column(place.pose, dof, point));
            moved += value * (shift.reference[dof] - place.more.map_or(0.0, |more| more[dof]));
            row[c] = value * shift.scale[dof];
        }
        problem.lower[r] = place.asked - moved;
        problem.upper[r] = f64::INFINITY;
    }

    /// Remember which rows held.
    pub fn keep_sides(&mut self, problem: &Problem, first: bool) {
        for &k in &self.near {
            (self.pairs[k].side, self.pairs[k].rest_side) = (Side::Free, Side::Free);
        }
        for task in &self.tasks {
            for (index, &k) in task.used.iter().enumerate() {
                let r = task.first_row + index;
                self.pairs[k].side = if problem.present[r] { problem.row_side[r] } else { Side::Free };
            }
            for (index, &k) in task.at_rest.iter().enumerate() {
                let r = task.first_row + task.rows - 1 - index;
                self.pairs[k].rest_side = if problem.present[r] { problem.row_side[r] } else { Side::Free };
            }
        }
        if first {
            for pair in &mut self.pairs {
                pair.first_side = pair.side;
            }
        }
    }
}

/// A point of either side of a pair in a posture, the normal between them, and least n . J dq there: `asked`, and what `more` moves.
struct Place<'a> {
    a: Vec3,
    b: Vec3,
    normal: Vec3,
    asked: f64,
    pose: &'a Pose,
    more: Option<&'a [f64]>,
}

/// From dq to the hierarchy's variables z: dq = reference + scale z.
pub struct Shift<'a> {
    pub reference: &'a [f64],
    pub scale: &'a [f64],
}

/// Ask for no more than a share of the way out that the box allows: joints that cannot get out in one frame would all go as far as
/// they may, those that carry the body as well, and lower levels could keep nothing.
fn ease(problem: &mut Problem, r: usize, asked: f64) {
    let row = problem.row(r);
    let still = problem.lower[r] - asked;
    let reach = |i: &usize| (row[*i] * problem.lo[*i]).max(row[*i] * problem.hi[*i]);
    let most: f64 = (0..problem.n).filter(|i| row[*i] != 0.0).map(|i| reach(&i)).sum();
    if most > still {
        problem.lower[r] = problem.lower[r].min(still + EASE * (most - still));
    }
}

/// Whether any point of the box lies below the row's lower limit; if none does, the row asks for nothing.
fn may_be_crossed(problem: &Problem, r: usize) -> bool {
    let row = problem.row(r);
    let mut least = 0.0;
    for i in 0..problem.n {
        if row[i] != 0.0 {
            least += (row[i] * problem.lo[i]).min(row[i] * problem.hi[i]);
        }
    }
    !(least >= problem.lower[r])
}
