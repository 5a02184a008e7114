//! One frame: targets in, posture out, in at most `n_ik` iterations of the convergence loop (paper, Figure 2).

use crate::body::Body;
use crate::bounds::{frame_bounds, iteration_bounds, FrameBox, Limit};
use crate::hierarchy::{solve, Problem, Side, Workspace};
use crate::kinematics::Pose;
use crate::layout::{Layout, Placed};
use crate::rows::Columns;
use crate::task::Task;
use crate::trust::Trust;
use std::ops::Range;
use std::sync::Arc;

/// Errors (m, rad, summed over tasks) below this are met.
const MET: f64 = 1e-6;

/// Settings of the convergence loop.
#[derive(Clone, Debug)]
pub struct Settings {
    pub n_ik: usize,
    /// Largest change of one coordinate per iteration (rad or m).
    pub max_step: f64,
    /// Largest damping of a level whose linear model is not to be trusted (m/rad); 0 is none.
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
    pub(crate) trust: Trust,
    /// Levels of equalities alone, without a posture: their promises are judged.
    pub(crate) is_judged: Vec<bool>,
    /// Weighted squared error of each level.
    pub(crate) level_energy: Vec<f64>,
    /// What each row would do whole (not capped), and how far the reference posture goes towards it.
    pub(crate) wanted: Vec<f64>,
    pub(crate) shift: Vec<f64>,
    pub(crate) columns: Columns,
    /// Place in q of a hinge or slide coordinate.
    pub(crate) q_address: Vec<Option<usize>>,
    pub(crate) problem: Problem,
    pub(crate) work: Workspace,
    /// Active set after the first iteration of the last frame.
    pub(crate) first_sides: (Vec<Side>, Vec<Side>),
    pub(crate) pose: Pose,
    pub(crate) frame_box: Vec<FrameBox>,
    pub(crate) done: Vec<f64>,
    pub(crate) step: Vec<f64>,
    pub(crate) weight2: Vec<f64>,
    pub(crate) scale: Vec<f64>,
    pub(crate) reference: Vec<f64>,
    /// Weight of a typical joint in the last level.
    pub(crate) soft_scale: f64,
    pub(crate) posture_error: Vec<f64>,
}

