//! The state of a solver from frame to frame: body, tasks, limits, the linear problem, and the posture that was reached.
//! `converge` runs a frame of it, or a stop.

use crate::body::Body;
use crate::braking::{FrameBox, Limit};
use crate::hierarchy::{Problem, Stages};
use crate::kinematics::Pose;
use crate::level_rows::{monitor, reserve_rows, Layout, Placed};
use crate::observers::{Activation, ObserverSet, PairMonitor};
use crate::task::Task;
use crate::task_rows::Columns;
use std::ops::Range;
use std::sync::Arc;

/// Settings of the convergence loop.
#[derive(Clone, Debug)]
pub struct Settings {
    pub n_ik: usize,
    /// Largest change of one coordinate per iteration (rad or m).
    pub max_step: f64,
    /// Squared damping of a level for each metre of the body's size and of its error (see `hierarchy`).
    pub damping: f64,
    pub early_stop: bool,
}

/// Counters since the solver was made.
#[derive(Clone, Copy, Debug, Default)]
pub struct Stats {
    pub iterations: u64,
    /// Limits that entered or left the active set.
    pub steps: u64,
    /// Solves that were ended early.
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
    /// Postures (k, nq) in which a planned stop would end, and its time, s. It holds for the next frame alone.
    pub stop: Option<(Vec<f64>, f64)>,
    pub(crate) placed: Vec<Placed>,
    pub monitor: Option<PairMonitor>,
    pub(crate) columns: Columns,
    /// Place in q of a hinge or slide coordinate.
    pub(crate) q_address: Vec<Option<usize>>,
    pub(crate) problem: Problem,
    pub(crate) stages: Stages,
    pub(crate) pose: Pose,
    /// The pose is that of `q`.
    pub(crate) posed: bool,
    pub(crate) frame_box: Vec<FrameBox>,
    pub(crate) done: Vec<f64>,
    pub(crate) step: Vec<f64>,
    pub(crate) weight2: Vec<f64>,
    pub(crate) scale: Vec<f64>,
    pub(crate) reference: Vec<f64>,
    /// Weight of a typical joint in the last level.
    pub(crate) soft_scale: f64,
    pub(crate) posture_error: Vec<f64>,
    /// Steps that the frame has left.
    pub(crate) budget: u32,
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
        let monitor = observers.map(|(set, activation)| monitor(&body, &columns, &mut layout.placed, set, activation));
        let mut problem = Problem::new(layout.variables.max(1), &layout.level_rows);
        problem.damping = settings.damping * body.size();
        problem.soft_last = layout.soft_last;
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
            task_errors: vec![f64::NAN; layout.placed.len()],
            stop: None,
            placed: layout.placed,
            monitor,
            columns,
            q_address,
            problem,
            stages: Stages::default(),
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
            budget: 0,
            limits,
            settings,
            body,
        }
    }

    /// Level of each task, and its slice of the target vector.
    pub fn slices(&self) -> impl Iterator<Item = (usize, Range<usize>)> + '_ {
        self.placed.iter().map(|p| (p.level, p.target.clone()))
    }

    /// Start from posture `q`, moving at `velocity`.
    pub fn reset(&mut self, q: &[f64], velocity: &[f64]) {
        self.go_on_from(q, velocity);
        if let Some(monitor) = &mut self.monitor {
            monitor.reset();
        }
    }

    /// Go on from posture `q`, near to the one that was reached, at `velocity`. The bounds of pair distances are kept.
    pub fn correct(&mut self, q: &[f64], velocity: &[f64]) {
        self.body.difference(&self.q, q, &mut self.step);
        if let Some(monitor) = &mut self.monitor {
            monitor.moved(&self.step);
        }
        self.go_on_from(q, velocity);
    }

    fn go_on_from(&mut self, q: &[f64], velocity: &[f64]) {
        self.q.copy_from_slice(q);
        self.posed = false;
        for &(dof, _) in &self.columns.all {
            self.velocity[dof] = velocity[dof]; // locked coordinates stay at rest
        }
    }
}
