//! Activation of all observers. Each pair has a budget, the distance by which it may still come nearer in this frame. While its joints
//! cannot have spent it, its distance is not computed and it has no row. A pair whose budget the step would spend is measured and gets
//! its row before the step is taken, up to four times in an iteration. The next step corrects any error that remains.

use super::law::Mode;
use super::monitor::PairMonitor;
use super::set::{place_obstacles, Mover, ObstaclePose, Other};
use crate::geometry::{extreme, gap_at_least, nearest, Nearest, Solid};
use crate::kinematics::Pose;
use crate::math::*;

/// Pairs within this multiple of their influence distance are measured exactly, so that their mode is known.
const LOOKED_AT: f64 = 1.1;
/// An obstacle within this (m, rad) of its expected pose has not jumped.
const SAME: f64 = 1e-9;
/// Nearest points farther than this (m) from those before are elsewhere on their faces.
const ELSEWHERE: f64 = 3e-3;

impl PairMonitor {
    /// Begin a frame: set modes, floors and budgets, as far as they follow from the bounds of distances.
    pub(super) fn open_budgets(&mut self, pose: &Pose) {
        self.set.place(pose, &mut self.solids);
        self.start.0.copy_from_slice(&self.solids);
        place_obstacles(&self.obstacles, 0.0, &mut self.start.1);
        place_obstacles(&self.obstacles, self.dt, &mut self.fixtures);
        for k in 0..self.pairs.len() {
            self.open_budget(k);
        }
        self.sum_violations();
    }

    fn open_budget(&mut self, k: usize) {
        let state = &mut self.pairs[k];
        (state.is_fresh, state.has_floor) = (false, false);
        if !self.is_there(k) {
            self.pairs[k].budget = f64::INFINITY;
            self.forget(k);
            return;
        }
        self.look_at_rest(k);
        let comes = self.obstacle_travel(k, self.dt);
        let (least, most) = (self.pairs[k].at_least, self.pairs[k].at_most);
        let mode = self.mode_at(k, least);
        if mode != Mode::Reactive && mode == self.mode_at(k, most) {
            self.pairs[k].mode = mode;
            self.pairs[k].budget = least - self.floor_from(k, least, self.dt) - comes;
        } else {
            self.find_floor(k);
            let state = &mut self.pairs[k];
            state.budget = state.at_least - state.floor - comes;
        }
        let state = &mut self.pairs[k];
        state.at_least -= comes;
        state.at_most += comes;
        if state.mode != Mode::Free {
            let mode = state.mode;
            self.note(k, mode);
        }
        if self.pairs[k].budget < 0.0 {
            self.wake(k);
        }
    }

    /// Subtract from budgets the most that a step of the coordinates may have cost.
    pub(super) fn spend(&mut self, pose: &Pose, step: &[f64]) {
        self.set.place(pose, &mut self.solids);
        self.expected.copy_from_slice(step);
        for (left, step) in self.rest.left.iter_mut().zip(step) {
            *left -= step;
        }
        for k in 0..self.pairs.len() {
            let travel = self.travel(k, step);
            if travel > 0.0 {
                let state = &mut self.pairs[k];
                state.is_fresh = false;
                state.budget -= travel;
                state.at_least -= travel;
                state.at_most += travel;
                if state.budget < 0.0 {
                    self.wake(k);
                }
            }
        }
        self.sum_violations();
    }

    /// Widen the bounds of distances by a step of the coordinates between two frames.
    pub(crate) fn moved(&mut self, step: &[f64]) {
        for (expected, step) in self.expected.iter_mut().zip(step) {
            *expected += step;
        }
        for k in 0..self.pairs.len() {
            let travel = self.travel(k, step);
            self.pairs[k].at_least -= travel;
            self.pairs[k].at_most += travel;
        }
    }

    /// Collect in `near` the pairs that get rows before the first solve of an iteration: those that limited the last solve, whose budget a
    /// step like the last would spend, or which may meet before the body rests.
    pub(super) fn wake_expected(&mut self) {
        self.near.clear();
        for k in 0..self.pairs.len() {
            let state = &self.pairs[k];
            if state.held || state.at_rest.is_some() || self.travel(k, &self.expected) >= state.budget {
                self.wake(k);
                self.near.push(k);
            }
            self.pairs[k].has_row = self.near.last() == Some(&k);
        }
        if self.near.len() > self.most_pairs {
            let room = |k: usize| {
                let at_rest =
                    self.pairs[k].at_rest.map_or(f64::INFINITY, |(n, _)| n.distance - self.set.pairs[k].margin);
                self.pairs[k].budget.min(at_rest)
            };
            self.near.sort_unstable_by(|a, b| room(*a).total_cmp(&room(*b)));
        }
    }

    /// Add to `near` the pairs without a row whose budget this step would spend. Returns the number of pairs before.
    pub(crate) fn wake_newly_active(&mut self, step: &[f64]) -> usize {
        let before = self.near.len();
        for k in 0..self.pairs.len() {
            if self.pairs[k].has_row {
                continue;
            }
            let travel = self.travel(k, step);
            if travel >= self.pairs[k].budget {
                self.wake(k);
                if travel >= self.pairs[k].budget {
                    self.pairs[k].has_row = true;
                    self.near.push(k);
                }
            }
        }
        before
    }