impl FrameSolver {
    pub fn new(
        body: Arc<Body>,
        levels: Vec<Vec<Task>>,
        limits: Vec<Limit>,
        locked: &[bool],
        settings: Settings,
    ) -> Self {
        let columns = Columns::new(&body, locked);
        let layout = Layout::new(&body, levels, locked, columns.all.len());
        let is_judged = layout.is_judged();
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
            trust: Trust::new(layout.level_rows.len(), settings.damping),
            is_judged,
            level_energy: vec![0.0; layout.level_rows.len()],
            wanted: vec![0.0; problem.row_count()],
            shift: vec![0.0; problem.row_count()],
            columns,
            q_address,
            problem,
            work: Workspace::default(),
            first_sides,
            pose: body.new_pose(),
            frame_box: vec![FrameBox::default(); body.nv],
            done: vec![0.0; body.nv],
            step: vec![0.0; body.nv],
            weight2: vec![0.0; body.nv],
            scale: vec![1.0; body.nv],
            reference: vec![0.0; body.nv],
            soft_scale: 1.0,
            posture_error: vec![0.0; body.nv],
            limits,
            settings,
            body,
        }
    }

    /// Where each task's slice of the target vector is, with its level.
    pub fn slices(&self) -> impl Iterator<Item = (usize, Range<usize>)> + '_ {
        self.placed.iter().map(|p| (p.level, p.target.clone()))
    }

    /// Start from posture `q`, moving at `velocity`; forgets the active set.
    pub fn reset(&mut self, q: &[f64], velocity: &[f64]) {
        self.q.copy_from_slice(q);
        self.velocity.copy_from_slice(velocity);
        self.problem.variable_side.fill(Default::default());
        self.problem.row_side.fill(Default::default());
        self.first_sides.0.fill(Side::Free);
        self.first_sides.1.fill(Side::Free);
        self.problem.z.fill(0.0);
        self.trust.reset();
    }

    /// One frame of `dt` seconds towards `targets`; the posture reached is in `q`.
    pub fn frame(&mut self, targets: &[f64], dt: f64) {
        for i in 0..self.body.nv {
            self.frame_box[i] = frame_bounds(self.coordinate(i), self.velocity[i] * dt, &self.limits[i], dt);
            self.done[i] = 0.0;
        }
        let mut before = f64::INFINITY;
        for iteration in 0..self.settings.n_ik {
            self.kinematics();
            let total = self.errors(targets);
            if iteration > 0 {
                self.judge();
            }
            if self.settings.early_stop {
                let must_move = self.frame_box.iter().zip(&self.done).any(|(b, d)| b.lo > *d || b.hi < *d);
                if iteration > 0 && !must_move && (total < MET || total >= before * 0.999) {
                    break;
                }
                before = total;
            }
            // The first iteration of a frame resembles that of the frame before more than the last iteration does.
            if iteration == 0 {
                self.problem.variable_side.clone_from(&self.first_sides.0);
                self.problem.row_side.clone_from(&self.first_sides.1);
            }
            self.iterate(targets);
            if iteration == 0 {
                self.first_sides.0.clone_from(&self.problem.variable_side);
                self.first_sides.1.clone_from(&self.problem.row_side);
            }
            self.stats.iterations += 1;
        }
        self.kinematics();
        self.errors(targets);
        self.judge();
        for i in 0..self.body.nv {
            self.velocity[i] = self.done[i] / dt;
        }
        self.stats.frames += 1;
    }

    fn kinematics(&mut self) {
        self.body.forward(&self.q, &mut self.pose);
        self.body.mass_properties(&mut self.pose);
    }

    /// Value of a hinge or slide coordinate; 0 for others (they have no position limit).
    fn coordinate(&self, dof: usize) -> f64 {
        self.q_address[dof].map_or(0.0, |a| self.q[a])
    }

    fn iterate(&mut self, targets: &[f64]) {
        self.metric(targets);
        self.write_rows(targets);
        self.write_box();
        for k in 0..self.problem.level_count() {
            self.problem.damping[k] = self.trust.damping(k);
        }
        let outcome = solve(&mut self.problem, &mut self.work);
        self.promise();
        self.stats.factorizations += u64::from(outcome.factorizations);
        self.stats.fallbacks += u64::from(outcome.fallback);
        self.stats.capped += u64::from(outcome.capped);
        self.step.fill(0.0);
        for &(dof, c) in &self.columns.all {
            let (lo, hi) = iteration_bounds(&self.frame_box[dof], self.done[dof], self.settings.max_step);
            let x = self.reference[dof] + self.problem.z[c] * self.scale[dof];
            self.step[dof] = x.max(lo).min(hi);
        }
        for (done, step) in self.done.iter_mut().zip(&self.step) {
            *done += step;
        }
        self.body.integrate(&mut self.q, &self.step);
    }

    /// What the linear model promises of every level after this step.
    fn promise(&mut self) {
        for k in (0..self.problem.level_count()).filter(|k| self.is_judged[*k]) {
            let left: f64 = self
                .problem
                .level(k)
                .filter(|r| self.problem.present[*r] && self.problem.is_equality(*r))
                .map(|r| {
                    let moved: f64 = self.problem.row(r).iter().zip(&self.problem.z).map(|(c, z)| c * z).sum();
                    (self.wanted[r] - moved - self.shift[r]).powi(2)
                })
                .sum();
            self.trust.promise(k, self.level_energy[k], left);
        }
    }

    fn judge(&mut self) {
        for (k, energy) in self.level_energy.iter().enumerate() {
            self.trust.judge(k, *energy);
        }
    }

    /// Error norm of every present task and energy of every level; returns the sum of the norms over the levels without a posture.
    fn errors(&mut self, targets: &[f64]) -> f64 {
        let mut total = 0.0;
        self.level_energy.fill(0.0);
        for (error, p) in self.task_errors.iter_mut().zip(&self.placed) {
            let target = &targets[p.target.clone()];
            if !p.task.is_present(target) {
                *error = f64::NAN;
                continue;
            }
            let (norm, energy) = p.task.error_size(&self.body, &self.pose, target);
            *error = norm;
            self.level_energy[p.level] += energy;
            if self.is_judged[p.level] {
                total += norm;
            }
        }
        total
    }
}
