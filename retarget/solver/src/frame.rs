//! One frame: targets in, posture out, in at most `n_ik` iterations of the convergence loop (paper, Figure 2).

use crate::allocations::allocations;
use crate::avoid::{reserve_rows, watch};
use crate::body::Body;
use crate::bounds::{frame_bounds, iteration_bounds, FrameBox, Limit};
use crate::hierarchy::{Problem, Side, Workspace};
use crate::kinematics::Pose;
use crate::layout::{Layout, Placed};
use crate::observers::{Activation, ObserverSet, Watch};
use crate::progress::{Moment, Progress};
use crate::rows::Columns;
use crate::task::{Task, TaskKind};
use std::ops::Range;
use std::sync::Arc;

/// Iterations at the end of a frame that may be used to repair what lower levels did to higher ones.
const REPAIRS: usize = 2;
/// Soft tasks ask for so much less where a level is damped by this share of its length, or more.
const SOFT_SLOWING: f64 = 0.8;
const SOFT_SLOW: f64 = 0.15;
/// How often a step is halved.
const HALVINGS: usize = 3;

/// Settings of the convergence loop.
#[derive(Clone, Debug)]
pub struct Settings {
    pub n_ik: usize,
    /// Largest change of one coordinate per iteration (rad or m).
    pub max_step: f64,
    /// How much a level is damped that could not be met, for the size of the body (see `Progress::damping`); 0 never damps.
    pub damping: f64,
    pub early_stop: bool,
}

/// What happened, summed since the last reset.
#[derive(Clone, Copy, Debug, Default)]
pub struct Stats {
    pub frames: u64,
    pub iterations: u64,
    pub factorizations: u64,
    pub fallbacks: u64,
    pub capped: u64,
    /// Heap allocations inside frames: those of the first ones, and none after them.
    pub allocations: u64,
}

pub struct FrameSolver {
    pub body: Arc<Body>,
    pub settings: Settings,
    pub limits: Vec<Limit>,
    pub stats: Stats,
    pub target_size: usize,
    pub q: Vec<f64>,
    /// Displacement per second of the last frame (nv).
    pub velocity: Vec<f64>,
    /// Per task (in order of levels): error norm at the posture that was reached.
    pub task_errors: Vec<f64>,
    pub(crate) placed: Vec<Placed>,
    pub(crate) progress: Progress,
    /// Observers, where there are any.
    pub watch: Option<Watch>,
    pub(crate) damping_length: f64,
    /// Share of their error that soft tasks ask for.
    pub(crate) soft_share: f64,
    pub(crate) columns: Columns,
    /// Place in q of a hinge or slide coordinate.
    pub(crate) q_address: Vec<Option<usize>>,
    pub(crate) problem: Problem,
    pub(crate) work: Workspace,
    /// Active set after the first iteration of the last frame, and of the first frame of the last clip.
    pub(crate) first_sides: (Vec<Side>, Vec<Side>),
    pub(crate) clip_sides: (Vec<Side>, Vec<Side>),
    pub(crate) pose: Pose,
    /// The pose is that of `q`.
    posed: bool,
    pub(crate) frame_box: Vec<FrameBox>,
    pub(crate) done: Vec<f64>,
    pub(crate) step: Vec<f64>,
    pub(crate) weight2: Vec<f64>,
    pub(crate) scale: Vec<f64>,
    pub(crate) reference: Vec<f64>,
    /// Weight of a typical joint in the last level.
    pub(crate) soft_scale: f64,
    pub(crate) posture_error: Vec<f64>,
    /// Limits of rows before a trial.
    pub(crate) asked: (Vec<f64>, Vec<f64>),
}