    /// Measure a pair: at the start of the frame, if its floor is not known, and now.
    fn wake(&mut self, k: usize) {
        if !self.pairs[k].has_floor {
            self.find_floor(k);
        }
        if !self.pairs[k].is_fresh {
            let found = self.between(k, false);
            let (a, b) = self.set.sides(k, &self.solids, &self.fixtures);
            let now = (a.local(found.a), b.local(found.b));
            let state = &mut self.pairs[k];
            let moved = |before: (Vec3, Vec3)| norm(sub(before.0, now.0)).max(norm(sub(before.1, now.1)));
            if let Some(witness) = state.witness.filter(|witness| moved(*witness) > ELSEWHERE) {
                state.before = Some(witness);
            }
            state.witness = Some(now);
            state.nearest = found;
            (state.at_least, state.at_most) = (found.distance, found.distance);
            state.is_fresh = true;
        }
        let state = &mut self.pairs[k];
        state.budget = state.nearest.distance - state.floor;
    }

    /// Set mode and floor from the distance at the start of the frame.
    fn find_floor(&mut self, k: usize) {
        let (a, b) = self.set.sides(k, &self.start.0, &self.start.1);
        let gap = gap_at_least(a, b);
        let is_far = gap > LOOKED_AT * self.set.pairs[k].influence;
        let distance = if is_far { gap } else { self.between(k, true).distance };
        self.pairs[k].mode = self.mode_at(k, distance);
        let floor = self.floor_from(k, distance, self.dt);
        let state = &mut self.pairs[k];
        (state.floor, state.has_floor) = (floor, true);
        if state.at_least == f64::NEG_INFINITY || state.at_least < distance {
            (state.at_least, state.at_most) = (distance, if is_far { f64::INFINITY } else { distance });
        }
    }

    /// Measure a pair in the posture of rest, if it may be nearer than its margin there, within the change that this frame can make. A pair
    /// that would rest far beyond an obstacle is not found; close to the obstacle its row of now acts.
    fn look_at_rest(&mut self, k: usize) {
        self.pairs[k].at_rest = None;
        if self.rest.time == 0.0 {
            return;
        }
        let (margin, change) = (self.set.pairs[k].margin, self.travel(k, &self.rest.change));
        let travel = self.travel(k, &self.rest.displacement) + change + self.obstacle_travel(k, self.rest.time);
        if travel < self.pairs[k].at_least - margin && self.rest.count == 1 {
            return;
        }
        let mut closest: Option<(Nearest, usize)> = None;
        for (i, there) in self.rest.foreseen[..self.rest.count].iter().enumerate() {
            let (a, b) = self.set.sides(k, &there.solids, &there.fixtures);
            if gap_at_least(a, b) > margin + change {
                continue;
            }
            let found = nearest(a, b, &mut self.scratch);
            if closest.is_none_or(|(before, _)| found.distance < before.distance) {
                closest = Some((found, i));
            }
        }
        let Some((found, i)) = closest else { return };
        let (a, b) = self.set.sides(k, &self.rest.foreseen[i].solids, &self.rest.foreseen[i].fixtures);
        let (c, d) = self.set.sides(k, &self.start.0, &self.start.1);
        let now = nearest(c, d, &mut self.scratch);
        // From beyond its middle the shortest exit from an obstacle is on the far side: the direction of now is the way back.
        let is_through = now.distance > 0.0 && dot(now.normal, found.normal) < 0.0;
        self.pairs[k].at_rest = Some((if is_through { along(a, b, now.normal) } else { found }, i));
    }

    /// Set the pose of an obstacle at the start of the next frame. If it is not the expected one, the bounds of its pairs are reset.
    pub fn set_obstacle(&mut self, o: usize, there: ObstaclePose, present: bool) {
        let before = &self.obstacles[o];
        let turned = quat_log(quat_mul(there.quat, quat_conj(before.quat)));
        let same = norm(sub(there.position, before.position)).max(norm(turned)) < SAME && present == self.present[o];
        (self.obstacles[o], self.present[o]) = (there, present);
        if !same {
            for k in self.set.self_pairs..self.pairs.len() {
                if self.set.pairs[k].other == Other::Obstacle(o) {
                    self.forget(k);
                }
            }
        }
    }

    fn between(&mut self, k: usize, at_start: bool) -> Nearest {
        let (solids, fixtures) = if at_start { (&self.start.0, &self.start.1) } else { (&self.solids, &self.fixtures) };
        let (a, b) = self.set.sides(k, solids, fixtures);
        nearest(a, b, &mut self.scratch)
    }

    /// Bound of the motion of the surface of a pair's obstacle in `time` s, m.
    fn obstacle_travel(&self, k: usize, time: f64) -> f64 {
        let Other::Obstacle(o) = self.set.pairs[k].other else { return 0.0 };
        let (linear, angular) = (norm(self.obstacles[o].linear), norm(self.obstacles[o].angular));
        time * (linear + length_of_arc(angular, self.set.obstacles[o].shape.reach()))
    }

    /// Bound of the change of a pair's distance by a step, m.
    fn travel(&self, k: usize, step: &[f64]) -> f64 {
        self.movers[k].iter().map(|(Mover { dof, lever, .. }, _)| length_of_arc(step[*dof].abs(), *lever)).sum()
    }

    /// Sum up the violations of floors. All pairs that may be below theirs have been measured.
    fn sum_violations(&mut self) {
        self.violation.fill(0.0);
        for k in 0..self.pairs.len() {
            if self.pairs[k].budget < 0.0 {
                self.violates(k, -self.pairs[k].budget);
            }
        }
    }
}

/// Two solids along the direction in which A moves away from B, which need not be that in which they are nearest.
fn along(a: &Solid, b: &Solid, normal: Vec3) -> Nearest {
    let (a, b) = (extreme(a, scale(normal, -1.0)).1, extreme(b, normal).1);
    Nearest { distance: dot(normal, sub(a, b)), a, b, normal }
}

/// Length of the path of a point that turns; 0 if it does not, even with an infinite lever.
fn length_of_arc(turned: f64, lever: f64) -> f64 {
    if turned == 0.0 {
        0.0
    } else {
        turned * lever
    }
}
