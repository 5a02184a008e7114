//! The observers of one solver at work: what is known of each pair, and how near it may come.

use super::law::{damped_floor, way_out, Mode};
use super::rest::Rest;
use super::set::{Mover, ObserverSet, ObstaclePose, Other};
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
    /// Distance that it shall have at the end of the frame (of the iteration, where only the closest act).
    pub floor: f64,
    /// Bounds of the distance, from when it was last looked at.
    pub at_least: f64,
    pub at_most: f64,
    /// How far it may still come nearer in this frame, at least; exact where it was looked at.
    pub budget: f64,
    /// Its floor is that of the distance at the start of this frame.
    pub has_floor: bool,
    /// It was looked at in the present posture.
    pub is_fresh: bool,
    pub has_row: bool,
    /// Where its sides are nearest in the postures of rest, and in which of them; None: far enough apart there, or none is
    /// foreseen.
    pub at_rest: Option<(Nearest, usize)>,
    /// Its nearest points in the frames of both sides, and those before, if they were elsewhere.
    pub witness: Option<(Vec3, Vec3)>,
    pub before: Option<(Vec3, Vec3)>,
    /// One of its rows limited the last solve.
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

/// Observers at work. Nothing is allocated after it is made.
pub struct Watch {
    pub set: Arc<ObserverSet>,
    pub activation: Activation,
    pub tasks: Vec<ObserverTask>,
    /// Tasks that a pair's rows belong to, before contact and in contact.
    pub task_of: Vec<(Option<usize>, Option<usize>)>,
    /// Movers of each pair that are not locked, and their columns.
    pub movers: Vec<Vec<(Mover, usize)>>,
    pub obstacles: Vec<ObstaclePose>,
    pub present: Vec<bool>,
    pub pairs: Vec<PairState>,
    /// Pairs within influence in the posture looked at last.
    pub near: Vec<usize>,
    /// What each observer did in the last frame, and in the one that runs so far.
    pub modes: Vec<Mode>,
    modes_now: Vec<Mode>,
    /// Violation of each task's rows, m.
    pub violation: Vec<f64>,
    pub(super) dt: f64,
    /// Share of a frame that one iteration is.
    pub(super) iteration: f64,
    pub(super) approaching: Vec<Approach>,
    pub(super) solids: Vec<Solid>,
    pub(super) fixtures: Vec<Solid>,
    /// Observers and obstacles where they were when the frame began.
    pub(super) start: (Vec<Solid>, Vec<Solid>),
    pub rest: Rest,
    /// A step like the one to come: the last one of this frame, or all of the frame before.
    pub(super) expected: Vec<f64>,
    /// Pairs for which the smallest task has rows.
    pub(super) most_pairs: usize,
    pub(super) scratch: Scratch,
}

impl Watch {
    pub fn new(
        set: Arc<ObserverSet>,
        tasks: Vec<ObserverTask>,
        activation: Activation,
        columns: &[Option<usize>],
        body: &Body,
    ) -> Self {
        let task_of = set.pairs.iter().map(|p| ObserverTask::of_pair(&tasks, p)).collect();
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

    /// Nothing is known of the posture.
    pub fn reset(&mut self) {
        for k in 0..self.pairs.len() {
            self.forget(k);
        }
        self.expected.fill(0.0);
        self.modes.fill(Mode::Free);
        self.modes_now.fill(Mode::Free);
    }

    /// Nothing is known of a pair any more.
    pub(super) fn forget(&mut self, k: usize) {
        let state = &mut self.pairs[k];
        (state.at_least, state.at_most) = (f64::NEG_INFINITY, f64::INFINITY);
        (state.mode, state.at_rest) = (Mode::Free, None);
        (state.held, state.witness, state.before) = (false, None, None);
    }

    /// Obstacles go on to where they are when the frame ends, in which coordinates went by `done`.
    pub fn finish(&mut self, done: &[f64]) {
        self.expected.copy_from_slice(done);
        for obstacle in &mut self.obstacles {
            *obstacle = obstacle.after(self.dt);
        }
        self.modes.copy_from_slice(&self.modes_now);
        self.modes_now.fill(Mode::Free);
    }

    /// An obstacle comes nearer iteration by iteration, so that none may be left out.
    pub fn needs_every_iteration(&self) -> bool {
        let moves = |k: &usize| matches!(self.set.pairs[*k].other, Other::Obstacle(o) if self.obstacles[o].moves());
        self.activation != Activation::All && self.near.iter().any(moves)
    }

    /// Smallest distance between observers, and of one to an obstacle; infinite beyond influence.
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

    /// A pair of observers, or with an obstacle that is there.
    pub(super) fn is_there(&self, k: usize) -> bool {
        !matches!(self.set.pairs[k].other, Other::Obstacle(o) if !self.present[o])
    }

    /// What a pair does next at this distance.
    pub(super) fn mode_at(&self, k: usize, distance: f64) -> Mode {
        match self.pairs[k].mode.next(distance, self.set.pairs[k].influence) {
            Mode::Reactive if self.task_of[k].1.is_none() => Mode::Preventive,
            mode => mode,
        }
    }

    /// A pair is below what was asked of it by `depth`, m.
    pub(super) fn violates(&mut self, k: usize, depth: f64) {
        let (prevents, reacts) = self.task_of[k];
        let task = if self.pairs[k].mode == Mode::Reactive { reacts } else { prevents };
        if let Some(task) = task.filter(|t| self.tasks[*t].on) {
            self.violation[task] = libm::hypot(self.violation[task], depth);
        }
    }

    /// Both observers of a pair are in this mode.
    pub(super) fn note(&mut self, pair: usize, mode: Mode) {
        let pair = &self.set.pairs[pair];
        self.modes_now[pair.observer] = self.modes_now[pair.observer].max(mode);
        if let Other::Observer(other) = pair.other {
            self.modes_now[other] = self.modes_now[other].max(mode);
        }
    }

    /// Least distance of a pair after `dt` s, if its distance were this.
    pub(super) fn floor_from(&self, k: usize, distance: f64, dt: f64) -> f64 {
        let (pair, state) = (&self.set.pairs[k], &self.pairs[k]);
        match (state.mode, self.task_of[k]) {
            (Mode::Reactive, (_, Some(task))) => way_out(distance, pair.margin, self.tasks[task].speed, dt),
            (_, (Some(task), _)) => damped_floor(distance, pair.influence, pair.margin, self.tasks[task].speed, dt),
            _ => f64::NEG_INFINITY,
        }
    }

    /// How far an obstacle's surface comes at the observer of a pair in the iteration to come, along the normal, m.
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