impl FrameSolver {
    pub fn new(
        body: Arc<Body>,
        mut levels: Vec<Vec<Task>>,
        limits: Vec<Limit>,
        locked: &[bool],
        observers: Option<(Arc<ObserverSet>, Activation)>,
        settings: Settings,
    ) -> Self {
        let columns = Columns::new(&body, locked);
        if let Some((set, _)) = &observers {
            reserve_rows(&mut levels, set);
        }
        let mut layout = Layout::new(&body, levels, locked, columns.all.len());
        let watch = observers.map(|(set, activation)| watch(&body, &columns, &mut layout.placed, set, activation));
        let progress = Progress::new(&layout.levels_with_errors());
        let problem = Problem::new(layout.variables.max(1), &layout.level_rows);
        let first_sides = (problem.variable_side.clone(), problem.row_side.clone());
        let q = body.rest();
        let mut q_address = vec![None; body.nv];
        for joint in body.joints.iter().filter(|j| j.kind.size() == (1, 1)) {
            q_address[joint.v_address] = Some(joint.q_address);
        }
        Self {
            stats: Stats::default(),
            target_size: layout.target_size,
            q,
            velocity: vec![0.0; body.nv],
            task_errors: vec![0.0; layout.placed.len()],
            placed: layout.placed,
            progress,
            watch,
            soft_share: 1.0,
            clip_sides: first_sides.clone(),
            damping_length: settings.damping * body.size(),
            columns,
            q_address,
            problem,
            work: Workspace::default(),
            first_sides,
            pose: body.new_pose(),
            posed: false,
            frame_box: vec![FrameBox::default(); body.nv],
            done: vec![0.0; body.nv],
            step: vec![0.0; body.nv],
            weight2: vec![0.0; body.nv],
            scale: vec![1.0; body.nv],
            reference: vec![0.0; body.nv],
            soft_scale: 1.0,
            posture_error: vec![0.0; body.nv],
            asked: Default::default(),
            limits,
            settings,
            body,
        }
    }

