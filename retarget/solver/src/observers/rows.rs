//! Inequality rows n . J dq >= required of pairs, written into a hierarchy problem.

use super::law::Mode;
use super::monitor::PairMonitor;
use super::rest::Rest;
use super::set::Mover;
use super::task::{Activation, ROWS};
use crate::body::Body;
use crate::geometry::Nearest;
use crate::hierarchy::Problem;
use crate::kinematics::Pose;
use crate::math::*;

/// Share of the motion that the box allows beyond standing still, or braking, that a row may require in one iteration.
const EASE: f64 = 0.25;

impl PairMonitor {
    /// Write rows of all active pairs, in the variables of the hierarchy. Returns true if rows wait for a trial.
    pub fn write_rows(&mut self, problem: &mut Problem, at: &Iteration<'_>) -> bool {
        for task in &mut self.tasks {
            problem.present[task.first_row..task.first_row + ROWS * task.pairs].fill(false);
            task.used.clear();
        }
        if self.activation == Activation::All {
            self.wake_expected();
        }
        self.write_rows_from(0, problem, at)
    }

    /// Write the rows of pairs in `near` from `start` on.
    pub fn write_rows_from(&mut self, start: usize, problem: &mut Problem, at: &Iteration<'_>) -> bool {
        let mut waiting = false;
        for index in start..self.near.len() {
            let k = self.near[index];
            let waits = self.activation != Activation::All && self.pairs[k].mode != Mode::Reactive;
            let (prevents, reacts) = self.task_of[k];
            let task = if self.pairs[k].mode == Mode::Reactive { reacts } else { prevents };
            let Some(t) = task else { continue };
            let task = &mut self.tasks[t];
            if !task.on || task.used.len() == task.pairs {
                continue;
            }
            let rows = task.rows_of(task.used.len());
            task.used.push(k);
            let required = if waits { 0.0 } else { self.required(k) };
            let now = Some(RowPlace { nearest: self.pairs[k].nearest, required, pose: at.pose, rest: None });
            for (r, place) in rows.into_iter().zip([now, self.at_rest(k), self.at_before(k, at.pose)]) {
                let Some(place) = place else { continue };
                let may_be_crossed = self.write_row(k, r, &place, problem, at);
                problem.present[r] = !waits && may_be_crossed;
            }
            waiting |= waits;
        }
        waiting
    }

    /// The row at rest, n . J (sum dq - share displacement) >= share (min(margin, floor) - distance). None if the pair is far enough
    /// apart there, or in contact now.
    fn at_rest(&self, k: usize) -> Option<RowPlace<'_>> {
        let (state, rest) = (&self.pairs[k], &self.rest);
        let (nearest, i) = state.at_rest.filter(|_| state.mode != Mode::Reactive)?;
        let required = (self.set.pairs[k].margin.min(state.floor) - nearest.distance) * rest.share;
        Some(RowPlace { nearest, required, pose: &rest.foreseen[i].pose, rest: Some(rest) })
    }

    /// The row at the nearest points of before, if they were elsewhere. On parallel faces the nearest points jump from end to end.
    fn at_before<'a>(&self, k: usize, pose: &'a Pose) -> Option<RowPlace<'a>> {
        let state = &self.pairs[k];
        let (a, b) = state.before.filter(|_| state.mode != Mode::Reactive)?;
        let (first, second) = self.set.sides(k, &self.solids, &self.fixtures);
        let normal = state.nearest.normal;
        let (a, b) = (first.world(a), second.world(b));
        let distance = dot(normal, sub(a, b));
        let required = state.floor - distance.max(state.nearest.distance);
        Some(RowPlace { nearest: Nearest { distance, a, b, normal }, required, pose, rest: None })
    }

    /// Least n . J dq of a pair, m.
    fn required(&self, k: usize) -> f64 {
        let state = &self.pairs[k];
        let distance = state.nearest.distance;
        let all = self.activation == Activation::All;
        let floor = if all { state.floor } else { self.floor_from(k, distance, self.dt * self.iteration) };
        floor - distance + self.drift(k)
    }

    /// Write the row n . J dq >= required of a pair. Returns false if all of the box keeps it.
    ///
    /// It requires no more than the value of standing still (of braking, in the row at rest) plus the share `EASE` of the motion that
    /// the box allows beyond it. Otherwise joints that cannot separate the pair in one frame would all move to their limits, those
    /// that carry the body too, and lower levels could keep nothing.
    fn write_row(&self, k: usize, r: usize, place: &RowPlace<'_>, problem: &mut Problem, at: &Iteration<'_>) -> bool {
        let Nearest { a, b, normal, .. } = place.nearest;
        let (mut limit, mut still, mut least, mut most) = (place.required, 0.0, 0.0, 0.0);
        problem.row_mut(r).fill(0.0);
        for &(Mover { dof, sign, .. }, c) in &self.movers[k] {
            let value = sign * dot(normal, at.body.point_column(place.pose, dof, if sign > 0.0 { a } else { b }));
            let (left, braked) = place.rest.map_or((0.0, 0.0), |rest| {
                // Braking distance goes with the square of speed: braking shortens it by `share`, and a step counts 1 / share.
                let left = rest.left[dof];
                (left, left - rest.share * rest.share * rest.displacement[dof])
            });
            // The hierarchy solves for z, with dq = reference + scale z: columns take the scale, limits the motion of the reference.
            limit += value * (left - at.reference[dof]);
            still += value * (braked - at.reference[dof]);
            let column = value * at.scale[dof];
            problem.row_mut(r)[c] = column;
            if column != 0.0 {
                let (to_lo, to_hi) = (column * problem.lo[c], column * problem.hi[c]);
                (least, most) = (least + to_lo.min(to_hi), most + to_lo.max(to_hi));
            }
        }
        problem.lower[r] = limit.min(still + EASE * (most - still).max(0.0));
        problem.upper[r] = f64::INFINITY;
        !(least >= problem.lower[r])
    }

    /// Mark the pairs whose rows limited the solve.
    pub fn keep_held(&mut self, problem: &Problem) {
        for &k in &self.near {
            self.pairs[k].held = false;
        }
        for task in &self.tasks {
            for (index, &k) in task.used.iter().enumerate() {
                self.pairs[k].held = task.rows_of(index).iter().any(|r| problem.present[*r] && problem.held[*r]);
            }
        }
    }
}

/// A row to write: a pose, the nearest points of the pair in it, and the least n . J dq, m. `rest` is given for a pose of rest.
struct RowPlace<'a> {
    nearest: Nearest,
    required: f64,
    pose: &'a Pose,
    rest: Option<&'a Rest>,
}

/// A body in a pose, and the map dq = reference + scale z from the hierarchy's variables z to its step.
pub struct Iteration<'a> {
    pub body: &'a Body,
    pub pose: &'a Pose,
    pub reference: &'a [f64],
    pub scale: &'a [f64],
}
