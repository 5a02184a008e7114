//! The state of every pair of one solver: its mode, bounds of its distance, and its least distance.

use super::law::{contact_floor, damped_floor, Mode};
use super::rest::Rest;
use super::set::{Mover, ObserverSet, ObstaclePose, Other, Pair};
use super::task::{Activation, ObserverTask};
use crate::body::Body;
use crate::geometry::{gap_at_least, nearest, Nearest, Scratch, Solid};
use crate::math::*;
use std::sync::Arc;

/// A pair as it is now.
#[derive(Clone, Copy, Debug, Default)]
pub struct PairState {
    pub mode: Mode,
    pub nearest: Nearest,
    /// Least distance at the end of the frame (of the iteration, if only the closest act), m.
    pub floor: f64,
    /// Bounds of the distance since it was last measured, m.
    pub at_least: f64,
    pub at_most: f64,
    /// Distance by which it may still come nearer in this frame, m: a lower bound, exact once it is measured.
    pub budget: f64,
    /// True if the floor follows from the distance at the start of this frame.
    pub has_floor: bool,
    /// True if it was measured in the present posture.
    pub is_fresh: bool,
    pub has_row: bool,
    /// Nearest points in a posture of rest, and its index; None if the pair is far enough apart there, or no rest is foreseen.
    pub at_rest: Option<(Nearest, usize)>,
    /// Its nearest points in the frames of both sides, and those before, if they were elsewhere.
    pub witness: Option<(Vec3, Vec3)>,
    pub before: Option<(Vec3, Vec3)>,
    /// True if one of its rows limited the last solve.
    pub held: bool,
}

/// A pair that came nearer in the trial.
#[derive(Clone, Copy, Debug)]
pub struct Approach {
    pub pair: usize,
    pub row: usize,
    /// n . J dq of the trial, m.
    pub moved: f64,
}

/// The monitor of all pairs of a solver. Nothing is allocated after it is made.
pub struct PairMonitor {
    pub set: Arc<ObserverSet>,
    pub activation: Activation,
    pub tasks: Vec<ObserverTask>,
    /// The first tasks that look at a pair, before contact and in contact. Its rows belong to them.
    pub task_of: Vec<(Option<usize>, Option<usize>)>,
    /// Movers of each pair that are not locked, and their columns.
    pub movers: Vec<Vec<(Mover, usize)>>,
    pub obstacles: Vec<ObstaclePose>,
    pub present: Vec<bool>,
    pub pairs: Vec<PairState>,
    /// Pairs within influence in the posture looked at last.
    pub near: Vec<usize>,
    /// Mode of each observer in the last frame, and so far in the present one.
    pub modes: Vec<Mode>,
    modes_now: Vec<Mode>,
    /// Violation of each task's rows, m.
    pub violation: Vec<f64>,
    pub(super) dt: f64,
    /// Share of one iteration in a frame.
    pub(super) iteration: f64,
    pub(super) approaching: Vec<Approach>,
    pub(super) solids: Vec<Solid>,
    pub(super) fixtures: Vec<Solid>,
    /// Observers and obstacles at the start of the frame.
    pub(super) start: (Vec<Solid>, Vec<Solid>),
    pub rest: Rest,
    /// Prediction of the next step: the last one of this frame, or all of the frame before.
    pub(super) expected: Vec<f64>,
    /// Number of pairs for which the smallest task has rows.
    pub(super) most_pairs: usize,
    pub(super) scratch: Scratch,
}

impl PairMonitor {
    pub fn new(
        set: Arc<ObserverSet>,
        tasks: Vec<ObserverTask>,
        activation: Activation,
        columns: &[Option<usize>],
        body: &Body,
    ) -> Self {
        let first = |p: &Pair, reactive| tasks.iter().position(|t| t.reactive == reactive && t.looks_at(p));
        let task_of = set.pairs.iter().map(|p| (first(p, false), first(p, true))).collect();
        let movers = set
            .pairs
            .iter()
            .map(|p| p.movers.iter().filter_map(|m| columns[m.dof].map(|c| (*m, c))).collect())
            .collect();
        let pair = PairState { at_least: f64::NEG_INFINITY, at_most: f64::INFINITY, ..PairState::default() };
        Self {
            activation,
            task_of,
            movers,
            obstacles: vec![ObstaclePose::REST; set.obstacles.len()],
            present: vec![false; set.obstacles.len()],
            pairs: vec![pair; set.pairs.len()],
            near: Vec::with_capacity(set.pairs.len()),
            modes: vec![Mode::Free; set.observers.len()],
            modes_now: vec![Mode::Free; set.observers.len()],
            violation: vec![0.0; tasks.len()],
            dt: 0.0,
            iteration: 1.0,
            approaching: Vec::with_capacity(set.pairs.len()),
            solids: set.new_solids(),
            fixtures: set.new_fixtures(),
            start: (set.new_solids(), set.new_fixtures()),
            rest: Rest::new(body, &set),
            expected: vec![0.0; columns.len()],
            most_pairs: tasks.iter().map(|t| t.pairs).min().unwrap_or(0),
            scratch: Scratch::default(),
            tasks,
            set,
        }
    }

