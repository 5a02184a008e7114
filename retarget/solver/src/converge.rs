//! One frame: targets in, posture out, in at most `n_ik` iterations of the convergence loop (paper, Figure 2); and the path of a stop.
//!
//! The linear problem of one iteration is metric, rows and box, in the variables z = (dq - reference) / scale. Observers add their rows,
//! and may need a second solve after a trial.

use crate::braking::{frame_bounds, iteration_bounds, stopping_time, Limit, Motion, MASS_BRAKING};
use crate::frame::FrameSolver;
use crate::hierarchy::{Problem, BUDGET};
use crate::level_rows::Placed;
use crate::math::{add_scaled, norm, quat_mul};
use crate::observers::{Activation, Iteration};
use crate::task::TaskKind;
use crate::task_rows::{Columns, RowWriter};
use std::ops::Range;

/// A step (m, rad) as short as this has converged.
const STILL: f64 = 1e-7;
/// Most further solves of one iteration, each with the rows of newly active pairs.
const MOST_EXTRA_SOLVES: usize = 4;

impl FrameSolver {
    /// One frame of `dt` seconds towards `targets`, at a share `speed` (0, 1] of all speeds. `q` becomes the posture reached.
    pub fn frame(&mut self, targets: &[f64], speed: f64, dt: f64) {
        for i in 0..self.body.nv {
            self.frame_box[i] = frame_bounds(self.coordinate(i), self.velocity[i] * dt, &self.limits[i], speed, dt);
            self.done[i] = 0.0;
        }
        self.budget = BUDGET;
        self.look(targets, 0, dt);
        for iteration in 0..self.settings.n_ik {
            if iteration > 0 && self.settings.early_stop && self.stands() {
                break;
            }
            self.iterate(targets);
            self.look(targets, iteration + 1, dt);
            self.stats.iterations += 1;
        }
        for i in 0..self.body.nv {
            self.velocity[i] = self.done[i] / dt;
        }
        if let Some(monitor) = &mut self.monitor {
            monitor.finish(&self.done);
        }
        self.stop = None;
    }

    /// Update kinematics and errors after `done` iterations of a frame of `dt` s.
    fn look(&mut self, targets: &[f64], done: usize, dt: f64) {
        self.posed &= done == 0;
        self.pose_body();
        let stop = self.stop.as_ref().map(|stop| (&stop.0[..], stop.1));
        let motion = Motion { velocity: &self.velocity, limits: &self.limits, stop };
        if let Some(monitor) = &mut self.monitor {
            if done == 0 {
                for p in &self.placed {
                    if let TaskKind::Observers(task) = &p.task.kind {
                        monitor.tasks[task.index].on = p.task.is_present(&targets[p.target.clone()]);
                    }
                }
                monitor.begin(&self.body, (&self.q, &self.pose), &motion, dt, self.settings.n_ik);
            } else {
                monitor.look(&self.pose, done, &self.step);
            }
        }
        for (error, p) in self.task_errors.iter_mut().zip(&self.placed) {
            let target = &targets[p.target.clone()];
            *error = match (&p.task.kind, &self.monitor) {
                _ if !p.task.is_present(target) => f64::NAN,
                (TaskKind::Observers(task), Some(monitor)) => monitor.violation[task.index],
                _ => p.task.error_size(&self.body, &self.pose, target),
            };
        }
    }

    fn pose_body(&mut self) {
        if !self.posed {
            self.body.forward(&self.q, &mut self.pose);
            self.body.mass_properties(&mut self.pose);
            self.posed = true;
        }
    }

    /// True if the last step was zero, the box of the frame allows to stay, and no obstacle comes nearer.
    fn stands(&self) -> bool {
        self.step.iter().all(|step| step.abs() <= STILL)
            && self.frame_box.iter().zip(&self.done).all(|(b, d)| b.holds(*d))
            && self.monitor.as_ref().is_none_or(|monitor| !monitor.needs_every_iteration())
    }

