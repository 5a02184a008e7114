//! Inequality rows of pairs, n . J dq >= what is left of the approach, written into a hierarchy problem.

use super::law::Mode;
use super::rest::Rest;
use super::set::Mover;
use super::task::{Activation, ROWS};
use super::watch::Watch;
use crate::body::Body;
use crate::geometry::Nearest;
use crate::hierarchy::Problem;
use crate::kinematics::Pose;
use crate::math::*;

/// Share of what the box allows beyond standing still, or braking, that a row may ask for in one iteration.
const EASE: f64 = 0.25;

impl Watch {
    /// Rows of all pairs that act, in the variables of the hierarchy. Returns whether rows wait for a trial.
    pub fn write_rows(&mut self, problem: &mut Problem, at: &Iteration<'_>) -> bool {
        self.clear_rows(problem);
        if self.activation == Activation::All {
            self.wake_expected();
        }
        self.write_rows_from(0, problem, at)
    }

    /// The rows of those pairs in `near` from `start` on.
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
            let asked = if waits { 0.0 } else { self.asked(k) };
            let now = Some(Place { nearest: self.pairs[k].nearest, asked, pose: at.pose, rest: None });
            for (r, place) in rows.into_iter().zip([now, self.at_rest(k), self.at_before(k, at.pose)]) {
                let Some(place) = place else { continue };
                let may_be_crossed = self.write_row(k, r, &place, problem, at);
                problem.present[r] = !waits && may_be_crossed;
            }
            waiting |= waits;
        }
        waiting
    }

    /// The row about the posture of rest, n . J (sum dq - share way) >= share (min(margin, floor) - distance); None: the pair is far enough
    /// apart there, or touches now.
    fn at_rest(&self, k: usize) -> Option<Place<'_>> {
        let (state, rest) = (&self.pairs[k], &self.rest);
        let (nearest, i) = state.at_rest.filter(|_| state.mode != Mode::Reactive)?;
        let asked = (self.set.pairs[k].margin.min(state.floor) - nearest.distance) * rest.share;
        Some(Place { nearest, asked, pose: &rest.foreseen[i].pose, rest: Some(rest) })
    }

    /// The row where the pair was nearest before, if that was elsewhere: along parallel faces the nearest points leap from end to end.
    fn at_before<'a>(&self, k: usize, pose: &'a Pose) -> Option<Place<'a>> {
        let state = &self.pairs[k];
        let (a, b) = state.before.filter(|_| state.mode != Mode::Reactive)?;
        let (first, second) = self.set.sides(k, &self.solids, &self.fixtures);
        let normal = state.nearest.normal;
        let (a, b) = (first.world(a), second.world(b));
        let distance = dot(normal, sub(a, b));
        let asked = state.floor - distance.max(state.nearest.distance);
        Some(Place { nearest: Nearest { distance, a, b, normal }, asked, pose, rest: None })
    }

    fn clear_rows(&mut self, problem: &mut Problem) {
        for task in &mut self.tasks {
            problem.present[task.first_row..task.first_row + ROWS * task.pairs].fill(false);
            task.used.clear();
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

    /// The row n . J dq >= asked of a pair in a place. Returns whether any point of the box lies below it; if none does, it asks for
    /// nothing.
    ///
    /// It asks for no more than what standing still brings (braking, in the row about rest) and the share `EASE` of what the box
    /// allows beyond that: joints that cannot get out in one frame would all go as far as they may, those that carry the body
    /// as well, and lower levels could keep nothing.
    fn write_row(&self, k: usize, r: usize, place: &Place<'_>, problem: &mut Problem, at: &Iteration<'_>) -> bool {
        let Nearest { a, b, normal, .. } = place.nearest;
        let (mut limit, mut still, mut least, mut most) = (place.asked, 0.0, 0.0, 0.0);
        problem.row_mut(r).fill(0.0);
        for &(Mover { dof, sign, .. }, c) in &self.movers[k] {
            let value = sign * dot(normal, at.body.point_column(place.pose, dof, if sign > 0.0 { a } else { b }));
            let (left, braked) = place.rest.map_or((0.0, 0.0), |rest| {
                // Way goes by the square of speed: braking makes it shorter by `share`, and a step counts 1 / share in it.
                let left = rest.left[dof];
                (left, left - rest.share * rest.share * rest.way[dof])
            });
            // The hierarchy solves for z, with dq = reference + scale z: columns take the scale, limits what the reference moves.
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

    /// Remember which rows limited the solve.
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

/// A row to write: a pose, where the pair is nearest in it, and the least n . J dq; `rest`, if that is the pose of rest.
struct Place<'a> {
    nearest: Nearest,
    asked: f64,
    pose: &'a Pose,
    rest: Option<&'a Rest>,
}

/// What rows of one iteration are written for: a body in a pose, and its step
/// dq = reference + scale z by the hierarchy's variables z.
pub struct Iteration<'a> {
    pub body: &'a Body,
    pub pose: &'a Pose,
    pub reference: &'a [f64],
    pub scale: &'a [f64],
}