    /// Forget the posture.
    pub fn reset(&mut self) {
        for k in 0..self.pairs.len() {
            self.forget(k);
        }
        self.expected.fill(0.0);
        self.modes.fill(Mode::Free);
        self.modes_now.fill(Mode::Free);
    }

    /// Forget the distance of a pair.
    pub(super) fn forget(&mut self, k: usize) {
        let state = &mut self.pairs[k];
        (state.at_least, state.at_most) = (f64::NEG_INFINITY, f64::INFINITY);
        (state.mode, state.at_rest) = (Mode::Free, None);
        (state.held, state.witness, state.before) = (false, None, None);
    }

    /// End the frame, in which coordinates moved by `done`: move obstacles on.
    pub fn finish(&mut self, done: &[f64]) {
        self.expected.copy_from_slice(done);
        for obstacle in &mut self.obstacles {
            *obstacle = obstacle.after(self.dt);
        }
        self.modes.copy_from_slice(&self.modes_now);
        self.modes_now.fill(Mode::Free);
    }

    /// True if an obstacle comes nearer in each iteration, so that none may be left out.
    pub fn needs_every_iteration(&self) -> bool {
        let moves = |k: &usize| matches!(self.set.pairs[*k].other, Other::Obstacle(o) if self.obstacles[o].moves());
        self.activation != Activation::All && self.near.iter().any(moves)
    }

    /// Smallest distances (m) between observers, and of one to an obstacle; infinite beyond influence.
    pub fn clearance(&mut self) -> (f64, f64) {
        let mut least = (f64::INFINITY, f64::INFINITY);
        for (k, pair) in self.set.pairs.iter().enumerate() {
            if !self.is_there(k) {
                continue;
            }
            let (a, b) = self.set.sides(k, &self.solids, &self.fixtures);
            let side = if k < self.set.self_pairs { &mut least.0 } else { &mut least.1 };
            if gap_at_least(a, b) < pair.influence.min(*side) {
                let distance = nearest(a, b, &mut self.scratch).distance;
                *side = if distance < pair.influence { side.min(distance) } else { *side };
            }
        }
        least
    }

    /// True for a pair of observers, and for one with an obstacle that is present.
    pub(super) fn is_there(&self, k: usize) -> bool {
        !matches!(self.set.pairs[k].other, Other::Obstacle(o) if !self.present[o])
    }

    /// The next mode of a pair at this distance.
    pub(super) fn mode_at(&self, k: usize, distance: f64) -> Mode {
        match self.pairs[k].mode.next(distance, self.set.pairs[k].influence) {
            Mode::Reactive if self.task_of[k].1.is_none() => Mode::Preventive,
            mode => mode,
        }
    }

    /// Count a pair that is below its floor by `depth`, m.
    pub(super) fn violates(&mut self, k: usize, depth: f64) {
        let (prevents, reacts) = self.task_of[k];
        let task = if self.pairs[k].mode == Mode::Reactive { reacts } else { prevents };
        if let Some(task) = task.filter(|t| self.tasks[*t].on) {
            self.violation[task] = libm::hypot(self.violation[task], depth);
        }
    }

    /// Report a mode for the observers of a pair.
    pub(super) fn note(&mut self, pair: usize, mode: Mode) {
        let pair = &self.set.pairs[pair];
        self.modes_now[pair.observer] = self.modes_now[pair.observer].max(mode);
        if let Other::Observer(other) = pair.other {
            self.modes_now[other] = self.modes_now[other].max(mode);
        }
    }

    /// Least distance of a pair after `dt` s from this distance.
    pub(super) fn floor_from(&self, k: usize, distance: f64, dt: f64) -> f64 {
        let (pair, state) = (&self.set.pairs[k], &self.pairs[k]);
        match (state.mode, self.task_of[k]) {
            (Mode::Reactive, (_, Some(task))) => contact_floor(distance, pair.margin, self.tasks[task].speed, dt),
            (_, (Some(task), _)) => damped_floor(distance, pair.influence, pair.margin, self.tasks[task].speed, dt),
            _ => f64::NEG_INFINITY,
        }
    }

    /// Motion of an obstacle's surface towards the observer of a pair in the next iteration, along the normal, m.
    pub(super) fn drift(&self, k: usize) -> f64 {
        let (pair, state) = (&self.set.pairs[k], &self.pairs[k]);
        let Other::Obstacle(o) = pair.other else { return 0.0 };
        if self.activation == Activation::All || !self.obstacles[o].moves() {
            return 0.0;
        }
        let obstacle = &self.obstacles[o];
        let arm = sub(state.nearest.b, self.fixtures[o].position);
        let velocity = add(obstacle.linear, cross(obstacle.angular, arm));
        dot(state.nearest.normal, velocity) * self.dt * self.iteration
    }
}