    fn iterate(&mut self, targets: &[f64]) {
        self.metric(targets);
        self.write_rows(targets);
        self.write_box();
        self.solve_observed();
        self.read_step();
        for (done, step) in self.done.iter_mut().zip(&self.step) {
            *done += step;
        }
        self.body.integrate(&mut self.q, &self.step);
    }

    /// Postures (rows, nq) of a stop, one row for each frame of `dt` s, at most `most`. The velocities of coordinates and of the centre of
    /// mass fall linearly to zero over the stopping time, as far as limits and the tasks of points and frames, which stay, allow. After the
    /// last row the body may stop at once. A coordinate that begins beyond the end of its range goes no farther than it must.
    pub fn brake(&mut self, dt: f64, most: usize, pendulum: f64) -> Vec<f64> {
        self.pose_body();
        let began = self.velocity.clone();
        let mass =
            (0..self.body.nv).fold([0.0; 3], |v, dof| add_scaled(v, self.body.com_column(&self.pose, dof), began[dof]));
        // A fast centre of mass stops in `pendulum` s, sqrt(height / g), with its zero-moment point at its capture point.
        let ticks = stopping_time(&began, &self.limits).max(pendulum.min(norm(mass) / MASS_BRAKING)) / dt;
        if ticks <= 1.0 {
            return vec![];
        }
        let limits = self.limits.clone();
        for i in 0..self.body.nv {
            let at = self.coordinate(i);
            self.limits[i].lower = self.limits[i].lower.min(at);
            self.limits[i].upper = self.limits[i].upper.max(at);
        }
        let mut targets = vec![0.0; self.target_size];
        for p in &self.placed {
            let target = &mut targets[p.target.clone()];
            target[0] = 1.0;
            match p.task.kind {
                TaskKind::Position { link, point, .. } => {
                    target[1..].copy_from_slice(&self.body.point(&self.pose, link, point));
                }
                TaskKind::Orientation { link, quat } => {
                    target[1..].copy_from_slice(&quat_mul(self.pose.quat[link], quat));
                }
                _ => {}
            }
        }
        let mut postures = vec![];
        for t in 1..=most {
            let left = (1.0 - t as f64 / ticks).max(0.0) * dt;
            self.step.iter_mut().zip(&began).for_each(|(step, began)| *step = left * began);
            for p in &self.placed {
                let target = &mut targets[p.target.clone()][1..];
                match p.task.kind {
                    TaskKind::Posture => {
                        target.copy_from_slice(&self.q);
                        self.body.integrate(target, &self.step);
                    }
                    TaskKind::CentreOfMass { over: None } => {
                        target.copy_from_slice(&add_scaled(self.pose.com, mass, left));
                    }
                    _ => {}
                }
            }
            self.frame(&targets, 1.0, dt);
            postures.extend_from_slice(&self.q);
            let stops = |(done, limit): (&f64, &Limit)| done.abs() <= limit.acceleration * dt * dt;
            if left == 0.0 && self.done.iter().zip(&self.limits).all(stops) {
                break;
            }
        }
        self.limits = limits;
        postures
    }

    /// Value of a hinge or slide coordinate; 0 for others (they have no position limit).
    fn coordinate(&self, dof: usize) -> f64 {
        self.q_address[dof].map_or(0.0, |a| self.q[a])
    }