    /// Where each task's slice of the target vector is, with its level.
    pub fn slices(&self) -> impl Iterator<Item = (usize, Range<usize>)> + '_ {
        self.placed.iter().map(|p| (p.level, p.target.clone()))
    }

    /// Start from posture `q`, moving at `velocity`. The active set stays, as a guess.
    pub fn reset(&mut self, q: &[f64], velocity: &[f64]) {
        self.q.copy_from_slice(q);
        self.posed = false;
        self.velocity.copy_from_slice(velocity);
        self.problem.z.fill(0.0);
        self.progress.reset();
        if let Some(watch) = &mut self.watch {
            watch.reset();
        }
    }

    /// One frame of `dt` seconds towards `targets`; the posture reached is in `q`.
    pub fn frame(&mut self, targets: &[f64], dt: f64) {
        let allocated = allocations();
        for i in 0..self.body.nv {
            self.frame_box[i] = frame_bounds(self.coordinate(i), self.velocity[i] * dt, &self.limits[i], dt);
            self.done[i] = 0.0;
        }
        self.look(targets, Moment::Start, 0, dt);
        for iteration in 0..self.settings.n_ik {
            if iteration > 0 {
                if self.settings.early_stop && self.may_stay() && self.progress.is_done() && self.none_comes() {
                    break;
                }
                self.progress.decide_who_waits(iteration + REPAIRS >= self.settings.n_ik);
            } else {
                // The first iteration of a frame resembles that of the frame before more than the last iteration does.
                self.problem.variable_side.clone_from(&self.first_sides.0);
                self.problem.row_side.clone_from(&self.first_sides.1);
            }
            self.iterate(targets, iteration == 0);
            if iteration == 0 {
                self.first_sides.0.clone_from(&self.problem.variable_side);
                self.first_sides.1.clone_from(&self.problem.row_side);
            }
            self.look(targets, Moment::Step, iteration + 1, dt);
            self.take_back(targets, iteration + 1, dt);
            self.stats.iterations += 1;
        }
        for i in 0..self.body.nv {
            self.velocity[i] = self.done[i] / dt;
        }
        if let Some(watch) = &mut self.watch {
            watch.finish(&self.done);
        }
        self.stats.frames += 1;
        self.stats.allocations += allocations() - allocated;
    }

    /// Kinematics and errors of the posture as it is, after so many iterations of a frame of `dt` s.
    fn look(&mut self, targets: &[f64], moment: Moment, done: usize, dt: f64) {
        if moment != Moment::Start || !self.posed {
            self.body.forward(&self.q, &mut self.pose);
            self.body.mass_properties(&mut self.pose);
            self.posed = true;
        }
        let mut violation: &[f64] = &[];
        if let Some(watch) = &mut self.watch {
            match moment {
                Moment::Start => {
                    for p in &self.placed {
                        if let TaskKind::Observers(task) = &p.task.kind {
                            watch.tasks[task.index].on = p.task.is_present(&targets[p.target.clone()]);
                        }
                    }
                    watch.begin(&self.pose, dt, self.settings.n_ik);
                }
                _ => watch.look(&self.pose, done, &self.step),
            }
            violation = &watch.violation;
        }
        self.progress.look(&self.body, &self.pose, &self.placed, targets, moment, violation, &mut self.task_errors);
    }

    /// No obstacle comes nearer in the iterations that are left.
    fn none_comes(&self) -> bool {
        self.watch.as_ref().is_none_or(|w| !w.needs_every_iteration())
    }

    /// Halve the last step again and again, while it was too large and the box of the frame allows it.
    fn take_back(&mut self, targets: &[f64], done: usize, dt: f64) {
        let mut share = -0.5;
        for _ in 0..HALVINGS {
            if !self.progress.went_too_far() {
                return;
            }
            self.step.iter_mut().for_each(|s| *s *= share);
            share = 0.5;
            let allowed = self.frame_box.iter().zip(&self.done).zip(&self.step).all(|((b, d), s)| b.holds(d + s));
            if !allowed {
                return;
            }
            for (done, step) in self.done.iter_mut().zip(&self.step) {
                *done += step;
            }
            self.body.integrate(&mut self.q, &self.step);
            self.look(targets, Moment::StepTakenBack, done, dt);
        }
    }

    /// The box of the frame allows to stay where it is.
    fn may_stay(&self) -> bool {
        self.frame_box.iter().zip(&self.done).all(|(b, d)| b.holds(*d))
    }

    /// Damping of every level. Soft tasks go slower beside a damped level: near a stretched limb they see as little of what
    /// their steps do as that level, and would swing about their goal.
    fn damp(&mut self) {
        let mut most: f64 = 0.0;
        for k in 0..self.problem.level_count() {
            let damping = self.progress.damping(k, self.damping_length);
            self.problem.damping[k] = damping;
            self.problem.patience[k] = self.progress.patience(k);
            most = most.max(damping);
        }
        self.soft_share =
            1.0 - SOFT_SLOWING * if most > 0.0 { (most / (SOFT_SLOW * self.damping_length)).min(1.0) } else { 0.0 };
    }

    /// Value of a hinge or slide coordinate; 0 for others (they have no position limit).
    fn coordinate(&self, dof: usize) -> f64 {
        self.q_address[dof].map_or(0.0, |a| self.q[a])
    }

    fn iterate(&mut self, targets: &[f64], first: bool) {
        self.damp();
        self.metric(targets);
        self.write_rows(targets);
        self.write_box();
        self.solve_observed(first);
        self.read_step();
        for (done, step) in self.done.iter_mut().zip(&self.step) {
            *done += step;
        }
        self.body.integrate(&mut self.q, &self.step);
    }

    /// From the answer of the hierarchy to the step of every coordinate.
    pub(crate) fn read_step(&mut self) {
        self.step.fill(0.0);
        for &(dof, c) in &self.columns.all {
            let (lo, hi) = iteration_bounds(&self.frame_box[dof], self.done[dof], self.settings.max_step);
            let x = self.reference[dof] + self.problem.z[c] * self.scale[dof];
            self.step[dof] = x.max(lo).min(hi);
        }
    }
}
