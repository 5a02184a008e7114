//! The linear problem of one iteration: metric, rows and box, in the variables z = (dq - reference) / scale; its solution, with the rows
//! of observers and the second solve that a trial requires.

use crate::braking::iteration_bounds;
use crate::frame::FrameSolver;
use crate::hierarchy::{solve, Problem};
use crate::level_rows::Placed;
use crate::observers::{Activation, Shift};
use crate::task::TaskKind;
use crate::task_rows::{Columns, RowWriter};
use std::ops::Range;

/// Solves of one iteration in which pairs may still ask for a row.
const MOST_SURPRISES: usize = 4;

impl FrameSolver {
    /// Postures of the last level, as one diagonal metric: weights and the displacement they attract to.
    pub(crate) fn metric(&mut self, targets: &[f64]) {
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

    pub(crate) fn write_rows(&mut self, targets: &[f64]) {
        let has_rows = |p: &&Placed| !p.metric && !matches!(p.task.kind, TaskKind::Observers(_));
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
            let share = if soft { self.soft_share } else { f64::from(!self.progress.waits(p.level)) };
            if share < 1.0 {
                for r in rows.clone() {
                    if self.problem.is_equality(r) {
                        self.problem.lower[r] *= share;
                        self.problem.upper[r] = self.problem.lower[r];
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

    pub(crate) fn write_box(&mut self) {
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

    /// From the answer of the hierarchy to the step of every coordinate.
    pub(crate) fn read_step(&mut self) {
        self.step.fill(0.0);
        for &(dof, c) in &self.columns.all {
            let (lo, hi) = iteration_bounds(&self.frame_box[dof], self.done[dof], self.settings.max_step);
            let x = self.reference[dof] + self.problem.z[c] * self.scale[dof];
            self.step[dof] = x.max(lo).min(hi);
        }
    }

    /// Solve the iteration's problem with the rows of the observers.
    pub(crate) fn solve_observed(&mut self, first: bool) {
        let Some(watch) = &mut self.watch else {
            self.solve_once();
            return;
        };
        let shift = Shift { reference: &self.reference, scale: &self.scale };
        let is_trial = watch.write_rows(&self.body, &self.pose, &mut self.problem, &shift, first);
        let acts = watch.activation;
        // Damping lowers targets where it solves.
        self.asked.0.clone_from(&self.problem.lower);
        self.asked.1.clone_from(&self.problem.upper);
        self.solve_once();
        if acts == Activation::All {
            self.solve_surprises(first);
        } else if is_trial {
            self.ask_again();
            if self.watch.as_mut().is_some_and(|watch| watch.choose(&mut self.problem)) {
                self.solve_once();
            }
        }
        if let Some(watch) = &mut self.watch {
            watch.keep_sides(&self.problem, first);
        }
    }

    /// Solve again with the rows of pairs that the answer would bring too near although they had no row.
    fn solve_surprises(&mut self, first: bool) {
        for _ in 0..MOST_SURPRISES {
            self.read_step();
            let Some(watch) = &mut self.watch else { return };
            let before = watch.wake_surprised(&self.step);
            if watch.near.len() == before {
                return;
            }
            self.ask_again();
            let Some(watch) = &mut self.watch else { return };
            let shift = Shift { reference: &self.reference, scale: &self.scale };
            watch.write_rows_from(before, &self.body, &self.pose, &mut self.problem, &shift, first);
            self.asked.0.clone_from(&self.problem.lower);
            self.asked.1.clone_from(&self.problem.upper);
            self.solve_once();
        }
    }

    /// Targets and limits of rows as they were before the last solve.
    fn ask_again(&mut self) {
        self.problem.lower.copy_from_slice(&self.asked.0);
        self.problem.upper.copy_from_slice(&self.asked.1);
    }

    fn solve_once(&mut self) {
        let outcome = solve(&mut self.problem, &mut self.work);
        self.stats.factorizations += u64::from(outcome.factorizations);
        self.stats.fallbacks += u64::from(outcome.fallback);
        self.stats.capped += u64::from(outcome.capped);
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
