//! One frame: targets in, posture out, in at most `n_ik` iterations of the convergence loop (paper, Figure 2); and many frames in a row.

use crate::braking::frame_bounds;
use crate::frame::FrameSolver;
use crate::progress::Instant;
use crate::task::TaskKind;

/// Iterations at the end of a frame that may be used to repair what lower levels did to higher ones.
const REPAIRS: usize = 2;
/// Soft tasks ask for so much less where a level is damped by this share of its length, or more.
const SOFT_SLOWING: f64 = 0.8;
const SOFT_SLOW: f64 = 0.15;
/// How often a step is halved.
const HALVINGS: usize = 3;

impl FrameSolver {
    /// One frame of `dt` seconds towards `targets`; the posture reached is in `q`.
    pub fn frame(&mut self, targets: &[f64], dt: f64) {
        for i in 0..self.body.nv {
            self.frame_box[i] = frame_bounds(self.coordinate(i), self.velocity[i] * dt, &self.limits[i], dt);
            self.done[i] = 0.0;
        }
        self.look(targets, Instant::Start, 0, dt);
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
            self.look(targets, Instant::Step, iteration + 1, dt);
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
    }

    /// Kinematics and errors of the posture as it is, after so many iterations of a frame of `dt` s.
    fn look(&mut self, targets: &[f64], instant: Instant, done: usize, dt: f64) {
        if instant != Instant::Start || !self.posed {
            self.body.forward(&self.q, &mut self.pose);
            self.body.mass_properties(&mut self.pose);
            self.posed = true;
        }
        let mut violation: &[f64] = &[];
        if let Some(watch) = &mut self.watch {
            match instant {
                Instant::Start => {
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
        self.progress.look(&self.body, &self.pose, &self.placed, targets, instant, violation, &mut self.task_errors);
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
            self.look(targets, Instant::StepTakenBack, done, dt);
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

    /// A row of `targets` and a row of `postures` (nq) for each frame of `dt` seconds. A clip begins with the active set with which the
    /// clip before began: where one is made in every tick, as a way to a stop is, it begins much alike.
    pub fn clip(&mut self, targets: &[f64], dt: f64, postures: &mut [f64]) {
        self.first_sides.clone_from(&self.clip_sides);
        let rows = targets.chunks_exact(self.target_size.max(1));
        for (t, (row, posture)) in rows.zip(postures.chunks_exact_mut(self.body.nq)).enumerate() {
            self.frame(row, dt);
            posture.copy_from_slice(&self.q);
            if t == 0 {
                self.clip_sides.clone_from(&self.first_sides);
            }
        }
    }

    /// Value of a hinge or slide coordinate; 0 for others (they have no position limit).
    fn coordinate(&self, dof: usize) -> f64 {
        self.q_address[dof].map_or(0.0, |a| self.q[a])
    }
}