    /// The postures of the last level as one diagonal metric: weights, and the displacement to which they attract.
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
        // The geometric mean is a typical weight that a few stiff joints do not set.
        let (mut sum, mut count) = (0.0, 0.0);
        for &(dof, _) in &self.columns.all {
            largest = largest.max(self.weight2[dof]);
            if !self.body.dof_is_root[dof] && self.weight2[dof] > 0.0 {
                sum += libm::log(self.weight2[dof]);
                count += 1.0;
            }
        }
        let floor = if largest > 0.0 { 1e-6 * largest } else { 1.0 };
        // A typical joint has weight one, so that rows and damping keep their units (m/rad).
        let typical = if count > 0.0 { libm::exp(sum / count) } else { 1.0 };
        self.soft_scale = typical;
        for i in 0..self.body.nv {
            let w = self.weight2[i] + floor;
            self.reference[i] /= w;
            self.scale[i] = (typical / w).sqrt();
        }
    }

    fn write_rows(&mut self, targets: &[f64]) {
        let has_rows = |p: &&Placed| !p.metric && !matches!(p.task.kind, TaskKind::Observers(_));
        self.problem.error2.fill(0.0);
        for p in self.placed.iter().filter(has_rows) {
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
            let requested2: f64 = rows
                .clone()
                .filter(|r| self.problem.is_equality(*r))
                .fold(0.0, |sum, r| sum + self.problem.lower[r] * self.problem.lower[r]);
            self.problem.error2[p.level] += requested2 / (share * share);
            if matches!(p.task.kind, TaskKind::Posture) {
                self.body.difference(&self.q, &target[1..], &mut self.posture_error);
                let mut r = p.first_row;
                for &(dof, _) in &self.columns.all {
                    if p.task.weight[dof] > 0.0 {
                        let cap = p.task.max_error;
                        let requested = (p.task.gain * self.posture_error[dof]).max(-cap).min(cap);
                        self.problem.lower[r] = requested * p.task.weight[dof] * strength;
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
            let (lo, hi) = iteration_bounds(&self.frame_box[dof], self.done[dof], self.settings.max_step);
            let (x, s) = (self.reference[dof], 1.0 / self.scale[dof]);
            self.problem.lo[c] = (lo - x) * s;
            self.problem.hi[c] = (hi - x) * s;
            self.problem.still[c] = -x * s;
        }
    }

    /// Convert the solution z of the hierarchy to the step of every coordinate.
    fn read_step(&mut self) {
        self.step.fill(0.0);
        for &(dof, c) in &self.columns.all {
            let (lo, hi) = iteration_bounds(&self.frame_box[dof], self.done[dof], self.settings.max_step);
            let x = self.reference[dof] + self.problem.z[c] * self.scale[dof];
            self.step[dof] = x.max(lo).min(hi);
        }
    }

    /// Solve the iteration's problem with the rows of the observers.
    fn solve_observed(&mut self) {
        let Some(monitor) = &mut self.monitor else {
            self.solve_once();
            return;
        };
        let (body, pose, reference, scale) = (&self.body, &self.pose, &self.reference, &self.scale);
        let is_trial = monitor.write_rows(&mut self.problem, &Iteration { body, pose, reference, scale });
        let acts = monitor.activation;
        self.solve_once();
        if acts == Activation::All {
            self.solve_newly_active();
        } else if is_trial && self.monitor.as_mut().is_some_and(|monitor| monitor.choose(&mut self.problem)) {
            self.solve_once();
        }
        if let Some(monitor) = &mut self.monitor {
            monitor.keep_held(&self.problem);
        }
    }

    /// Solve again with the rows of newly active pairs, which had no row and which the solution would bring too near.
    fn solve_newly_active(&mut self) {
        for _ in 0..MOST_EXTRA_SOLVES {
            self.read_step();
            let Some(monitor) = &mut self.monitor else { return };
            let before = monitor.wake_newly_active(&self.step);
            if monitor.near.len() == before {
                return;
            }
            let (body, pose, reference, scale) = (&self.body, &self.pose, &self.reference, &self.scale);
            monitor.write_rows_from(before, &mut self.problem, &Iteration { body, pose, reference, scale });
            self.solve_once();
        }
    }

    fn solve_once(&mut self) {
        let outcome = self.stages.solve(&mut self.problem, self.budget);
        self.budget -= outcome.steps;
        self.stats.steps += u64::from(outcome.steps);
        self.stats.capped += u64::from(outcome.capped);
    }
}

/// Change the variables of rows from dq to z = (dq - reference) / scale.
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
