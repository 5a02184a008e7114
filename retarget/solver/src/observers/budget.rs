//! Where all observers act, each pair has a budget: how far it may still come nearer in this frame. A pair whose joints cannot have
//! spent it sleeps: its distance is not looked at and its row is left out, for the step could not have crossed it. A pair whose
//! budget the step would spend is woken, looked at, and gets its row before the step is taken, for four times in an iteration;
//! what it misses is found after the step, and corrected by the next one.

use super::law::Mode;
use super::set::{place_obstacles, Mover, ObstaclePose, Other};
use super::watch::Watch;
use crate::geometry::{extreme, gap_at_least, nearest, Nearest, Solid};
use crate::kinematics::Pose;
use crate::math::*;

/// Pairs as near as this many times their influence are looked at exactly: so their mode is known.
const LOOKED_AT: f64 = 1.1;
/// An obstacle that is said to be so near (m, rad) to where it was expected has not leapt.
const SAME: f64 = 1e-9;
/// Nearest points that are so far (m) from those before are elsewhere on their faces.
const ELSEWHERE: f64 = 3e-3;

impl Watch {
    /// A frame begins: modes, floors and budgets, as far as they follow from what is known already.
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
        let comes = self.obstacle_way(k, self.dt);
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

    /// Coordinates went by `step`: what that may have cost each pair.
    pub(super) fn spend(&mut self, pose: &Pose, step: &[f64]) {
        self.set.place(pose, &mut self.solids);
        self.expected.copy_from_slice(step);
        for (left, step) in self.rest.left.iter_mut().zip(step) {
            *left -= step;
        }
        for k in 0..self.pairs.len() {
            let way = self.way(k, step);
            if way > 0.0 {
                let state = &mut self.pairs[k];
                state.is_fresh = false;
                state.budget -= way;
                state.at_least -= way;
                state.at_most += way;
                if state.budget < 0.0 {
                    self.wake(k);
                }
            }
        }
        self.sum_violations();
    }

    /// Coordinates went by `step` between two frames.
    pub(crate) fn moved(&mut self, step: &[f64]) {
        for (expected, step) in self.expected.iter_mut().zip(step) {
            *expected += step;
        }
        for k in 0..self.pairs.len() {
            let way = self.way(k, step);
            (self.pairs[k].at_least, self.pairs[k].at_most) =
                (self.pairs[k].at_least - way, self.pairs[k].at_most + way);
        }
    }

    /// Pairs that get rows before the first solve of an iteration: what held before, what a step like the last would spend, and what
    /// may meet before the body rests.
    pub(super) fn wake_expected(&mut self) {
        self.near.clear();
        for k in 0..self.pairs.len() {
            let state = &self.pairs[k];
            if state.held || state.at_rest.is_some() || self.way(k, &self.expected) >= state.budget {
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

    /// Pairs without a row whose budget this step would spend after all join `near`. Returns how many there were before.
    pub(crate) fn wake_surprised(&mut self, step: &[f64]) -> usize {
        let before = self.near.len();
        for k in 0..self.pairs.len() {
            if self.pairs[k].has_row {
                continue;
            }
            let way = self.way(k, step);
            if way >= self.pairs[k].budget {
                self.wake(k);
                if way >= self.pairs[k].budget {
                    self.pairs[k].has_row = true;
                    self.near.push(k);
                }
            }
        }
        before
    }

    /// Look at a pair: where the frame began, if its floor is not known, and where it is now.
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

    /// Mode and floor, from the distance at the start of the frame.
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

    /// Look at a pair where the body would come to rest, if it may be nearer than its margin there, give or take what this frame can
    /// change. A pair that would rest far beyond an obstacle is not seen; nearer to it, the row of now acts.
    fn look_at_rest(&mut self, k: usize) {
        self.pairs[k].at_rest = None;
        if self.rest.time == 0.0 {
            return;
        }
        let (margin, change) = (self.set.pairs[k].margin, self.way(k, &self.rest.change));
        let way = self.way(k, &self.rest.way) + change + self.obstacle_way(k, self.rest.time);
        if way < self.pairs[k].at_least - margin && self.rest.count == 1 {
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
        // From beyond its middle the way out of an obstacle leads on through it: the way back is that of now.
        let is_through = now.distance > 0.0 && dot(now.normal, found.normal) < 0.0;
        self.pairs[k].at_rest = Some((if is_through { along(a, b, now.normal) } else { found }, i));
    }

    /// Where an obstacle is at the start of the next frame; whatever else was known of it is forgotten where that differs.
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

    /// How far the surface of a pair's obstacle may come in `time` s, m.
    fn obstacle_way(&self, k: usize, time: f64) -> f64 {
        let Other::Obstacle(o) = self.set.pairs[k].other else { return 0.0 };
        let (linear, angular) = (norm(self.obstacles[o].linear), norm(self.obstacles[o].angular));
        time * (linear + length_of_arc(angular, self.set.obstacles[o].shape.reach()))
    }

    /// How far a step may bring both sides of a pair together or apart.
    fn way(&self, k: usize, step: &[f64]) -> f64 {
        self.movers[k].iter().map(|(Mover { dof, lever, .. }, _)| length_of_arc(step[*dof].abs(), *lever)).sum()
    }

    /// How far pairs are below what was asked of them. Who may be has been looked at.
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

/// How far a point gets that turns; not at all where it does not, however long the lever.
fn length_of_arc(turned: f64, lever: f64) -> f64 {
    if turned == 0.0 {
        0.0
    } else {
        turned * lever
    }
}
