//! One frame: targets in, posture out, in at most `n_ik` iterations of the convergence loop (paper, Figure 2).

use crate::body::Body;
use crate::bounds::{frame_bounds, iteration_bounds, Limit};
use crate::hierarchy::{solve, Problem, Workspace};
use crate::kinematics::Pose;
use crate::layout::{Layout, Placed};
use crate::rows::{Columns, RowWriter};
use crate::task::{Task, TaskKind};
use std::ops::Range;
use std::sync::Arc;

/// Settings of the convergence loop.
#[derive(Clone, Debug)]
pub struct Settings {
    pub n_ik: usize,
    /// Largest change of one coordinate per iteration (rad or m).
    pub max_step: f64,
    /// Damping threshold of the hierarchy (share of a level's largest row).
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
    placed: Vec<Placed>,
    columns: Columns,
    /// Place in q of a hinge or slide coordinate.
    q_address: Vec<Option<usize>>,
    problem: Problem,
    work: Workspace,
    pose: Pose,
    frame_box: Vec<(f64, f64)>,
    done: Vec<f64>,
    step: Vec<f64>,
    weight2: Vec<f64>,
    scale: Vec<f64>,
    reference: Vec<f64>,
    /// Weight of a typical joint in the last level.
    soft_scale: f64,
    posture_error: Vec<f64>,
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
        let mut problem = Problem::new(layout.variables.max(1), &layout.level_rows);
        problem.damping = settings.damping;
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
            columns,
            q_address,
            problem,
            work: Workspace::default(),
            pose: body.new_pose(),
            frame_box: vec![(0.0, 0.0); body.nv],
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
        self.problem.z.fill(0.0);
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
            if self.settings.early_stop {
                let total = self.errors(targets);
                let must_move = self.frame_box.iter().zip(&self.done).any(|(b, d)| b.0 > *d || b.1 < *d);
                if iteration > 0 && !must_move && (total < 1e-7 || total >= before * 0.999) {
                    break;
                }
                before = total;
            }
            self.iterate(targets);
            self.stats.iterations += 1;
        }
        self.kinematics();
        self.errors(targets);
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

    /// Within a hair of a position limit.
    fn is_at_stop(&self, dof: usize) -> bool {
        const NEAR: f64 = 1e-3;
        let (q, limit) = (self.coordinate(dof), &self.limits[dof]);
        limit.upper - q < NEAR || q - limit.lower < NEAR
    }

    fn iterate(&mut self, targets: &[f64]) {
        self.metric(targets);
        self.write_rows(targets);
        self.write_box();
        let outcome = solve(&mut self.problem, &mut self.work);
        self.stats.factorizations += u64::from(outcome.factorizations);
        self.stats.fallbacks += u64::from(outcome.fallback);
        self.stats.capped += u64::from(outcome.capped);
        self.step.fill(0.0);
        for &(dof, c) in &self.columns.all {
            let (lo, hi) = iteration_bounds(self.frame_box[dof], self.done[dof], self.settings.max_step);
            let x = self.reference[dof] + self.problem.z[c] * self.scale[dof];
            self.step[dof] = x.max(lo).min(hi);
        }
        for (done, step) in self.done.iter_mut().zip(&self.step) {
            *done += step;
        }
        self.body.integrate(&mut self.q, &self.step);
    }

    /// Postures of the last level, as one diagonal metric: weights and the displacement they attract to.
    fn metric(&mut self, targets: &[f64]) {
        self.weight2.fill(0.0);
        self.reference.fill(0.0);
        for p in self.placed.iter().filter(|p| p.metric) {
            let target = &targets[p.target.clone()];
            if !p.task.is_present(target) {
                continue;
            }
            self.body.difference(&self.q, &target[1..], &mut self.posture_error);
            for i in 0..self.body.nv {
                let w = p.task.weight[i] * target[0];
                let cap = p.task.max_error;
                self.weight2[i] += w;
                self.reference[i] += w * (p.task.gain * self.posture_error[i]).max(-cap).min(cap);
            }
        }
        let mut largest: f64 = 0.0;
        let (mut sum, mut count) = (0.0, 0.0);
        for &(dof, _) in &self.columns.all {
            largest = largest.max(self.weight2[dof]);
            if !self.body.dof_is_root[dof] && self.weight2[dof] > 0.0 {
                sum += self.weight2[dof].ln();
                count += 1.0;
            }
        }
        let floor = if largest > 0.0 { 1e-6 * largest } else { 1.0 };
        // A typical joint has weight one, so that rows and damping keep their units (m/rad).
        let typical = if count > 0.0 { f64::exp(sum / count) } else { 1.0 };
        self.soft_scale = typical;
        for i in 0..self.body.nv {
            let w = self.weight2[i] + floor;
            self.reference[i] /= w;
            self.scale[i] = (typical / w).sqrt();
        }
    }

    fn write_rows(&mut self, targets: &[f64]) {
        for p in self.placed.iter().filter(|p| !p.metric) {
            let target = &targets[p.target.clone()];
            let rows = p.first_row..p.first_row + p.task.row_count();
            if !p.task.is_present(target) {
                self.problem.present[rows].fill(false);
                continue;
            }
            let soft = p.soft_column.is_some();
            let strength = if soft { (target[0] / self.soft_scale).sqrt() } else { target[0] };
            let mut writer =
                RowWriter { body: &self.body, pose: &self.pose, columns: &self.columns, problem: &mut self.problem };
            writer.write(&p.task, target, p.first_row, strength);
            if matches!(p.task.kind, TaskKind::Posture) {
                self.body.difference(&self.q, &target[1..], &mut self.posture_error);
                let mut r = p.first_row;
                for &(dof, _) in &self.columns.all {
                    if p.task.weight[dof] > 0.0 {
                        let cap = p.task.max_error;
                        let asked = (p.task.gain * self.posture_error[dof]).max(-cap).min(cap);
                        self.problem.lower[r] = asked * p.task.weight[dof] * strength;
                        self.problem.upper[r] = self.problem.lower[r];
                        r += 1;
                    }
                }
            }
            change_variables(&mut self.problem, rows.clone(), &self.columns, &self.reference, &self.scale);
            if let Some(first) = p.soft_column {
                for (k, r) in rows.enumerate() {
                    self.problem.row_mut(r)[first + k] = 1.0;
                }
            }
        }
    }

    fn write_box(&mut self) {
        for &(dof, c) in &self.columns.all {
            let (lo, hi) = iteration_bounds(self.frame_box[dof], self.done[dof], self.settings.max_step);
            let (x, s) = (self.reference[dof], 1.0 / self.scale[dof]);
            self.problem.lo[c] = (lo - x) * s;
            self.problem.hi[c] = (hi - x) * s;
            self.problem.at_stop[c] = self.is_at_stop(dof);
        }
    }

    /// Error norm of every present task; returns their sum over all but the last level.
    fn errors(&mut self, targets: &[f64]) -> f64 {
        let last = self.placed.last().map_or(0, |p| p.level);
        let mut total = 0.0;
        for (error, p) in self.task_errors.iter_mut().zip(&self.placed) {
            let target = &targets[p.target.clone()];
            *error =
                if p.task.is_present(target) { p.task.error_norm(&self.body, &self.pose, target) } else { f64::NAN };
            if p.level < last && error.is_finite() {
                total += *error;
            }
        }
        total
    }
}

/// From dq to z = (dq - reference) / scale.
fn change_variables(problem: &mut Problem, rows: Range<usize>, columns: &Columns, reference: &[f64], scale: &[f64]) {
    for r in rows {
        if !problem.present[r] {
            continue;
        }
        let stride = problem.stride;
        let row = &mut problem.rows[r * stride..(r + 1) * stride];
        let mut shift = 0.0;
        for &(dof, c) in &columns.all {
            shift += row[c] * reference[dof];
            row[c] *= scale[dof];
        }
        problem.lower[r] -= shift;
        problem.upper[r] -= shift;
    }
}
