//! How each level fares from iteration to iteration of one frame: when to stop, what to damp, and which levels wait.

use crate::body::Body;
use crate::kinematics::Pose;
use crate::level_rows::Placed;
use crate::task::TaskKind;

/// Errors of a level (m, as it weighs them) below this are met.
const MET: f64 = 1e-6;
/// An error that changes by less than this share neither falls nor grows.
const CHANGE: f64 = 1e-2;
/// A level whose error is below this is kept; in the last iterations of a frame, one above it is broken.
const KEPT: f64 = 1e-4;
/// A step that makes a level worse by more than this was too large: a part of it is taken back, and lower levels wait.
const MUCH: f64 = 5e-4;
/// Damping below this share of its length is none: what is met but for a fraction of a millimetre is not out of reach.
const LEAST_DAMPING: f64 = 0.02;
/// A task is far from its goal from this many times on what is asked of it in one iteration, and twice that is as far as it gets.
const FAR: f64 = 2.0;

#[derive(Clone, Debug, Default)]
struct Level {
    /// Made of tasks that have an error; a level with a posture is not looked at.
    counts: bool,
    /// Size of its error as the hierarchy weighs it, now and an iteration before.
    error: f64,
    before: f64,
    /// Its error was small in this frame or at the end of the last one.
    kept: bool,
    /// Weighted size of what the last step should have brought and did not.
    unmet: f64,
    /// Largest such part of a task, in what is asked of it in one iteration.
    distance: f64,
    /// Asks for nothing new in this iteration.
    waits: bool,
}

/// Which posture is looked at.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum Instant {
    /// That of the frame before, with the targets of this one.
    Start,
    /// After a step towards the targets.
    Step,
    /// After a part of this step was taken back.
    StepTakenBack,
}

#[derive(Clone, Debug)]
pub struct Progress {
    levels: Vec<Level>,
    errors_before: Vec<f64>,
    /// A part of the last step was taken back.
    cut: bool,
    /// The level of lowest priority that counts.
    lowest: Option<usize>,
}

impl Progress {
    pub fn new(counts: &[bool]) -> Self {
        let levels = counts.iter().map(|c| Level { counts: *c, ..Level::default() }).collect();
        let mut progress = Self { levels, errors_before: vec![], cut: false, lowest: counts.iter().rposition(|c| *c) };
        progress.reset();
        progress
    }

    /// Nothing is known of the posture.
    pub fn reset(&mut self) {
        for level in &mut self.levels {
            *level = Level { counts: level.counts, error: f64::INFINITY, ..Level::default() };
        }
    }

    /// Look at the posture. Writes every present task's error norm. `violation`: of each task of observers.
    #[allow(clippy::too_many_arguments)]
    pub fn look(
        &mut self,
        body: &Body,
        pose: &Pose,
        placed: &[Placed],
        targets: &[f64],
        instant: Instant,
        violation: &[f64],
        errors: &mut [f64],
    ) {
        self.cut = instant == Instant::StepTakenBack;
        if !self.cut {
            self.errors_before.clear();
            self.errors_before.extend_from_slice(errors);
        }
        for level in &mut self.levels {
            if instant == Instant::Start {
                level.kept = level.error <= KEPT;
                level.waits = false;
            }
            if instant != Instant::StepTakenBack {
                level.before = level.error;
            }
            level.error = 0.0;
            if instant != Instant::Start && !level.waits {
                (level.unmet, level.distance) = (0.0, 0.0);
            }
        }
        for ((error, before), p) in errors.iter_mut().zip(&self.errors_before).zip(placed) {
            let target = &targets[p.target.clone()];
            if !p.task.is_present(target) {
                *error = f64::NAN;
                continue;
            }
            let level = &mut self.levels[p.level];
            if let TaskKind::Observers(task) = &p.task.kind {
                // What they ask for in a frame is bounded already: they are never damped.
                *error = violation[task.index];
                level.error = libm::hypot(level.error, *error);
                continue;
            }
            let (norm, energy) = p.task.error_size(body, pose, target);
            *error = norm;
            if !level.counts {
                continue;
            }
            level.error = libm::hypot(level.error, energy.sqrt());
            let most = p.task.max_error;
            let left = if instant != Instant::Start {
                let brought = ((before - norm) / before.min(most)).clamp(0.0, 1.0);
                norm * (1.0 - brought) * (1.0 - brought)
            } else {
                // What is far off will not be reached by the next step either.
                (norm - FAR * most).max(0.0)
            };
            if left > 0.0 && !level.waits {
                let unmet = energy.sqrt() * left.min(most) / norm;
                level.unmet =
                    if instant != Instant::Start { libm::hypot(level.unmet, unmet) } else { level.unmet.max(unmet) };
                level.distance = level.distance.max(left / most);
            }
        }
        for level in &mut self.levels {
            level.kept |= level.error <= KEPT;
        }
    }

    /// No error falls any more, none has grown that may yet be taken back, and none stands still only because its level waits or
    /// because the step was shortened.
    pub fn is_done(&self) -> bool {
        !self.cut
            && self.levels.iter().enumerate().all(|(k, l)| {
                let falls = l.error < (1.0 - CHANGE) * l.before;
                let grew = l.error > (1.0 + CHANGE) * l.before && Some(k) != self.lowest;
                l.error <= MET || !(falls || grew || l.waits)
            })
    }

    /// Damping (m/rad) of a level: its square is `length` (m) times what the last step left. So a level that is met is not
    /// damped, and one that asks for what cannot be is; as in T. Sugihara, "Solvability-unconcerned inverse kinematics by the
    /// Levenberg-Marquardt method", IEEE Trans. Robotics 27(5), 2011.
    pub fn damping(&self, level: usize, length: f64) -> f64 {
        let level = &self.levels[level];
        let damping = (length * level.unmet).sqrt();
        if damping < LEAST_DAMPING * length {
            0.0
        } else {
            damping
        }
    }

    /// Whether a level is so far from its goal that it need not hurry: 0 is near, 1 far.
    pub fn patience(&self, level: usize) -> f64 {
        (self.levels[level].distance / FAR - 1.0).clamp(0.0, 1.0)
    }

    /// The first level that the step has changed much has grown worse: the step was too large for its linear model.
    pub fn went_too_far(&self) -> bool {
        let changed = self.levels.iter().find(|l| (l.error - l.before).abs() > MUCH);
        changed.is_some_and(|l| l.error > l.before)
    }

    /// Levels below a broken one wait, but for those that were kept themselves, which are victims too. `late`: there is little time left
    /// in this frame.
    pub fn decide_who_waits(&mut self, late: bool) {
        let mut broken = false;
        for level in &mut self.levels {
            level.waits = broken && !level.kept;
            broken |= level.error > if late { KEPT } else { level.before + MUCH };
        }
    }

    pub fn waits(&self, level: usize) -> bool {
        self.levels[level].waits
    }
}
