//! One frame: targets in, posture out, in at most `n_ik` iterations of the convergence loop (paper, Figure 2).

use crate::body::Body;
use crate::bounds::{frame_bounds, iteration_bounds, FrameBox, Limit};
use crate::hierarchy::{solve, Problem, Workspace};
use crate::kinematics::Pose;
use crate::layout::{Layout, Placed};
use crate::rows::{Columns, RowWriter};
use crate::task::{Task, TaskKind};
use crate::trust::Trust;
use std::ops::Range;
use std::sync::Arc;

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
    placed: Vec<Placed>,
    trust: Trust,
    /// Levels of equalities alone, without a posture: their promises are judged.
    is_judged: Vec<bool>,
    /// Weighted squared error of each level.
    level_energy: Vec<f64>,
    /// What each row would do whole (not capped), and how far the reference posture goes towards it.
    wanted: Vec<f64>,
    shift: Vec<f64>,
    columns: Columns,
    /// Place in q of a hinge or slide coordinate.
    q_address: Vec<Option<usize>>,
    problem: Problem,
    work: Workspace,
    pose: Pose,
    frame_box: Vec<FrameBox>,
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
        let is_judged = layout.is_judged();
        let problem = Problem::new(layout.variables.max(1), &layout.level_rows);
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
            let share = writer.write(&p.task, target, p.first_row, strength);
            for r in rows.clone() {
                self.wanted[r] = self.problem.lower[r] / share;
            }
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
            let shift = &mut self.shift;
            change_variables(&mut self.problem, rows.clone(), &self.columns, &self.reference, &self.scale, shift);
            if let Some(first) = p.soft_column {
                for (k, r) in rows.enumerate() {
                    self.problem.row_mut(r)[first + k] = 1.0;
                }
            }
        }
    }

    fn write_box(&mut self) {
        for &(dof, c) in &self.columns.all {
            let (lo, hi) = iteration_bounds(&self.frame_box[dof], self.done[dof], self.settings.max_step);
            let (x, s) = (self.reference[dof], 1.0 / self.scale[dof]);
            self.problem.lo[c] = (lo - x) * s;
            self.problem.hi[c] = (hi - x) * s;
            self.problem.still[c] = -x * s;
            self.problem.lo_is_stop[c] = self.frame_box[dof].lo_is_stop && lo > -self.settings.max_step;
            self.problem.hi_is_stop[c] = self.frame_box[dof].hi_is_stop && hi < self.settings.max_step;
        }
    }

    /// Error norm of every present task and energy of every level; returns the sum of the norms over all but the last level.
    fn errors(&mut self, targets: &[f64]) -> f64 {
        let last = self.placed.last().map_or(0, |p| p.level);
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
            if p.level < last {
                total += norm;
            }
        }
        total
    }
}

/// From dq to z = (dq - reference) / scale.
fn change_variables(
    problem: &mut Problem,
    rows: Range<usize>,
    columns: &Columns,
    reference: &[f64],
    scale: &[f64],
    shifts: &mut [f64],
) {
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
        shifts[r] = shift;
        problem.lower[r] -= shift;
        problem.upper[r] -= shift;
    }
}
